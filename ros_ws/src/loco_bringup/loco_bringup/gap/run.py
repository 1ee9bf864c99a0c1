# SPDX-License-Identifier: Apache-2.0
"""`loco gap`: compare bags with a model, find the cause of the gap, write the mended model."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypedDict

from loco_control import reading
from loco_control.checks import check_file
from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.files import claim, write_whole
from loco_control.params import from_dict
from loco_learning.gap import workflow
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.localisation.curves import HELD_OUT, Curves
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.setup.contents import SETUP
from loco_learning.plain import plain
from loco_sim import effects
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from .importing import DRAFTS, drafted, load

RESULT, MODEL, PAGE, ARRAYS, JOB = "gap.json", "model.yaml", "gap.html", "gap.npz", "job.json"
JOURNAL = "search.jsonl"  # results of an unfinished search; deleted at its end


class JobFile(TypedDict):
    """Keys of `JOB`."""

    robot: str
    bags: list[str]
    hold_out: list[str]
    mapping: str
    options: dict[str, Any]


class Size(TypedDict):
    """Parameter of a term; None if a number is unknown."""

    value: float | None
    low: float | None
    high: float | None
    unit: str


class Term(TypedDict):
    """Effect that was added to the model."""

    effect: str
    place: str | list[str] | None
    parameters: dict[str, Size]


class Proposal(TypedDict):
    """Proposed experiment that distinguishes effects."""

    experiment: str


class MoreOfProposal(Proposal, total=False):
    """A proposal with its expected benefit."""

    odds: float | None
    separates: str | list[str]


class ResultFile(TypedDict):
    """Keys of `RESULT` that commands read from a folder."""

    verdict: str
    terms: list[Term]
    next: list[MoreOfProposal] | None


Report = Callable[[float, str, str], None]  # share of the work done, stage, best candidate so far


@dataclass(frozen=True)
class Job:
    """Request for a search.

    Attributes:
        robot: Robot, robot.yaml, model.yaml or URDF, as on the command line.
        bags: Recordings, as on the command line.
        hold_out: Held-out recordings: they validate the model and are never fitted.
        mapping: Path of a mapping file; empty for recordings of standard topics.
        options: Values of `GapParams` that differ from their defaults.
        workers: Number of processes, or address of a dask scheduler.
    """

    robot: str
    bags: tuple[str, ...]
    hold_out: tuple[str, ...] = ()
    mapping: str = ""
    options: dict[str, Any] = field(default_factory=dict)
    workers: int | str = 2

    def default_folder(self) -> Path:
        """Default folder of the results."""
        return Path("results") / f"gap_{Path(self.bags[0]).name.split('.')[0]}"

    def save(self, folder: Path) -> None:
        """Write the request to a file that `load_job` reads."""
        values = {k: getattr(self, k) for k in ("robot", "bags", "hold_out", "mapping", "options")}
        write_json(folder / JOB, {"format": 1, **values})


def load_job(folder: str | Path) -> Job:
    """Request that a folder of results belongs to.

    Raises:
        MissingFileError: The folder holds no results of `loco gap`.
        ParameterError: A value in the file is wrong.
    """
    path = Path(folder) / JOB
    values = read_json(path, JobFile)
    if not values["bags"]:
        raise ParameterError(f"{path}: bags must name one recording or more, got []")
    return Job(
        values["robot"], tuple(values["bags"]), tuple(values["hold_out"]), values["mapping"],
        values["options"],
    )  # fmt: skip


def read_json(path: Path, keys: Any) -> dict[str, Any]:
    """Contents of a JSON file in a folder of results.

    Args:
        path: The file.
        keys: A `TypedDict` of its keys, for `checks.check`.

    Raises:
        MissingFileError: The file does not exist or has another format version.
        ParameterError: The file is not JSON, or a value in it is wrong.
    """
    if not path.is_file():
        raise MissingFileError(
            f"{path.parent} holds no {path.name}; make it with `loco gap BAG... --out "
            f"{path.parent}`"
        )
    values = reading.read_json(path)
    if not isinstance(values, dict) or values.get("format") != 1:
        raise MissingFileError(f"{path} is not of format 1, which this version reads")
    check_file(values, keys, path)
    return values


def read_records(job: Job) -> tuple[Model, list[Record], list[Record]]:
    """Model, records to fit and held-out records.

    Without `--hold-out` the last of several records is held out. A single record is returned
    whole; the workflow then holds out its last part.

    Raises:
        LocoError: The robot is unknown, or a recording is not usable.
    """
    model = models.load_any(job.robot)
    robot = model.make_robot()
    mapping = Path(job.mapping) if job.mapping else None
    held_out = {os.path.realpath(path) for path in job.hold_out}  # `bags/*` may include them
    bags = [path for path in job.bags if os.path.realpath(path) not in held_out]
    judge = not options_of(job).setup  # else the workflow checks them
    fit = [r for path in bags for r in load(path, robot, mapping, judge)]
    held = [r for path in job.hold_out for r in load(path, robot, mapping, judge)]
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
        LocoError: A value is out of range, or a name is unknown.
    """
    params = from_dict(GapParams, dict(job.options), "gap")
    for pattern in params.effects:
        if not any(fnmatchcase(name, pattern) for name in effects.names()):
            raise NameUnknownError("effect", pattern, effects.names())
    return params


