# SPDX-License-Identifier: Apache-2.0
"""Registry of the metrics of a run by name, with unit and equation; each is a decorated function.

``METRICS["speed"](log, log.phase_of("test"))`` is a number. A metric whose signals a run
lacks is absent from `table`; NaN means that the interval is too short, or that the metric is
not defined in it. The arithmetic is in `signals`.

Three definitions depend on the actuation of the robot: strides are counted by the gait clock if
there is one, otherwise by the frequency of the oscillators; the forward direction is the x axis
of the world for a robot whose trunk controller holds its heading, otherwise its own heading; the
score of eq. (3.32) counts the positive power of a servo, which does not recover negative work.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..runs.log import Log
from . import quantities, signals

MAWE_SHIFT = 0.05  # largest shift of eq. (3.40) [s]
REFERENCE_POWER = 100.0  # P_ref of eq. (3.32) [W], about the power of a slow trot
ENCODER_STEP = 2.0 * math.pi / 4096  # resolution of a servo's encoder, 4096 steps a turn [rad]
POSE = ("position", "orientation")  # columns of the base
SHORTEST = 1.0  # shortest interval for a metric of a gait [s]


@dataclass(frozen=True)
class Metric:
    """One number that describes an interval of a run."""

    name: str
    unit: str
    equation: str  # in the thesis; "ours" if it has none
    doc: str
    function: Callable[[Log], float]
    needs: tuple[str, ...]  # columns of the log
    learner: bool  # whether a network is needed
    applies: Callable[[Log], bool]  # predicate: defined for the robot of a log
    min_change: float  # smallest change that matters, in the unit of the metric
    share: float  # the same, over the value of the first run [-]; the larger of both counts

    def suits(self, log: Log) -> bool:
        """True if the run has the signals, and a network if one is needed."""
        learns = log.experiment.learner.enabled or not self.learner
        return learns and log.has(*self.needs) and self.applies(log)

    def notable(self, value: float) -> float:
        """Smallest change that matters at a value of the first run."""
        return max(self.min_change, self.share * abs(value))

    def __call__(self, log: Log, interval: slice = slice(None)) -> float:
        """Value over the ticks of `interval`; NaN if it is too short or does not apply."""
        cut = log.cut(interval)
        if len(cut) * cut.dt < SHORTEST or not self.suits(cut):
            return float("nan")
        return float(self.function(cut))


METRICS: dict[str, Metric] = {}


def metric(
    unit: str,
    equation: str,
    *needs: str,
    learner: bool = False,
    applies: Callable[[Log], bool] = lambda log: True,
    min_change: float,
    share: float = 0.05,
) -> Callable:
    """Register a function of a log under its own name; its docstring is the description.

    Args:
        unit: Unit of the number.
        equation: Number of its equation in the thesis, or "ours".
        needs: Columns of the log that it uses.
        learner: Whether it describes a network.
        applies: Predicate: the metric is defined for the robot of a log.
        min_change: Smallest change that matters, in the unit of the metric (taste: what a reader
            of a table would call a change); infinite for a number of the machine.
        share: The same, over the value of the first run (taste); the larger of both counts.
    """

    def register(function: Callable[[Log], float]) -> Callable[[Log], float]:
        name, doc = function.__name__, function.__doc__ or ""
        METRICS[name] = Metric(
            name, unit, equation, doc, function, needs, learner, applies, min_change, share
        )
        return function

    return register


def table(log: Log) -> dict[str, dict[str, float]]:
    """Metrics of each phase that was reached, by phase and name, without the standing phase."""
    metrics = {name: each for name, each in METRICS.items() if each.suits(log)}
    return {
        phase: {name: each(log, ticks) for name, each in metrics.items()}
        for phase, ticks in log.phases().items()
        if phase != "stand"
    }


# ---- behaviour, thesis section 3.6.2 ---------------------------------------------------


@metric("m", "ours", *POSE, applies=quantities.moves, min_change=0.005)
def distance(log: Log) -> float:
    """Displacement along the forward direction at the start of the phase."""
    return float(quantities.progress(log)[-1, 0])


@metric("m/s", "3.30", *POSE, applies=quantities.moves, min_change=0.005)
def speed(log: Log) -> float:
    """Distance over time."""
    return signals.mean_speed(quantities.progress(log)[:, 0], log.dt)


@metric("m/s", "ours", *POSE, applies=quantities.moves, min_change=0.005)
def forward_speed(log: Log) -> float:
    """Mean velocity along the current heading, for robots that may turn."""
    return float(np.mean(quantities.heading_speed(log)))


@metric("-", "ours", "position", "target_speed", applies=quantities.moves, min_change=0.02)
def speed_ratio(log: Log) -> float:
    """Speed over the target speed."""
    target = float(np.mean(log.target_speed))
    return speed(log) / target if abs(target) > 1e-6 else float("nan")


@metric("m", "ours", *POSE, applies=quantities.moves, min_change=0.005)
def lateral_drift(log: Log) -> float:
    """Displacement across the forward direction at the start of the phase; left is positive."""
    return float(quantities.progress(log)[-1, 1])


@metric("rad", "ours", "orientation", applies=quantities.moves, min_change=0.01)
def heading_drift(log: Log) -> float:
    """Yaw at the end minus yaw at the start."""
    yaw = signals.roll_pitch_yaw(log.orientation)[:, 2]
    return float(yaw[-1] - yaw[0])


@metric("m", "3.27", "position", applies=quantities.moves, min_change=0.001, share=0.1)
def stability(log: Log) -> float:
    """Range of the height of the base; lower is steadier."""
    return signals.excursion(log.position[:, 2])


@metric("rad", "ours", "orientation", applies=quantities.moves, min_change=0.005, share=0.1)
def roll_range(log: Log) -> float:
    """Range of the roll of the base."""
    return signals.excursion(signals.roll_pitch_yaw(log.orientation)[:, 0])


@metric("rad", "ours", "orientation", applies=quantities.moves, min_change=0.005, share=0.1)
def pitch_range(log: Log) -> float:
    """Range of the pitch of the base (the author's pitch range is really that of yaw)."""
    return signals.excursion(signals.roll_pitch_yaw(log.orientation)[:, 1])


@metric("W", "3.28", "dq", "tau", min_change=0.01)
def power(log: Log) -> float:
    """Mean mechanical power of the drives; negative work is subtracted."""
    return signals.mechanical_power(*quantities.drives(log))


@metric("W", "ours", "dq", "tau", min_change=0.01)
def positive_power(log: Log) -> float:
    """Mean mechanical power of the drives; negative work is not recovered."""
    return signals.positive_power(*quantities.drives(log))


@metric("-", "3.31", *POSE, "dq", "tau", applies=quantities.moves, min_change=0.01)
def cost_of_transport(log: Log) -> float:
    """P / (m g V) with the net power and the speed; lower is better. The thesis inverts it."""
    return signals.cost_of_transport(power(log), speed(log), quantities.mass(log))


@metric("-", "ours", *POSE, "dq", "tau", applies=quantities.moves, min_change=0.01)
def positive_cost_of_transport(log: Log) -> float:
    """P / (m g V) with positive power and forward speed, for servos and robots that turn."""
    return signals.cost_of_transport(positive_power(log), forward_speed(log), quantities.mass(log))


@metric("m/(s·kg)", "3.32", *POSE, "dq", "tau", applies=quantities.moves, min_change=1e-4)
def saturated_score(log: Log) -> float:
    """V / m tanh(P_ref / P) with P_ref = 100 W, higher is better; of servos with positive power."""
    walks = quantities.walks(log)
    watts, velocity = (power, speed) if walks else (positive_power, forward_speed)
    return signals.saturated_score(watts(log), velocity(log), quantities.mass(log), REFERENCE_POWER)


@metric("N·m", "ours", "tau", min_change=0.005)
def torque_max(log: Log) -> float:
    """Largest torque of a drive, mean over a control period."""
    return float(np.max(np.abs(quantities.drives(log)[1]), initial=0.0))


@metric("N", "3.33", "grf", applies=quantities.has_feet, min_change=0.1)
def grf_max(log: Log) -> float:
    """Largest normal force on any foot."""
    return signals.peak_force(log.grf)


@metric("-", "ours", "grf", applies=quantities.has_feet, min_change=0.02)
def grf_snr(log: Log) -> float:
    """|mean| over standard deviation of the normal forces, mean over feet."""
    return signals.snr(log.grf[..., 2])


@metric("-", "ours", "contact", applies=quantities.has_feet, min_change=0.02)
def duty_factor(log: Log) -> float:
    """Share of the time that a foot touches the ground, mean over feet."""
    return float(np.mean(log.contact))


@metric("m", "ours", *POSE, "grf", applies=quantities.has_feet, min_change=0.002)
def step_length(log: Log) -> float:
    """Distance over steps, by the stride frequency of the forces, as in the author's code."""
    return speed(log) / signals.stride_frequency(log.grf[..., 2], log.dt)


@metric("m", "3.6.2.6", "q", applies=quantities.has_feet, min_change=0.002)
def foot_travel(log: Log) -> float:
    """Range of the measured foot position along x in the base frame, mean over feet."""
    return float(np.mean(np.ptp(quantities.feet(log)[..., 0], axis=0)))


@metric("m", "3.6.2.6", "q", applies=quantities.has_feet, min_change=0.002)
def step_height(log: Log) -> float:
    """Range of the measured foot position along z in the base frame, mean over feet."""
    return float(np.mean(np.ptp(quantities.feet(log)[..., 2], axis=0)))


@metric("Hz", "ours", "command", applies=quantities.has_feet, min_change=0.02)
def stride_frequency(log: Log) -> float:
    """Largest spectral peak of the normal forces, or of the commands from oscillators."""
    return signals.stride_frequency(
        log.grf[..., 2] if quantities.walks(log) else log.command, log.dt
    )


@metric("rad", "ours", "q", applies=quantities.has_passive_joints, min_change=0.005)
def passive_range(log: Log) -> float:
    """Range of the passive joints, mean over them."""
    return float(np.mean(np.ptp(log.q[:, quantities.passive(log)], axis=0)))


@metric("rad", "ours", "command", "q", min_change=ENCODER_STEP, share=0.1)
def tracking_error(log: Log) -> float:
    """Rms of commanded minus measured position of the driven joints."""
    return float(
        np.sqrt(signals.mse(log.command, quantities.columns(log.q, log.experiment.plant.driven)))
    )


# ---- learning, thesis section 3.6.3 ----------------------------------------------------


@metric("rad²", "3.34", "prediction", learner=True, min_change=1e-5, share=0.2)
def mse(log: Log) -> float:
    """Mean squared error of the predicted positions."""
    return signals.mse(*quantities.target_and_prediction(log))


@metric("rad", "3.35", "prediction", learner=True, min_change=ENCODER_STEP, share=0.1)
def mae(log: Log) -> float:
    """Mean absolute error of the predicted positions."""
    return signals.mae(*quantities.target_and_prediction(log))


@metric("-", "ours", "prediction", learner=True, min_change=0.005, share=0.1)
def nrmse(log: Log) -> float:
    """Rms error of the predicted positions over the mean range of their targets, not as (3.36)."""
    return signals.nrmse(*quantities.target_and_prediction(log))


@metric("-", "3.36", "prediction", learner=True, min_change=0.005, share=0.1)
def nrmse_author(log: Log) -> float:
    """Rms error of positions and velocities over their global range, as the author's code does."""
    return signals.nrmse_global(quantities.outputs_wanted(log), log.prediction)


@metric("-", "ours", "prediction", learner=True, min_change=0.005, share=0.1)
def shape_error(log: Log) -> float:
    """NRMSE per stride, each at its best time shift: the shape of the gait without its timing."""
    target, prediction = quantities.target_and_prediction(log)
    stride, errors = quantities.period(log), []
    for start in range(stride, len(log) - 2 * stride + 1, stride):
        actual = prediction[start : start + stride]
        shifts = range(start - stride // 2, start + stride // 2 + 1)
        errors.append(min(signals.mse(target[k : k + stride], actual) for k in shifts))
    width = signals.mean_range(target)
    return float(np.sqrt(np.mean(errors)) / width) if errors else float("nan")


@metric("-", "ours", "prediction", learner=True, min_change=0.1, share=0.1)
def accuracy(log: Log) -> float:
    """1 / NRMSE of `nrmse`."""
    return signals.accuracy(*quantities.target_and_prediction(log))


@metric("-", "3.37", "prediction", learner=True, min_change=0.1, share=0.1)
def accuracy_author(log: Log) -> float:
    """1 / NRMSE of positions and velocities over their global range, as in the author's code."""
    error = nrmse_author(log)
    return 1.0 / error if error else float("inf")


@metric("rad²", "3.38", "prediction", learner=True, min_change=1e-6, share=0.2)
def fmse(log: Log) -> float:
    """Mean squared difference of the amplitude spectra of the positions."""
    return signals.fmse(*quantities.target_and_prediction(log))


@metric("rad", "3.40", "prediction", learner=True, min_change=ENCODER_STEP, share=0.1)
def mawe(log: Log) -> float:
    """Mean absolute error of the positions at the best common shift of up to 50 ms."""
    return signals.mawe(*quantities.target_and_prediction(log), round(MAWE_SHIFT / log.dt))


@metric("s", "3.41", "reflex_time", learner=True, min_change=math.inf)
def step_time(log: Log) -> float:
    """Mean wall-clock time of one step of the network; in train, the training time."""
    return float(np.mean(log.reflex_time))


@metric("Hz", "ours", "prediction", learner=True, min_change=0.02)
def prediction_frequency(log: Log) -> float:
    """Largest spectral peak of the predicted positions."""
    return signals.stride_frequency(quantities.target_and_prediction(log)[1], log.dt)


@metric("stride", "ours", "prediction", learner=True, min_change=0.02)
def phase_lag(log: Log) -> float:
    """Lag behind the target at the end of the interval, including whole strides."""
    return float(quantities.lag(log)[-1])


@metric("-", "3.6.3.3", "prediction", learner=True, min_change=0.02)
def limit_cycle_size(log: Log) -> float:
    """Size of the predicted limit cycle over that of the target, in the target's PCA plane."""
    target, actual = signals.limit_cycle(quantities.outputs_wanted(log), log.prediction)
    size = float(np.sum(np.var(target, axis=0)))
    return float(np.sqrt(np.sum(np.var(actual, axis=0)) / size)) if size else float("nan")
