# SPDX-License-Identifier: Apache-2.0
"""One run of a joint robot in a study, reduced to what tables and figures need."""

from __future__ import annotations

import json

import numpy as np

from loco_control.params import to_dict

from . import joint_metrics as metrics
from . import signals, trial
from .case import COARSE, CaseResult
from .joint_log import JointLog
from .joint_reflex import passive_joints

TRACE = 3.0  # strides of joint angles kept from the end of each phase


def reduce(log: JointLog, name: str, variant: str) -> CaseResult:
    """Verdict, metrics and curves of a log."""
    return CaseResult(
        name=name,
        variant=variant,
        seed=log.seed,
        experiment=json.loads(json.dumps(to_dict(log.experiment))),
        verdict=metrics.judge(log).as_dict(),
        metrics=metrics.table(log),
        real_time_factor=len(log) * log.dt / log.wall_time,
        curves={**_error(log), **_cycle(log), **_trunk(log), **_traces(log)},
    )


def _error(log: JointLog) -> dict[str, np.ndarray]:
    """Smoothed NRMSE after standing, and the lag while the prediction drives."""
    moving = log.cut(slice(metrics.phases(log).get("stand", slice(0, 0)).stop, None))
    if not log.experiment.learner.enabled or len(moving) < metrics.period(log):
        return {}
    smooth = signals.smoothed_nrmse(moving.target, moving.prediction, metrics.period(log))
    curves = {"error_t": moving.t[::COARSE], "error": smooth[::COARSE]}
    found: trial.Course | None = metrics.course(log)
    if found:
        curves |= {"lag_t": found.t[::COARSE], "lag": found.lag[::COARSE]}
    return curves


def _cycle(log: JointLog) -> dict[str, np.ndarray]:
    """Limit cycle of the test phase in the two principal components of the target [-]."""
    test = log.cut(metrics.phases(log).get("test", slice(0, 0)))
    if len(test) < metrics.period(log):
        return {}
    target = np.concatenate((test.target, test.target_dq), axis=1)
    command = np.concatenate((test.command, test.command_dq), axis=1)
    target, actual = signals.limit_cycle(target, command)
    return {"cycle_t": test.t, "cycle_target": target, "cycle": actual}


def _trunk(log: JointLog) -> dict[str, np.ndarray]:
    """Position and attitude of the base over the whole run."""
    return {
        "trunk_t": log.t[::COARSE],
        "trunk_position": log.position[::COARSE],
        "trunk_angles": signals.roll_pitch_yaw(log.orientation)[::COARSE],
    }


def _traces(log: JointLog) -> dict[str, np.ndarray]:
    """Commands and passive joints at the end of each phase, by its name."""
    width, passive = round(TRACE * metrics.period(log)), passive_joints(log.experiment.plant)
    curves = {}
    for phase, ticks in metrics.phases(log).items():
        rows = slice(max(ticks.start, ticks.stop - width), ticks.stop)
        key = phase.replace(" ", "_")
        curves[f"{key}_trace_t"] = log.t[rows]
        curves[f"{key}_trace_command"] = log.command[rows]
        curves[f"{key}_trace_passive"] = log.q[rows][:, passive]
    return curves
