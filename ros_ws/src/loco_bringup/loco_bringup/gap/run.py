# SPDX-License-Identifier: Apache-2.0
"""`loco gap`: bags and a model in; where they differ, why, and the model without it out."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypedDict

from loco_control import reading
from loco_control.checks import check_file
from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.files import claim, write_whole
from loco_control.params import from_dict
from loco_learning.gap import workflow
from loco_learning.gap.localisation.curves import HELD_OUT, Curves
from loco_learning.gap.params import GapParams
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.setup.contents import SETUP
from loco_learning.plain import plain
from loco_sim import effects
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from .importing import load

RESULT, MODEL, PAGE, ARRAYS, JOB = "gap.json", "model.yaml", "gap.html", "gap.npz", "job.json"
JOURNAL = "search.jsonl"  # results of a search that is not done; it is gone afterwards



class JobFile(TypedDict):
    """Keys of `JOB`."""

    robot: str
    bags: list[str]
    hold_out: list[str]
    mapping: str
    options: dict[str, Any]


class Size(TypedDict):
    """Parameter of a term; None where a number is not known."""

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
    """Experiment that would tell effects apart."""

    experiment: str


class MoreOfProposal(Proposal, total=False):
    """A proposal with what it is good for."""

    odds: float | None
    separates: str | list[str]


class ResultFile(TypedDict):
    """Keys of `RESULT` that commands read from a folder."""

    verdict: str
    terms: list[Term]
    next: list[MoreOfProposal] | None


Tell = Callable[[float, str, str], None]  # share of the work done, stage, best name so far


@dataclass(frozen=True)
class Job:
    """Request for a search.

    Attributes:
        robot: Robot, robot.yaml or model.yaml, as given.
        bags: Recordings as given.
        hold_out: Recordings that judge the model and are never fitted.
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
    """Request that made a folder of results.

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
    """A file of a folder of results.

    Args:
        path: The file.
        keys: A `TypedDict` of its keys, for `checks.check`.

    Raises:
        MissingFileError: It is not there, or of another format.
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
    """Model, records to fit and records to judge on.

    Without `--hold-out` the last of several records is held out; a single one stays whole,
    and the workflow holds its end out.

    Raises:
        LocoError: Unknown robot, recordings that are not of use.
    """
    model = models.load_any(job.robot)
    robot = model.make_robot()
    mapping = Path(job.mapping) if job.mapping else None
    apart = {os.path.realpath(path) for path in job.hold_out}  # `bags/*` may name them, too
    bags = [path for path in job.bags if os.path.realpath(path) not in apart]
    judge = not options_of(job).setup  # else the workflow does
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
        LocoError: A value out of range, or a name that is not known.
    """
    params = from_dict(GapParams, dict(job.options), "gap")
    for pattern in params.effects:
        if not any(fnmatchcase(name, pattern) for name in effects.names()):
            raise NameUnknownError("effect", pattern, effects.names())
    return params


def patched(result: Mapping[str, Any]) -> Model:
    """Model that was found, with the learned correction if one holds."""
    m, learned = result["model"], result.get("residual") or {}
    listed = [*m["effects"], *learned.get("effects", ())]
    return Model(m["robot"], dict(m["overrides"]), [dict(e) for e in listed])


def run(job: Job, folder: Path, tell: Tell | None = None) -> dict[str, Any]:
    """Search, and write `RESULT`, `MODEL`, `JOB`, `ARRAYS` and `PAGE` into the folder.

    The first four are there as soon as the verdict is known, and again with all that is added
    to it: nothing that comes after the verdict can cost it. A search that was killed goes on
    from `JOURNAL` when the same is asked for again.

    Raises:
        LocoError: A mistake in what was given; nothing is written.
    """
    claim(folder, JOB, JOURNAL)
    params = options_of(job)
    tell = tell or (lambda share, stage, best: None)
    tell(0.0, "reading", "")
    model, fit, held = read_records(job)

    shown: list[Curves | None] = []

    def keep(result: Mapping[str, Any], curves: Curves | None) -> None:
        shown[:] = [curves]
        write_result(job, plain(result), folder)
        if curves:
            curves.save(folder / ARRAYS)
        else:
            (folder / ARRAYS).unlink(missing_ok=True)

    with workflow.memory_of(folder / JOURNAL, model, fit, held, params) as memory:
        found = workflow.find(model, fit, held, params, tell, job.workers, keep, memory)
        result = plain(found)
        keep(result, shown[0])
        tell(1.0, "page", "")
        if result["verdict"] == SETUP:
            write_whole(folder / PAGE, setup_page(result))
            return result
        write_page(result, shown[0], folder)
    return result


def write_result(job: Job, result: Mapping[str, Any], folder: Path) -> None:
    """Write the verdict, the patched model and what was asked for."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / RESULT, result)
    job.save(folder)
    beside(patched(result), folder).save(folder / MODEL)


def write_page(result: Mapping[str, Any], curves: Curves, folder: Path) -> None:
    """Write the page about a verdict and the curves that it rests on."""
    from . import page  # draws; the node `calibrator` uses the rest

    page.write_page(result, curves, folder / PAGE)


def setup_page(result: Mapping[str, Any]) -> str:
    """HTML text of the page of a set-up that has to be mended first."""
    from . import page

    return page.setup_page(result)


def beside(model: Model, folder: Path) -> Model:
    """The model with the path of its robot as seen from a folder; names stay."""
    if not Path(model.robot).exists():
        return model
    return Model(os.path.relpath(model.robot, folder), model.overrides, model.effects)


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write JSON with sorted keys, whole or not at all."""
    write_whole(path, dumps(values))


def dumps(values: Mapping[str, Any]) -> str:
    """Text of a JSON file with sorted keys."""
    return json.dumps(plain(values), sort_keys=True, indent=1, allow_nan=False) + "\n"
