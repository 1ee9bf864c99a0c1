# SPDX-License-Identifier: Apache-2.0
"""Case: one run of a study, and its result reduced to the data of tables and figures."""

from __future__ import annotations

import hashlib
import json
import time
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import to_dict

from .. import archive
from ..metrics import quantities, signals
from ..metrics import registry as metrics
from ..runs.experiment import Experiment, override
from ..runs.log import Log
from . import trial
from .grid import Axis
from .grid import settings as settings_of

COARSE = 10  # slow curves contain each tenth tick
FEET_SECONDS = 5.0  # length of the foot heights at the end of a run [s]
CLOCKED = "step_time"  # the metric that depends on the machine and differs between runs
REJECTED = "refused"  # failure of a case that the plant cannot run
TRACE = 3.0  # strides of joint angles from the end of each phase


@dataclass(frozen=True)
class Case:
    """One run of a study."""

    variant: str
    seed: int
    base: Experiment
    axes: tuple[Axis, ...] = ()
    point: tuple[int, ...] = ()
    text: str = ""  # the variant as JSON, if already computed

    @property
    def name(self) -> str:
        """Name of the case and of its file."""
        return "_".join([self.variant, *(f"{i:02d}" for i in self.point), str(self.seed)])

    @property
    def at(self) -> dict[str, Any]:
        """Position in the grid: value by axis."""
        return {axis.name: axis.values[i] for axis, i in zip(self.axes, self.point, strict=True)}

    @property
    def settings(self) -> dict[str, Any]:
        """Values of the grid, by dotted name."""
        return settings_of(self.axes, self.point)

    @cached_property
    def experiment(self) -> Experiment:
        """The variant with the settings of the grid."""
        return override(self.base, self.settings) if self.axes else self.base

    @property
    def key(self) -> str:
        """Digest of all inputs of the run."""
        text = self.text or json.dumps(to_dict(self.base))
        content = json.dumps([text, self.settings, self.seed])
        return hashlib.sha256(content.encode()).hexdigest()[:16]


@dataclass(frozen=True)
class CaseResult:
    """Verdict, metrics and curves of one run."""

    name: str
    variant: str
    seed: int
    experiment: dict[str, Any]
    verdict: dict[str, Any]
    metrics: dict[str, dict[str, float]]  # values by phase and name
    at: dict[str, Any] = field(default_factory=dict)  # position in a grid: value by axis
    key: str = ""  # digest of all inputs of the run
    seconds: float = float("nan")  # processor time without compilation [s]; not saved
    curves: dict[str, np.ndarray] = field(repr=False, default_factory=dict)

    def save(self, path: Path) -> None:
        """Write the reproducible data to one ``.npz`` file, completely or not at all."""
        meta = {k: v for k, v in vars(self).items() if k not in ("curves", "seconds")}
        archive.write(path, "case", meta, self.curves, compress=True)

    @classmethod
    def load(cls, path: Path) -> CaseResult:
        """Read a file of `save`.

        Raises:
            MissingFileError: The file does not exist.
            ParameterError: The file is not a case result of this version.
        """
        with archive.reading(path, "case") as (meta, curves):
            return cls(**meta, curves=curves)


def run_case(case: Case, curves: bool = True, timed: bool = False) -> CaseResult:
    """Run one case, in a worker process.

    Args:
        case: The case.
        curves: Whether to include curves for figures.
        timed: Whether to include `CLOCKED`.
    """
    from ..runs.rollout import rollout  # loads physics, in the worker
    from .compiling import compiling  # loads the compiler

    started = time.process_time()
    name, variant, seed, experiment = case.name, case.variant, case.seed, case.experiment
    try:
        with compiling() as compiled:
            result = reduce(rollout(experiment, seed), name, variant, curves, timed)
    except ParameterError as error:  # a grid point that cannot be run
        if not case.axes:
            raise
        verdict = trial.Verdict(False, [REJECTED], str(error), 0.0).as_dict()
        result = CaseResult(name, variant, seed, to_dict(experiment), verdict, {})
    seconds = time.process_time() - started - compiled.seconds
    return replace(result, at=case.at, key=case.key, seconds=seconds)


def reduce(
    log: Log, name: str, variant: str, curves: bool = True, timed: bool = False
) -> CaseResult:
    """Verdict, metrics and, if requested, curves and `CLOCKED` of a log."""
    parts = (_error, _feet, _cycle, _trunk, _traces) if curves else ()
    return CaseResult(
        name=name,
        variant=variant,
        seed=log.seed,
        experiment=json.loads(json.dumps(to_dict(log.experiment))),
        verdict=trial.judge(log).as_dict(),
        metrics={
            phase: {name: v for name, v in values.items() if timed or name != CLOCKED}
            for phase, values in metrics.table(log).items()
        },
        curves={key: values for part in parts for key, values in part(log).items()},
    )


def _error(log: Log) -> dict[str, np.ndarray]:
    """Smoothed NRMSE after standing, and the lag while the prediction drives."""
    moving = log.cut(slice(log.phase_of("stand").stop, None))
    if not log.experiment.learner.enabled or len(moving) < quantities.period(log):
        return {}
    target, prediction = quantities.target_and_prediction(moving)
    smooth = signals.smoothed_nrmse(target, prediction, quantities.period(log))
    curves = {"error_t": moving.t[::COARSE], "error": smooth[::COARSE]}
    course = trial.course(log)
    if course:
        curves |= {"lag_t": course.t[::COARSE], "lag": course.lag[::COARSE]}
    return curves


def _feet(log: Log) -> dict[str, np.ndarray]:
    """Heights of the front feet at the end of the run, target and command [m]."""
    if not log.has("target_feet"):
        return {}
    end = log.cut(slice(max(0, len(log) - round(FEET_SECONDS / log.dt)), None))
    ground = -abs(log.experiment.gait.origin[2])
    return {
        "feet_t": end.t,
        "feet_target": end.target_feet[:, :2, 2] - ground,
        "feet": quantities.feet(end, "command")[:, :2, 2] - ground,
    }


def _cycle(log: Log) -> dict[str, np.ndarray]:
    """Limit cycle of the test phase in the two principal components of the target [-]."""
    test = log.cut(log.phase_of("test"))
    if not log.experiment.learner.enabled or len(test) < quantities.period(log):
        return {}
    targets, commanded = quantities.outputs_wanted(test), quantities.outputs_commanded(test)
    target, actual = signals.limit_cycle(targets, commanded)
    return {"cycle_t": test.t, "cycle_target": target, "cycle": actual}


def _traces(log: Log) -> dict[str, np.ndarray]:
    """Commands and passive joints at the end of each phase, by its name."""
    width, passive = round(TRACE * quantities.period(log)), quantities.passive(log)
    if not len(passive):
        return {}
    curves = {}
    for phase, ticks in log.phases().items():
        rows = slice(max(ticks.start, ticks.stop - width), ticks.stop)
        key = phase.replace(" ", "_")
        curves[f"{key}_trace_t"] = log.t[rows]
        curves[f"{key}_trace_command"] = log.command[rows]
        curves[f"{key}_trace_passive"] = log.q[rows][:, passive]
    return curves


def _trunk(log: Log) -> dict[str, np.ndarray]:
    """Position and attitude of the base over the whole run."""
    angles = signals.roll_pitch_yaw(log.orientation)
    return {
        "trunk_t": log.t[::COARSE],
        "trunk_position": log.position[::COARSE],
        "trunk_angles": angles[::COARSE],
    }
