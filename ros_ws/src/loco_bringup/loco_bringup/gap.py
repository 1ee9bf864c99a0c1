# SPDX-License-Identifier: Apache-2.0
"""`loco gap`: bags and a model in; where they differ, why, and the model without it out."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_learning.gap import curves as gap_curves
from loco_learning.gap.curves import FIT, HELD_OUT, Curves
from loco_learning.gap.record import Record
from loco_learning.plain import plain
from loco_sim import effects
from loco_sim import model as models
from loco_sim.model import Model

RESULT, MODEL, PAGE, ARRAYS, JOB = "gap.json", "model.yaml", "gap.html", "gap.npz", "job.json"

Tell = Callable[[float, str, str], None]  # share of the work done, stage, best name so far


@dataclass(frozen=True)
class Job:
    """What is asked for.

    Attributes:
        robot: Robot, robot.yaml or model.yaml, as given.
        bags: Recordings as given.
        hold_out: Those that are only judged on.
        mapping: Path of a mapping file; empty for recordings of standard topics.
        options: Values of `GapParams` that differ from their defaults.
        workers: Processes.
    """

    robot: str
    bags: tuple[str, ...]
    hold_out: tuple[str, ...] = ()
    mapping: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    workers: int = 2

    def default_folder(self) -> Path:
        """Folder of the results when none is given."""
        return Path("results") / f"gap_{Path(self.bags[0]).name.split('.')[0]}"

    def save(self, folder: Path) -> None:
        """Write what was asked, for `load_job`."""
        values = {k: getattr(self, k) for k in ("robot", "bags", "hold_out", "mapping", "options")}
        write_json(folder / JOB, {"format": 1, **values})


def load_job(folder: str | Path) -> Job:
    """What made a folder of results.

    Raises:
        MissingFileError: The folder holds no results of `loco gap`.
    """
    path = Path(folder) / JOB
    values = read_json(path)
    return Job(
        values["robot"], tuple(values["bags"]), tuple(values["hold_out"]), values["mapping"],
        values["options"],
    )  # fmt: skip


def read_json(path: Path) -> dict[str, Any]:
    """A file of a folder of results.

    Raises:
        MissingFileError: It is not there, or of another kind.
    """
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except OSError:
        raise MissingFileError(
            f"{path.parent} holds no {path.name}; make it with `loco gap BAG... --output "
            f"{path.parent}`"
        ) from None
    except ValueError as error:
        raise MissingFileError(f"{path} is not JSON ({error})") from None
    if not isinstance(values, dict) or values.get("format") != 1:
        raise MissingFileError(f"{path} is not of format 1, which this version reads")
    return values


def read_records(job: Job) -> tuple[Model, list[Record], list[Record]]:
    """Model, records to fit and records to judge on.

    Without `--hold-out` the last of several records is held out; a single one stays whole,
    and the workflow holds its end out.

    Raises:
        LocoError: Unknown robot, recordings that are not of use.
    """
    from .gap_import import load

    model = models.load_any(job.robot)
    robot = model.make_robot()
    mapping = Path(job.mapping) if job.mapping else None
    apart = {os.path.realpath(path) for path in job.hold_out}  # `bags/*` may name them, too
    bags = [path for path in job.bags if os.path.realpath(path) not in apart]
    fit = [r for path in bags for r in load(path, robot, mapping)]
    held = [r for path in job.hold_out for r in load(path, robot, mapping)]
    held += [r for r in fit if r.role == HELD_OUT]
    fit = [r for r in fit if r.role != HELD_OUT]
    if not fit:
        raise ParameterError("all recordings are held out; none is left to fit")
    if not held and len(fit) > 1:
        held = [fit.pop()]
    return model, fit, held


def options_of(job: Job) -> Any:
    """Settings of the workflow.

    Raises:
        LocoError: A value out of range, or a name that is not known.
    """
    from loco_control.params import from_dict
    from loco_learning.gap.params import GapParams

    for pattern in job.options.get("effects") or ():
        if not any(fnmatchcase(name, pattern) for name in effects.names()):
            raise NameUnknownError("effect", pattern, effects.names())
    return from_dict(GapParams, dict(job.options), "gap")


def find(
    job: Job, model: Model, fit: Sequence[Record], held: Sequence[Record], tell: Tell | None = None
) -> tuple[dict[str, Any], Curves]:
    """Run the workflow, then both models over every record."""
    from loco_learning.gap import workflow

    tell = tell or (lambda share, stage, best: None)
    params = options_of(job)
    result = plain(workflow.find(model, list(fit), list(held), params, tell, job.workers))
    tell(1.0, "page", "")
    return result, compare(result, model, fit, held)


def compare(result: Mapping, model: Model, fit: Sequence[Record], held: Sequence[Record]) -> Curves:
    """Both models over every record."""
    from loco_learning.gap.forward import Forward

    records, roles = [*fit, *held], [FIT] * len(fit) + [HELD_OUT] * len(held)
    before = Forward(model, records)
    floor = np.array([channel["floor"] for channel in result["gap"]["channels"]])
    if len(floor) != len(before.channels):
        floor = before.numeric
    return gap_curves.curves(before, Forward(patched(result), records), records, roles, floor)


def patched(result: Mapping[str, Any]) -> Model:
    """Model that was found."""
    m = result["model"]
    return Model(m["robot"], dict(m["overrides"]), [dict(e) for e in m["effects"]])


def run(job: Job, folder: Path, tell: Tell | None = None) -> dict[str, Any]:
    """All of it; writes `RESULT`, `MODEL`, `ARRAYS`, `PAGE` and `JOB` into the folder.

    Raises:
        LocoError: A mistake in what was given; nothing is written.
    """
    claim(folder)
    options_of(job)
    tell = tell or (lambda share, stage, best: None)
    tell(0.0, "reading", "")
    model, fit, held = read_records(job)
    result, curves = find(job, model, fit, held, tell)
    write(job, result, curves, folder)
    return result


def write(job: Job, result: Mapping[str, Any], curves: Curves, folder: Path) -> None:
    """Every file of the results."""
    from .gap_page import write_page

    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / RESULT, result)
    job.save(folder)
    beside(patched(result), folder).save(folder / MODEL)
    curves.save(folder / ARRAYS)
    write_page(result, curves, folder / PAGE)


def beside(model: Model, folder: Path) -> Model:
    """The model with the path of its robot as seen from a folder; names stay."""
    if not Path(model.robot).exists():
        return model
    return Model(os.path.relpath(model.robot, folder), model.overrides, model.effects)


def claim(folder: Path) -> None:
    """Refuse a folder that is a file or holds something else.

    Raises:
        ParameterError: It does.
    """
    if folder.exists() and not folder.is_dir():
        raise ParameterError(f"{folder} is a file, wanted is a folder")
    if folder.is_dir() and any(folder.iterdir()) and not (folder / JOB).is_file():
        raise ParameterError(f"{folder} holds other files; choose another --output")


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write JSON with sorted keys, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    part.write_text(dumps(values), encoding="utf-8")
    part.replace(path)


def dumps(values: Mapping[str, Any]) -> str:
    """Text of a JSON file with sorted keys."""
    return json.dumps(plain(values), sort_keys=True, indent=1, allow_nan=False) + "\n"
