# SPDX-License-Identifier: Apache-2.0
"""Every metric of a joint robot's run by name, and the verdict on it.

The same arithmetic as for HyQ (`signals`, `trial`), on the columns of a `JointLog`.
Distances count along the heading at the start of the interval, so that a robot that
turned before does not lose them.
"""

from __future__ import annotations

import numpy as np

from loco_sim.description import Description

from . import signals, trial
from .joint_log import JointLog
from .joint_reflex import PHASES, passive_joints
from .metrics import Metric, metric
from .schedule import CLOSING

OPEN = "open loop"  # name of the one phase of a run without a learner
METRICS: dict[str, Metric] = {}


def of(unit: str, equation: str, learner: bool = False):
    """Register a function of a joint log; the docstring says what it is."""
    return metric(unit, equation, learner, METRICS)


def phases(log: JointLog) -> dict[str, slice]:
    """Ticks of the phases that were reached; without a learner all is one."""
    if not log.experiment.learner.enabled:
        return {OPEN: slice(0, len(log))}
    found = {}
    for index, name in enumerate(PHASES):
        ticks = np.flatnonzero(log.phase == index)
        if len(ticks):
            found[name] = slice(int(ticks[0]), int(ticks[-1]) + 1)
    return found


def table(log: JointLog) -> dict[str, dict[str, float]]:
    """All metrics of each phase but stand, by phase and name."""
    return {
        phase: {name: each(log, ticks) for name, each in METRICS.items()}
        for phase, ticks in phases(log).items()
        if phase != "stand"
    }


def period(log: JointLog) -> int:
    """Ticks of one stride of the target, at least 1."""
    return max(1, round(1.0 / (log.experiment.target.frequency * log.dt)))


def stride_angle(log: JointLog) -> np.ndarray:
    """Stride phase of the target [strides], (T,)."""
    return log.experiment.target.frequency * log.t


def progress(log: JointLog) -> np.ndarray:
    """Displacement along and across the heading at the first tick [m], (T, 2)."""
    yaw = signals.roll_pitch_yaw(log.orientation[:1])[0, 2]
    x, y = (log.position[:, :2] - log.position[0, :2]).T
    return np.stack([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x], axis=1)


def heading_speed(log: JointLog) -> np.ndarray:
    """Speed of the base along its heading [m/s], (T,)."""
    yaw = signals.roll_pitch_yaw(log.orientation)[:, 2]
    if len(log) < 2:
        return np.full(len(log), np.nan)
    dx, dy = (np.gradient(log.position[:, i]) / log.dt for i in (0, 1))
    return np.cos(yaw) * dx + np.sin(yaw) * dy


def mass(log: JointLog) -> float:
    """Mass of the robot [kg]."""
    return Description(log.experiment.plant.urdf).mass()


def judge(log: JointLog) -> trial.Verdict:
    """Hold a run against the failure criterion of its experiment."""
    found = course(log)
    end = float(log.t[-1]) if len(log) else 0.0
    numbers = _numbers(log, found) if found else {}
    return trial.verdict(log.experiment.criterion, log.fall, end, numbers)


def course(log: JointLog) -> trial.Course | None:
    """How the readout kept up while it drove; None if it did for less than two strides."""
    log = driven_part(log)
    stride = period(log)
    if len(log) < 2 * stride:
        return None
    wanted = np.nanmedian(signals.stride_amplitude(log.target, 2 * stride))
    return trial.Course(
        log.t,
        signals.smoothed_nrmse(log.target, log.prediction, stride),
        lag(log),
        signals.stride_amplitude(log.prediction, 2 * stride) / wanted,
    )


def driven_part(log: JointLog) -> JointLog:
    """The ticks at which the readout drives."""
    if not log.experiment.learner.enabled:
        return log.cut(slice(0, 0))
    return log.cut(slice(int(np.searchsorted(log.phase, CLOSING)), None))


def lag(log: JointLog) -> np.ndarray:
    """How far the prediction is behind the target [strides], (T,)."""
    return signals.phase_lag(log.target, log.prediction, stride_angle(log), period(log))


def _numbers(log: JointLog, found: trial.Course) -> dict[str, float]:
    tail = driven_part(log)
    tail = tail.cut(slice(max(0, len(tail) - round(trial.TAIL / log.dt)), None))
    return {
        "nrmse": float(np.max(found.nrmse)),
        "amplitude": float(np.nanmin(found.amplitude)),
        "slip": float(np.max(np.abs(found.lag))),
        "lag": float(found.lag[-1]),
        "frequency": signals.stride_frequency(tail.prediction, log.dt),
        "target_frequency": signals.stride_frequency(tail.target, log.dt),
    }


