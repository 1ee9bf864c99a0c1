# SPDX-License-Identifier: Apache-2.0
"""One run of a study, reduced to what tables and figures need."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.params import to_dict

from . import archive, metrics, signals, trial
from .experiment import Experiment
from .log import Log

if TYPE_CHECKING:
    from .joint_experiment import JointExperiment

COARSE = 10  # slow curves keep each tenth tick
FEET_SECONDS = 5.0  # foot heights are kept for the end of a run [s]


@dataclass(frozen=True)
class CaseResult:
    """Verdict, metrics and curves of one run."""

    name: str
    variant: str
    seed: int
    experiment: dict[str, Any]
    verdict: dict[str, Any]
    metrics: dict[str, dict[str, float]]  # by phase and name
    real_time_factor: float
    curves: dict[str, np.ndarray] = field(repr=False, default_factory=dict)

    def save(self, path: Path) -> None:
        """Write to one ``.npz`` file, whole or not at all."""
        meta = {k: v for k, v in vars(self).items() if k != "curves"}
        archive.write(path, "case", meta, self.curves, compress=True)

    @classmethod
    def load(cls, path: Path) -> CaseResult:
        """Read what `save` wrote.

        Raises:
            MissingFileError: There is no such file.
            ParameterError: It is not a case result of this version.
        """
        meta, curves = archive.read(path, "case")
        return cls(**meta, curves=curves)


def run_case(
    name: str,
    variant: str,
    seed: int,
    experiment: Experiment | JointExperiment,
    folder: Path,
) -> CaseResult:
    """Run one case and write its result; the function that workers call."""
    make = _result if isinstance(experiment, Experiment) else _joint_result
    result = make(experiment, seed, name, variant)
    result.save(Path(folder) / f"{name}.npz")
    return result


def _result(experiment: Experiment, seed: int, name: str, variant: str) -> CaseResult:
    from .rollout import rollout  # loads physics, in the worker

    return reduce(rollout(experiment, seed), name, variant)


def _joint_result(experiment: JointExperiment, seed: int, name: str, variant: str) -> CaseResult:
    from .joint_case import reduce
    from .joint_rollout import rollout

    return reduce(rollout(experiment, seed), name, variant)


def reduce(log: Log, name: str, variant: str) -> CaseResult:
    """Verdict, metrics and curves of a log."""
    return CaseResult(
        name=name,
        variant=variant,
        seed=log.seed,
        experiment=json.loads(json.dumps(to_dict(log.experiment))),
        verdict=trial.judge(log).as_dict(),
        metrics=metrics.table(log),
        real_time_factor=len(log) * log.dt / log.wall_time,
        curves={**_error(log), **_feet(log), **_cycle(log), **_trunk(log)},
    )


def _error(log: Log) -> dict[str, np.ndarray]:
    """Smoothed NRMSE over the whole run, and the lag while the prediction drives."""
    trotting = log.cut(slice(log.phase("train").start, None))
    if not log.experiment.learner.enabled or len(trotting) < metrics.period(log):
        return {}
    target, prediction = metrics.target_and_prediction(trotting)
    smooth = signals.smoothed_nrmse(target, prediction, metrics.period(log))
    curves = {"error_t": trotting.t[::COARSE], "error": smooth[::COARSE]}
    found = trial.course(log)
    if found:
        curves |= {"lag_t": found.t[::COARSE], "lag": found.lag[::COARSE]}
    return curves


def _feet(log: Log) -> dict[str, np.ndarray]:
    """Heights of the front feet at the end of the run, wanted and commanded [m]."""
    end = log.cut(slice(max(0, len(log) - round(FEET_SECONDS / log.dt)), None))
    ground = -abs(log.experiment.gait.origin[2])
    height = metrics.feet(end.command.q)[:, :2, 2] - ground
    return {
        "feet_t": end.t,
        "feet_target": end.target.foot_position[:, :2, 2] - ground,
        "feet": height,
    }


def _cycle(log: Log) -> dict[str, np.ndarray]:
    """Limit cycle of the test phase in the two principal components of the target [-]."""
    test = log.cut(log.phase("test"))
    if not log.experiment.learner.enabled or len(test) < metrics.period(log):
        return {}
    target, actual = signals.limit_cycle(metrics.outputs_wanted(test), test.learning.prediction)
    return {"cycle_t": test.t, "cycle_target": target, "cycle": actual}


def _trunk(log: Log) -> dict[str, np.ndarray]:
    """Position and attitude of the trunk over the whole run."""
    angles = signals.roll_pitch_yaw(log.truth.orientation)
    return {
        "trunk_t": log.t[::COARSE],
        "trunk_position": log.truth.position[::COARSE],
        "trunk_angles": angles[::COARSE],
    }
