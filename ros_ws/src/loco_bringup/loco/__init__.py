# SPDX-License-Identifier: Apache-2.0
"""loco in a notebook or a script: bags, robots, rollouts, gaps and reports, without ROS.

For example:

    import loco

    found = loco.find_gap(["logs/swing.csv"], "robots/my_leg", hold_out=["logs/chirp.csv"])
    print(found)                          # what the model lacks, where, and how much of it
    log = loco.rollout("tigrillo_walk", {"robot": found.model_file, "duration": 5.0})
    log.q                                 # joint angles [rad], (T, n)

Invalid input raises a `LocoError` whose message says what to do.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Annotated, Any

from loco_bringup import __version__
from loco_bringup.bag.reader import Bag
from loco_control.checks import Between, Naming, checked
from loco_control.exceptions import LocoError, ParameterError
from loco_control.reading import shown
from loco_learning.runs.experiment import Experiment
from loco_learning.runs.experiment import load as load_experiment
from loco_learning.runs.log import Log
from loco_sim import lazy
from loco_sim.plant.model import Model, load_any
from loco_sim.robot.robot import Robot

# Compiled kernels and figures take seconds to load, so modules are imported on first use.
_gap = lazy.module("loco_bringup.gap.run")
_plots = lazy.module("loco_bringup.gap.plots")
_text = lazy.module("loco_bringup.gap.text")
_export = lazy.module("loco_bringup.export_model.write")
_report = lazy.module("loco_bringup.report.report")
_rollout = lazy.module("loco_learning.runs.rollout")

Place = Annotated[str | Path, Naming()]  # name of a robot or experiment, or a path
Seed = Annotated[int, Between(0, 2**63 - 1)]
Workers = Annotated[int, Between(1, 1024)]

__all__ = [
    "Bag", "Experiment", "Gap", "Log", "LocoError", "Model", "Page", "Robot", "__version__",
    "export_model", "find_gap", "load_bag", "report", "robot", "rollout",
]  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Page:
    """An HTML page on disk; a notebook displays it inline.

    Attributes:
        path: The file.
    """

    path: Path

    def __str__(self) -> str:
        return str(self.path)

    def __fspath__(self) -> str:
        return str(self.path)

    def _repr_html_(self) -> str:
        text = escape(self.path.read_text(encoding="utf-8"), quote=True)
        return f'<iframe srcdoc="{text}" style="width: 100%; height: 40em; border: 0"></iframe>'


@dataclasses.dataclass(frozen=True)
class Gap:
    """Result of `find_gap`: the effects that a model lacks, as text or, in a notebook, with curves.

    Attributes:
        folder: Folder of all results.
        result: Contents of ``gap.json``.
    """

    folder: Path
    result: Mapping[str, Any] = dataclasses.field(repr=False)

    @property
    def verdict(self) -> str:
        """``named``, ``ambiguous``, ``unknown`` or ``no gap``."""
        return self.result["verdict"]

    @property
    def terms(self) -> list[dict[str, Any]]:
        """Added effects: name, place, parameters with intervals and units, probability."""
        return list(self.result.get("terms") or ())

    @property
    def model(self) -> Model:
        """The model with the added effects."""
        return _gap.patched(self.result)

    @property
    def model_file(self) -> Path:
        """File of `model`, usable as ``robot:`` in experiments and as argument of the commands."""
        return self.folder / _gap.MODEL

    @property
    def page(self) -> Page:
        """HTML page about the result."""
        return Page(self.folder / _gap.PAGE)

    def __str__(self) -> str:
        return _text.summary(self.result)

    def _repr_html_(self) -> str:
        return _plots.notebook(self.folder / _gap.ARRAYS, self.result)


@checked
def load_bag(path: Place) -> Bag:
    """Open a rosbag2 bag (MCAP) for reading; the message packages need not be installed.

    ``bag.records("joint_states")`` gives a topic as a NumPy record array,
    ``bag.messages("events")`` as objects.

    Args:
        path: Folder of the bag, or its ``.mcap`` file.

    Raises:
        MissingFileError: There is no such bag.
        BagError: The bag is damaged.
    """
    return Bag(path)


@checked
def robot(name_or_path: Place) -> Robot:
    """Read a robot: its joints, limits, drives, springs and masses, checked against its URDF.

    Args:
        name_or_path: Name of a robot of loco, a folder with a ``robot.yaml``, or a ``model.yaml``.

    Raises:
        LocoError: There is no such robot, or its files do not fit together.
    """
    return load_any(name_or_path).make_robot()


@checked
def rollout(
    experiment: Place | Experiment,
    overrides: Mapping[str, Any] | None = None,
    *,
    seed: Seed | None = None,
    on_progress: Callable[[float], Any] | None = None,
) -> Log:
    """Simulate an experiment in this process, as fast as possible.

    Args:
        experiment: Name of an experiment of loco, path of a YAML file, or an experiment.
        overrides: Values by dotted name, such as ``{"duration": 2.0, "gait.speed": 0.3}``; only
            allowed if `experiment` is a name or a path.
        seed: Seed that replaces the seed of the experiment.
        on_progress: Called with the simulated time [s] after each tick.

    Returns:
        Columns over ticks: ``log.t`` [s], ``log.q`` [rad], ``log.tau`` [N·m] and more.

    Raises:
        LocoError: There is no such experiment, or a value is wrong.
    """
    if isinstance(experiment, Experiment) and overrides:
        raise ParameterError(
            f"overrides must be left out where experiment is an object, got {shown(overrides)}; "
            "take experiment.replace(...)"
        )
    if not isinstance(experiment, Experiment):
        values = {k: str(v) if isinstance(v, Path) else v for k, v in (overrides or {}).items()}
        experiment = load_experiment(experiment, values)
    on_tick = None if on_progress is None else lambda tick, loop: on_progress(tick * experiment.dt)
    return _rollout.rollout(experiment, seed, on_tick)


@checked
def find_gap(
    recordings: Sequence[Place] | Place,
    robot: Place,
    *,
    hold_out: Sequence[Place] = (),
    mapping: Place | None = None,
    out: Place | None = None,
    workers: Workers = 2,
    on_progress: Callable[[float, str, str], Any] | None = None,
    **options: Any,
) -> Gap:
    """Find where a model and recordings differ, name the cause, and add it to the model.

    Args:
        recordings: Bags, or tables (CSV, JSON).
        robot: Name of a robot, a folder with a ``robot.yaml``, a ``model.yaml``, or a URDF, of
            which a draft is written to ``drafts`` in `out`.
        hold_out: Held-out recordings: they validate the model and are never fitted; default the
            last recording.
        mapping: File with the role and unit of each column; default ``mapping.yaml`` beside the
            recording, else a draft in ``drafts`` in `out`.
        out: Folder of the results; default below ``results``.
        workers: Number of processes; the result does not depend on it.
        on_progress: Called with the share of the work done, the stage, and the name of the best
            candidate so far.
        options: Values of ``loco gap --set``, such as ``effects=["*_friction"]`` or ``seed=3``.

    Raises:
        LocoError: A recording, the robot or an option is invalid.
    """
    bags = [recordings] if isinstance(recordings, (str, Path)) else recordings
    if not bags:
        raise ParameterError("recordings must be one or more, got none")
    job = _gap.Job(
        str(robot), tuple(map(str, bags)), tuple(map(str, hold_out)), str(mapping or ""), options,
        workers,
    )  # fmt: skip
    folder = Path(out) if out is not None else job.default_folder()
    return Gap(folder, _gap.run(job, folder, on_progress))


@checked
def export_model(
    model: Place | Gap,
    to: str,
    out: Place | None = None,
    *,
    replay: Sequence[Place] = (),
    mapping: Place | None = None,
    gear: str | None = None,
) -> Any:
    """Write a model for another simulator; ``.lost`` of the result lists what is not exported.

    Args:
        model: Result of `find_gap`, its folder, a ``model.yaml`` or a robot.
        to: ``mjcf``, ``urdf``, ``isaac``, ``pace`` or ``ros2_control``.
        out: Folder; default below ``results``.
        replay: Recordings to replay in MuJoCo without loco, for ``.compared``; default the
            held-out ones.
        mapping: Mapping of the recordings.
        gear: Gears of servos in MJCF: ``elastic``, the default, with a joint for each rotor, or
            ``rigid``, with the robot's joints alone.

    Raises:
        LocoError: There is no such model, target or gear, or a recording is invalid.
    """
    source = model.folder if isinstance(model, Gap) else model
    return _export.export_model(source, to, out, replay, mapping, gear)


@checked
def report(bag: Place | Bag, out: Place | None = None, *, gif: bool = True) -> Page:
    """Write one self-contained HTML page about a recorded run: gait, forces, metrics, animation.

    A recording of another program gives a page on its joints.

    Args:
        bag: Bag, or file of a table.
        out: HTML file, or its folder; default ``report.html`` in the folder of the bag.
        gif: Draw the animation, which takes most of the time.

    Raises:
        LocoError: The recording cannot be read, or the page cannot be written.
    """
    return Page(_report.write_report(bag, out, gif))