# ---- behaviour, thesis section 3.6.2 ---------------------------------------------------


@of("m", "ours")
def distance(log: JointLog) -> float:
    """Displacement along the heading at the start of the phase."""
    return float(progress(log)[-1, 0])


@of("m/s", "3.30")
def speed(log: JointLog) -> float:
    """Distance over time."""
    return signals.mean_speed(progress(log)[:, 0], log.dt)


@of("m/s", "ours")
def forward_speed(log: JointLog) -> float:
    """Mean speed along the heading of the moment: that of a robot that may turn."""
    return float(np.mean(heading_speed(log)))


@of("m", "ours")
def lateral_drift(log: JointLog) -> float:
    """Displacement across the heading at the start of the phase; left is positive."""
    return float(progress(log)[-1, 1])


@of("rad", "ours")
def heading_drift(log: JointLog) -> float:
    """Yaw at the end minus yaw at the start."""
    yaw = signals.roll_pitch_yaw(log.orientation)[:, 2]
    return float(yaw[-1] - yaw[0])


@of("m", "3.27")
def stability(log: JointLog) -> float:
    """Range of the height of the base; lower is steadier."""
    return signals.excursion(log.position[:, 2])


@of("rad", "ours")
def roll_range(log: JointLog) -> float:
    """Range of the roll of the base."""
    return signals.excursion(signals.roll_pitch_yaw(log.orientation)[:, 0])


@of("rad", "ours")
def pitch_range(log: JointLog) -> float:
    """Range of the pitch of the base."""
    return signals.excursion(signals.roll_pitch_yaw(log.orientation)[:, 1])


@of("W", "3.28")
def power(log: JointLog) -> float:
    """Mean mechanical power of the drives, negative work counted against it."""
    return signals.mechanical_power(*_drives(log))


@of("W", "ours")
def positive_power(log: JointLog) -> float:
    """Mean mechanical power of the drives, negative work lost."""
    return signals.positive_power(*_drives(log))


@of("-", "3.31")
def cost_of_transport(log: JointLog) -> float:
    """Positive power over m g V, V the forward speed; a servo gives no work back."""
    return signals.cost_of_transport(positive_power(log), forward_speed(log), mass(log))


@of("N·m", "ours")
def torque_max(log: JointLog) -> float:
    """Largest torque of a drive, mean over a control period."""
    return float(np.max(np.abs(_drives(log)[1])))


@of("rad", "ours")
def passive_range(log: JointLog) -> float:
    """Range of the passive joints, mean over them."""
    passive = passive_joints(log.experiment.plant)
    return float(np.mean(np.ptp(log.q[:, passive], axis=0))) if len(passive) else float("nan")


@of("rad", "ours")
def tracking_error(log: JointLog) -> float:
    """Rms of commanded minus measured position of the driven joints."""
    return float(np.sqrt(signals.mse(log.command, log.q[:, log.experiment.plant.driven])))


@of("Hz", "ours")
def stride_frequency(log: JointLog) -> float:
    """Strongest line of the commands."""
    return signals.stride_frequency(log.command, log.dt)


def _drives(log: JointLog) -> tuple[np.ndarray, np.ndarray]:
    driven = log.experiment.plant.driven
    return log.dq[:, driven], log.tau[:, driven]


# ---- learning, thesis section 3.6.3 ----------------------------------------------------


@of("-", "3.36", learner=True)
def nrmse(log: JointLog) -> float:
    """Rms error of the predicted positions over the mean range of their targets."""
    return signals.nrmse(log.target, log.prediction)


@of("stride", "ours", learner=True)
def phase_lag(log: JointLog) -> float:
    """How far the prediction is behind the target at the end, strides of the phase counted."""
    return float(lag(log)[-1])


@of("-", "3.36", learner=True)
def shape_error(log: JointLog) -> float:
    """NRMSE stride by stride, each at the shift that suits it best: the gait without its clock."""
    stride, errors = period(log), []
    for start in range(stride, len(log) - 2 * stride + 1, stride):
        actual = log.prediction[start : start + stride]
        shifts = range(start - stride // 2, start + stride // 2 + 1)
        errors.append(min(signals.mse(log.target[k : k + stride], actual) for k in shifts))
    width = signals.mean_range(log.target)
    return float(np.sqrt(np.mean(errors)) / width) if errors else float("nan")