def patched(result: Mapping[str, Any]) -> Model:
    """Resulting model, with the learned correction if it is valid."""
    m, learned = result["model"], result.get("residual") or {}
    listed = [*m["effects"], *learned.get("effects", ())]
    return Model(m["robot"], dict(m["overrides"]), [dict(e) for e in listed])


def run(job: Job, folder: Path, report: Report | None = None) -> dict[str, Any]:
    """Search, and write `RESULT`, `MODEL`, `JOB`, `ARRAYS` and `PAGE` to the folder.

    The first four are written as soon as the verdict is known, and again when further results
    are added, so that a later failure cannot lose the verdict. A search that was killed resumes
    from `JOURNAL` when the same request is run again.

    Raises:
        LocoError: The input is invalid; nothing is written but drafts of a robot and a mapping.
    """
    claim(folder, JOB, JOURNAL, *DRAFTS)
    params = options_of(job)
    report = report or (lambda share, stage, best: None)
    report(0.0, "reading", "")
    robot, mapping, notes = drafted(job.robot, job.bags, job.mapping, folder)
    hint = f"; {mapping} is a draft: correct it" if mapping and not job.mapping else ""
    job = replace(job, robot=robot, mapping=mapping)
    try:
        model, fit, held = read_records(job)
    except ParameterError as error:
        raise ParameterError(f"{error}{hint}") from None
    fit[0] = replace(fit[0], notes=(*notes, *fit[0].notes))

    latest: list[Curves | None] = []

    def keep(result: Mapping[str, Any], curves: Curves | None) -> None:
        latest[:] = [curves]
        write_result(job, plain(result), folder)
        if curves:
            curves.save(folder / ARRAYS)
        else:
            (folder / ARRAYS).unlink(missing_ok=True)

    with workflow.memory_of(folder / JOURNAL, model, fit, held, params) as memory:
        outcome = workflow.find(model, fit, held, params, report, job.workers, keep, memory)
        result = plain(outcome)
        keep(result, latest[0])
        report(1.0, "page", "")
        from . import page  # needs plotting, which the node `calibrator` does not

        ends_early = result["verdict"] == SETUP
        text = page.setup_page(result) if ends_early else page.page(result, latest[0])
        write_whole(folder / PAGE, text)
    return result


def write_result(job: Job, result: Mapping[str, Any], folder: Path) -> None:
    """Write the verdict, the patched model and the request."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / RESULT, result)
    job.save(folder)
    relocated(patched(result), folder).save(folder / MODEL)


def relocated(model: Model, folder: Path) -> Model:
    """The model with the path of its robot relative to a folder; a robot's name is kept."""
    if not Path(model.robot).exists():
        return model
    return Model(os.path.relpath(model.robot, folder), model.overrides, model.effects)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write JSON with sorted keys; after an error no incomplete file remains."""
    write_whole(path, dumps(values))


def dumps(values: Mapping[str, Any]) -> str:
    """Text of a JSON file with sorted keys."""
    return json.dumps(plain(values), sort_keys=True, indent=1, allow_nan=False) + "\n"
