# SPDX-License-Identifier: Apache-2.0
"""Files of an exported model: text, meshes, ranges for domain randomisation, replay."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_control.files import write_whole
from loco_learning.gap.localisation.curves import load as load_curves
from loco_learning.gap.recordings.record import Record
from loco_sim.export import isaac, ranges
from loco_sim.export.mjcf import dofs, mjcf
from loco_sim.export.portable import ELASTIC, GEARS, RIGID, Portable, portable
from loco_sim.export.ranges import Range
from loco_sim.export.ros2_control import ros2_control
from loco_sim.export.urdf import urdf
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from ..gap import run as gap
from ..gap.importing import load as load_records
from .replay import SCRIPT, Compared, compare

MJCF, URDF, ISAAC, PACE = "mjcf", "urdf", "isaac", "pace"
CONTROL = "ros2_control"
TARGETS = (MJCF, URDF, ISAAC, PACE, CONTROL)
ModelFiles = dict[str, tuple[str, list[str]]]


@dataclass(frozen=True)
class Exported:
    """Result of an export.

    Attributes:
        folder: Folder of the files.
        files: Names of the files.
        lost: Sentences on what the format cannot represent.
        compared: Errors on held-out records; empty unless the target is MJCF.
        notes: Sentences on skipped steps.
    """

    folder: Path
    files: tuple[str, ...]
    lost: tuple[str, ...]
    compared: tuple[Compared, ...] = field(default=())
    notes: tuple[str, ...] = ()


def export_model(
    model: str | Path,
    to: str,
    out: str | Path | None = None,
    replay: Sequence[str | Path] = (),
    mapping: str | Path | None = None,
    gear: str | None = None,
) -> Exported:
    """Write a model for another simulator.

    Args:
        model: Robot, model.yaml, or the folder of results of `loco gap`.
        to: One of `TARGETS`.
        out: Folder; default ``results/export_ROBOT_TARGET``.
        replay: Recordings of the robot with a fixed base, to check the MJCF; default the
            held-out ones of `loco gap`.
        mapping: Mapping of the recordings.
        gear: Gears of servos in MJCF: "elastic", the default, has a joint for each rotor;
            "rigid" adds the rotors as armature, so that the file has only the robot's joints.

    Raises:
        LocoError: There is no such model, target or gear, or a recording is invalid.
    """
    gear = _gear(to, gear, replay)
    path = Path(model)
    results = path if (path / gap.RESULT).is_file() else path.parent
    source = models.load_any(path / gap.MODEL if results == path else path)
    result = results / gap.RESULT if path.name == gap.MODEL or results == path else None
    exported = portable(source, gear)
    identified, unused = _ranges(exported, source, result)
    documents = WRITERS[to](exported, identified)
    folder = Path(out or f"results/export_{exported.robot.name}_{to}")
    _claim(folder)
    records, notes = _records(source, replay, mapping, result) if to == MJCF else ([], [])
    if not identified:
        notes.append("no ranges to randomise in: no interval of `loco gap` belongs to the model")
    folder.mkdir(parents=True, exist_ok=True)
    for name, (text, _) in documents.items():
        write_whole(folder / name, _with_meshes(text, folder))
    compared: list[Compared] = []
    if to == MJCF:
        for old in folder.glob("replay_*"):
            old.unlink()
        shutil.copyfile(SCRIPT, folder / "replay.py")
        starts = {} if replay else _starts(result)
        compared, replay_notes = compare(source, records, folder, gear, starts)
        notes += replay_notes
    lost = dict.fromkeys(text for _, missing in documents.values() for text in missing)
    files = tuple(sorted(str(p.relative_to(folder)) for p in folder.rglob("*") if p.is_file()))
    return Exported(folder, files, (*lost, *unused), tuple(compared), tuple(notes))


def _gear(to: str, gear: str | None, replay: Sequence[Any]) -> str:
    """Gear of an export; raises an error for options that do not belong to its target."""
    if to not in TARGETS:
        raise NameUnknownError("target of an export", to, TARGETS)
    if replay and to != MJCF:
        raise ParameterError(f"recordings are replayed in MuJoCo: take --to {MJCF}, not {to}")
    if gear not in (None, *GEARS):
        raise NameUnknownError("gear of an export", gear, GEARS)
    if gear and to != MJCF:
        raise ParameterError(f"{to} has rigid gears: take --to {MJCF}, or leave --gear out")
    return gear or (ELASTIC if to == MJCF else RIGID)


def _ranges(built: Portable, model: Model, result: Path | None) -> tuple[list[Range], list[str]]:
    """Ranges of a model from the results of `loco gap`, and sentences on what has none."""
    present = result is not None and result.is_file()
    terms = gap.read_json(result, gap.ResultFile)["terms"] if present else []
    names = {effect["name"] for effect in model.effects}
    spans, unused = ranges.of(built, [term for term in terms if term["effect"] in names])
    absent = [term["effect"] for term in terms if term["effect"] not in names]
    return spans, [*unused, *(f"{name}: the model has not got it" for name in absent)]


def _starts(result: Path | None) -> dict[str, Any]:
    """Corrections of initial states by a search, by record."""
    arrays = result and result.with_name(gap.ARRAYS)
    curves = load_curves(arrays).records if arrays and arrays.is_file() else ()
    return {record.name: record.start for record in curves}


def _to_mjcf(built: Portable, spans: Sequence[Range]) -> ModelFiles:
    text, lost = mjcf(built)
    output = {"model.xml": (text, lost)}
    return output | ({"randomize.py": ranges.playground(built, spans, dofs(text))} if spans else {})


WRITERS: dict[str, Callable[[Portable, Sequence[Range]], ModelFiles]] = {
    MJCF: _to_mjcf,
    URDF: lambda built, spans: {"robot.urdf": urdf(built)},
    ISAAC: lambda built, spans: {
        "isaac_lab.py": isaac.isaac(built, spans),
        "robot.urdf": (urdf(built)[0], []),
    },
    PACE: lambda built, spans: {"pace.py": isaac.pace(built, spans)},
    CONTROL: lambda built, spans: ros2_control(built),
}


def _claim(folder: Path) -> None:
    """Raise an error if the folder has files that are not of an export."""
    if folder.exists() and not folder.is_dir():
        raise ParameterError(f"{folder} is a file, wanted is a folder")
    pattern = re.compile(
        r"(model|replay_\d+)\.(xml|npz)|robot\.urdf|(controllers|nodes)\.yaml|[a-z_]+\.py|meshes"
    )
    strange = [p.name for p in folder.glob("*") if not pattern.fullmatch(p.name)]
    if strange:
        raise ParameterError(f"{folder} holds other files ({strange[0]}); choose another --out")


def _records(
    model: Model, replay: Sequence[Any], mapping: Any, result: Path | None
) -> tuple[list[Record], list[str]]:
    """Records for the comparison, and the reasons if there are none."""
    if replay:
        robot = model.make_robot()
        return [r for path in replay for r in load_records(path, robot, mapping)], []
    if result is None or not (result.parent / gap.JOB).is_file():
        return [], ["not replayed: name recordings with --replay"]
    try:
        _, _, held = gap.read_records(gap.load_job(result.parent))
    except LocoError as error:
        return [], [f"not replayed: {error}"]
    return held, [] if held else ["not replayed: `loco gap` held no recording out whole"]


def _with_meshes(text: str, folder: Path) -> str:
    """Copy the meshes into the folder; returns the text with their new file names."""
    for name in sorted(set(re.findall(r'file(?:name)?="(/[^"]+)"', text))):
        mesh = Path(name)
        if mesh.is_file():
            (folder / "meshes").mkdir(exist_ok=True)
            shutil.copyfile(mesh, folder / "meshes" / mesh.name)
        text = text.replace(f'"{name}"', f'"meshes/{mesh.name}"')
    return text
