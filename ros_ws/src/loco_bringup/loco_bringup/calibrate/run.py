# SPDX-License-Identifier: Apache-2.0
"""`loco calibrate`: fit a model to bags; write the model, tables, figures and a page."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from loco_control.exceptions import MissingFileError, ParameterError
from loco_control.files import check_writable, write_whole
from loco_control.params import to_dict
from loco_control.reading import read_json
from loco_learning.calibration import figures, results
from loco_learning.calibration.fit import Calibration
from loco_learning.calibration.objective import Reference
from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.progress import Fit, Generation
from loco_learning.calibration.recording import Recording
from loco_learning.drawing import png
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from ..bag.foreign.opening import open_bag
from .bag import read_recording
from .page import page

log = logging.getLogger(__name__)

SETTINGS = "settings.json"
FORMAT = 1
VALIDATION_SKIP = 4.0  # start-up of a gait, left out of the comparison [s]
ALL_PERIODS = 1e6  # settling periods: all that precede the first compared period

OnGeneration = Callable[[int, Generation], None]  # arguments: seed, state of its search


@dataclass(frozen=True)
class Job:
    """A calibration whose input is read and checked.

    Attributes:
        robot: Name or path as given.
        recording: Recording to fit.
        validation: Recordings for comparison only, not fitted.
        options: Settings; the seed is that of the first search.
        seeds: Seeds of the searches.
        folder: Folder of the results.
        surrogate: Whether a recording is of a simulated robot.
        workers: Number of processes that evaluate.
        scheduler: Address of a dask cluster to use instead of processes; empty for none.
    """

    robot: str
    recording: Recording
    validation: tuple[Recording, ...]
    options: CalibrationParams
    seeds: tuple[int, ...]
    folder: Path
    surrogate: bool
    workers: int = 2
    scheduler: str = ""


def prepare(
    bag: str | Path,
    robot: str = "tigrillo",
    options: CalibrationParams | None = None,
    validate: Sequence[str | Path] = (),
    seeds: int = 5,
    folder: str | Path | None = None,
    workers: int = 2,
    scheduler: str = "",
) -> Job:
    """Read and check all input; nothing is written.

    Raises:
        LocoError: The robot is unknown, a bag is not usable, or the folder holds other results.
    """
    for what, value, minimum in (("seeds", seeds, 1), ("workers", workers, 0)):
        if value < minimum:
            raise ParameterError(f"{what} must be at least {minimum}, got {value}")
    options = options or CalibrationParams()
    base = models.load_any(robot)
    measured = base.make_robot()
    bags = [open_bag(path) for path in (bag, *validate)]
    recordings = [read_recording(each, measured.control_rate, measured) for each in bags]
    for recording, recording_options in zip(
        recordings, _options(options, len(recordings)), strict=True
    ):
        Reference(recording, base, recording_options).check()
    folder = Path(folder or Path("results") / f"calibration_{recordings[0].name}")
    job = Job(
        str(robot), recordings[0], tuple(recordings[1:]), options,
        tuple(range(options.seed, options.seed + seeds)), folder,
        any("experiment.yaml" in each.attachments() for each in bags), workers, scheduler,
    )  # fmt: skip
    _check_folder(job)
    check_writable(folder)
    return job


def calibrate(job: Job, on_progress: OnGeneration | None = None) -> results.Result:
    """Search with every seed, compare the best model with all recordings, write the results."""
    settings = json.dumps({"format": FORMAT, **_fingerprint(job)}) + "\n"
    write_whole(job.folder / SETTINGS, settings)
    fits = [search(job, seed, on_progress) for seed in job.seeds]
    best = min(fits, key=lambda fit: fit.error)
    reference = Reference(job.recording, models.load_any(job.robot), job.options)
    model = reference.with_body(best.values)
    result = results.Result(
        job.robot, job.surrogate, to_dict(job.options), tuple(reference.joints), tuple(fits),
        tuple(compare(job, model)),
    )  # fmt: skip
    write(result, model, job.folder)
    return result


def search(job: Job, seed: int, on_progress: OnGeneration | None) -> Fit:
    """One search; evaluations that its folder records are not repeated."""
    calibration = Calibration(job.recording, job.robot, job.options.replace(seed=seed))
    return calibration.run(
        lambda generation: on_progress(seed, generation) if on_progress else None,
        job.folder / f"seed_{seed}",
        job.workers,
        job.scheduler,
    )


def compare(job: Job, model: Model) -> list[results.Comparison]:
    """Default and calibrated model compared with every recording, over all its periods."""
    rows, base = [], models.load_any(job.robot)
    recordings = (job.recording, *job.validation)
    for recording, options in zip(recordings, _options(job.options, len(recordings)), strict=True):
        reference = Reference(recording, base, options)
        before = reference.evaluate(parameter_set(options.parameters).default)
        after = reference.compare(model)
        rows.append(results.comparison(recording.name, not rows, before, after))
    return rows


def write(result: results.Result, model: Model, folder: Path) -> None:
    """Write model, result, tables, figures and page."""
    for name, draw in figures.FIGURES.items():
        png.write(draw(result), folder / f"{name}.png")
    text = "\n".join(
        results.markdown(*figure)
        for figure in (
            results.body_table(result), results.recording_table(result), results.seed_table(result)
        )
    )  # fmt: skip
    write_whole(folder / "tables.md", text)
    model.save(folder / "model.yaml")
    write_whole(folder / "calibration.html", page(result, model))
    result.save(folder)


def _options(options: CalibrationParams, count: int) -> list[CalibrationParams]:
    """Settings of the fitted recording, then of the `count - 1` validation recordings.

    Validation uses the whole recording.
    """
    long_options = options.replace(settle=ALL_PERIODS, skip=VALIDATION_SKIP, periods=0)
    return [options, *[long_options] * (count - 1)]


# ---- folder of the results


def _fingerprint(job: Job) -> dict:
    digest = hashlib.sha256()
    for array in (job.recording.t, job.recording.command, job.recording.q):
        digest.update(array.tobytes())
    options = job.options.deciding()
    return {"robot": job.robot, "recording": digest.hexdigest(), "options": options}


def _check_folder(job: Job) -> None:
    """Check that the folder is new or holds results of the same calibration.

    Raises:
        ParameterError: The folder holds another calibration.
        MissingFileError: The path is a file.
    """
    if job.folder.exists() and not job.folder.is_dir():
        raise MissingFileError(f"{job.folder} is a file, wanted is a folder")
    path = job.folder / SETTINGS
    if not path.is_file():
        return
    recorded = read_json(path)
    if not isinstance(recorded, dict) or "format" not in recorded:
        raise ParameterError(f"{path} is not the settings of a calibration (it has no format)")
    version = recorded.pop("format")
    if version != FORMAT:
        raise ParameterError(
            f"{path} is of format {version}, this version reads {FORMAT}; choose another folder"
        )
    fingerprint = _fingerprint(job)
    for key, value in fingerprint.items():
        if recorded.get(key) != value:
            raise ParameterError(
                f"{job.folder} holds a calibration with another {key}; choose another --out"
            )
