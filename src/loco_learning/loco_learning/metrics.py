# SPDX-License-Identifier: Apache-2.0
"""Every metric of a run by name, with unit and equation; a new one is a decorated function.

``METRICS["speed"](log, log.phase("test"))`` gives a number, NaN where it makes no
sense (a prediction error in open loop). The arithmetic is in `signals`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from . import signals
from .log import Log
from .params import OUTPUT_JOINTS, PHASES

MAWE_SHIFT = 0.05  # largest shift of eq. (3.40) [s]
REFERENCE_POWER = 100.0  # P_ref of eq. (3.32) [W], about the power of a slow trot
SHORTEST = 1.0  # intervals below say nothing about a gait [s]


@dataclass(frozen=True)
class Metric:
    """One number about an interval of a run."""

    name: str
    unit: str
    equation: str  # in the thesis; "ours" if it has none
    doc: str
    function: Callable[[Log], float]
    learner: bool  # needs a network

    def __call__(self, log: Log, interval: slice = slice(None)) -> float:
        """Value over the ticks of `interval`; NaN if it is too short or does not apply."""
        cut = log.cut(interval)
        if len(cut) * cut.dt < SHORTEST or (self.learner and not log.experiment.learner.enabled):
            return float("nan")
        return float(self.function(cut))


METRICS: dict[str, Metric] = {}


def metric(
    unit: str, equation: str, learner: bool = False, registry: dict[str, Metric] = METRICS
) -> Callable:
    """Register a function of a log under its own name; the docstring says what it is."""

    def register(function: Callable[[Log], float]) -> Callable[[Log], float]:
        name = function.__name__
        registry[name] = Metric(name, unit, equation, function.__doc__ or "", function, learner)
        return function

    return register


def table(log: Log) -> dict[str, dict[str, float]]:
    """All metrics of each phase that was reached, by phase and name; standing has no gait."""
    reached = [name for name in PHASES[1:] if (s := log.phase(name)).stop > s.start]
    return {
        phase: {name: each(log, log.phase(phase)) for name, each in METRICS.items()}
        for phase in reached
    }


def target_and_prediction(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """The 8 HFE and KFE positions [rad], wanted and predicted, each (T, 8)."""
    return log.target.q[:, OUTPUT_JOINTS], log.learning.prediction[:, :8]


def outputs_wanted(log: Log) -> np.ndarray:
    """What the 16 outputs should be: positions [rad] and velocities [rad/s], (T, 16)."""
    joints = OUTPUT_JOINTS
    return np.concatenate((log.target.q[:, joints], log.target.dq[:, joints]), axis=1)


def period(log: Log) -> int:
    """Ticks of one gait period at the frequency asked for, at least 1."""
    return max(1, round(1.0 / (float(np.mean(log.target.frequency)) * log.dt)))


def lag(log: Log) -> np.ndarray:
    """How far the prediction is behind the target [strides], (T,)."""
    target, prediction = target_and_prediction(log)
    return signals.phase_lag(target, prediction, log.target.phase[:, 0], period(log))


# ---- behaviour, thesis section 3.6.2 ---------------------------------------------------


@metric("m", "3.27")
def stability(log: Log) -> float:
    """Range of the trunk height; lower is steadier."""
    return signals.excursion(log.truth.position[:, 2])


@metric("rad", "ours")
def roll_range(log: Log) -> float:
    """Range of the trunk roll."""
    return signals.excursion(signals.roll_pitch_yaw(log.truth.orientation)[:, 0])


@metric("rad", "ours")
def pitch_range(log: Log) -> float:
    """Range of the trunk pitch (the author's pitch range is really that of yaw)."""
    return signals.excursion(signals.roll_pitch_yaw(log.truth.orientation)[:, 1])


@metric("rad", "ours")
def heading_drift(log: Log) -> float:
    """Yaw at the end minus yaw at the start."""
    yaw = signals.roll_pitch_yaw(log.truth.orientation)[:, 2]
    return float(yaw[-1] - yaw[0])


@metric("m", "ours")
def lateral_drift(log: Log) -> float:
    """Displacement along y."""
    return float(log.truth.position[-1, 1] - log.truth.position[0, 1])


@metric("W", "3.28")
def power(log: Log) -> float:
    """Mean mechanical power of all joints, negative work counted against it."""
    return signals.mechanical_power(log.state.dq, log.state.tau)


@metric("W", "ours")
def positive_power(log: Log) -> float:
    """Mean mechanical power of all joints, negative work lost."""
    return signals.positive_power(log.state.dq, log.state.tau)


@metric("m/s", "3.30")
def speed(log: Log) -> float:
    """Distance along x over time."""
    return signals.mean_speed(log.truth.position[:, 0], log.dt)


@metric("-", "ours")
def speed_ratio(log: Log) -> float:
    """Speed over the speed asked for."""
    asked = float(np.mean(log.target.speed))
    return speed(log) / asked if abs(asked) > 1e-6 else float("nan")


@metric("-", "3.31")
def cost_of_transport(log: Log) -> float:
    """P / (m g V), lower is better; the thesis prints the inverse."""
    return signals.cost_of_transport(power(log), speed(log), log.experiment.trunk.mass)


@metric("m/(s·kg)", "3.32")
def saturated_score(log: Log) -> float:
    """V / m tanh(P_ref / P) with P_ref = 100 W, higher is better."""
    return signals.saturated_score(
        power(log), speed(log), log.experiment.trunk.mass, REFERENCE_POWER
    )


@metric("N", "3.33")
def grf_max(log: Log) -> float:
    """Largest normal force on any foot."""
    return signals.peak_force(log.state.grf)


@metric("-", "ours")
def grf_snr(log: Log) -> float:
    """|mean| over standard deviation of the normal forces, mean over feet."""
    return signals.snr(log.state.grf[..., 2])


@metric("-", "ours")
def duty_factor(log: Log) -> float:
    """Share of the time that a foot touches the ground, mean over feet."""
    return float(np.mean(log.state.contact))


@metric("m", "3.6.2.6")
def step_length(log: Log) -> float:
    """Range of the measured foot position along x in the base frame, mean over feet."""
    return float(np.mean(np.ptp(measured_feet(log)[..., 0], axis=0)))


@metric("m", "3.6.2.6")
def step_height(log: Log) -> float:
    """Range of the measured foot position along z in the base frame, mean over feet."""
    return float(np.mean(np.ptp(measured_feet(log)[..., 2], axis=0)))


@metric("Hz", "ours")
def stride_frequency(log: Log) -> float:
    """Strongest line of the normal forces."""
    return signals.stride_frequency(log.state.grf[..., 2], log.dt)


# ---- learning, thesis section 3.6.3 ----------------------------------------------------


@metric("rad²", "3.34", learner=True)
def mse(log: Log) -> float:
    """Mean squared error of the 8 predicted positions."""
    return signals.mse(*target_and_prediction(log))


@metric("rad", "3.35", learner=True)
def mae(log: Log) -> float:
    """Mean absolute error of the 8 predicted positions."""
    return signals.mae(*target_and_prediction(log))


@metric("-", "3.36", learner=True)
def nrmse(log: Log) -> float:
    """Rms error of the 8 predicted positions over the mean range of their targets."""
    return signals.nrmse(*target_and_prediction(log))


@metric("-", "3.36", learner=True)
def nrmse_author(log: Log) -> float:
    """Rms error of all 16 outputs over their global range, as the author's code has it."""
    return signals.nrmse_global(outputs_wanted(log), log.learning.prediction)


@metric("-", "3.37", learner=True)
def accuracy(log: Log) -> float:
    """1 / NRMSE."""
    return signals.accuracy(*target_and_prediction(log))


@metric("rad²", "3.38", learner=True)
def fmse(log: Log) -> float:
    """Mean squared difference of the amplitude spectra of the 8 positions."""
    return signals.fmse(*target_and_prediction(log))


@metric("rad", "3.40", learner=True)
def mawe(log: Log) -> float:
    """Mean absolute error of the 8 positions at the best common shift of up to 50 ms."""
    return signals.mawe(*target_and_prediction(log), round(MAWE_SHIFT / log.dt))


@metric("s", "3.41", learner=True)
def step_time(log: Log) -> float:
    """Mean wall-clock time of one step of the network; in train, the training time."""
    return float(np.mean(log.reflex_time)) if len(log.reflex_time) else float("nan")


@metric("rad", "ours")
def tracking_error(log: Log) -> float:
    """Rms of commanded minus measured position over all 12 joints."""
    return float(np.sqrt(signals.mse(log.command.q, log.state.q)))


@metric("Hz", "ours", learner=True)
def prediction_frequency(log: Log) -> float:
    """Strongest line of the 8 predicted positions."""
    return signals.stride_frequency(log.learning.prediction[:, :8], log.dt)


@metric("stride", "ours", learner=True)
def phase_lag(log: Log) -> float:
    """How far the prediction is behind the target at the end, strides of the interval counted."""
    return float(lag(log)[-1])


@metric("-", "3.6.3.3", learner=True)
def limit_cycle_size(log: Log) -> float:
    """Size of the predicted limit cycle over that of the target, in the target's PCA plane."""
    target, actual = signals.limit_cycle(outputs_wanted(log), log.learning.prediction)
    size = float(np.sum(np.var(target, axis=0)))
    return float(np.sqrt(np.sum(np.var(actual, axis=0)) / size)) if size else float("nan")


def measured_feet(log: Log) -> np.ndarray:
    """Foot positions in the base frame from the measured joints [m], (T, 4, 3)."""
    return feet(log.state.q)


def feet(q: np.ndarray) -> np.ndarray:
    """Foot positions in the base frame [m], (T, 4, 3), of joint positions [rad], (T, 12)."""
    from loco_control.kinematics import HYQ, feet_and_jacobians  # loads numba

    lengths = HYQ.lengths()
    return np.array([feet_and_jacobians(row, lengths)[0] for row in q.reshape(-1, 4, 3)])
