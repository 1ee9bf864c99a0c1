# SPDX-License-Identifier: Apache-2.0
"""How wrong a body is: the error between a recording and the model's replay of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from loco_sim.model import Model

from . import mawe, segments
from .parameters import parameter_set
from .params import CalibrationParams
from .recording import Recording, passive
from .replay import replay

REST = 0.2  # periods that a model has at least to settle


@dataclass(frozen=True)
class Evaluation:
    """Comparison of one body with a recording.

    Attributes:
        error: Windowed error by the name of the loss.
        lag: How far the robot is behind the model [s].
        robot: Periods of the robot.
        model: Periods of the model.
        fall: Why the model fell, empty when it did not.
    """

    error: dict[str, float]
    lag: float
    robot: segments.Segments
    model: segments.Segments
    fall: str


class Reference:
    """A recording cut into periods: what models are compared with.

    Attributes:
        joints: Names of the passive joints, columns of the signals.
        robot: Periods of the robot.

    Raises:
        ParameterError: The recording does not fit the robot, or has too few periods.
    """

    def __init__(self, recording: Recording, base: Model, options: CalibrationParams):
        robot = base.make_robot()
        self.base, self.options, self.name = base, options, recording.name
        self.joints = passive(robot)
        command, sensors = recording.command_of(robot), recording.sensors_of(robot)
        used = recording.t >= recording.t[0] + options.skip
        least = max(2, options.periods)
        at = segments.crossings(recording.t[used], command[used, 0], least)
        self.robot = segments.cut(recording.t[used], sensors[used], at)
        self._at = at[: (options.periods or len(at)) + 1]
        standing = robot.standing[robot.driven]
        begin = _begin(recording.t, np.abs(command - standing).max(axis=1), self, options.settle)
        end = self._at[-1] + 2.0 * recording.dt
        inside = (recording.t >= begin) & (recording.t <= end)
        self._t, self._command = recording.t[inside], command[inside]

    @property
    def first(self) -> float:
        """Beginning of the first period that is compared [s]."""
        return float(self._at[0])

    @property
    def simulated(self) -> float:
        """Length of one replay [s]."""
        return float(self._t[-1] - self._t[0])

    def compare(self, model: Model) -> Evaluation:
        """Replay the recorded commands on a model and compare the sensors.

        Raises:
            ParameterError: The body cannot be built.
            DivergedError: The state is no longer finite.
        """
        done = replay(model, self._t, self._command, self.options.seed)
        cut = segments.cut(done.t, done.q, self._at)
        errors, lag = {}, 0.0
        for name, loss in mawe.LOSSES.items():
            error, shift = loss(self.robot.mean, cut.mean, cut.period, self.options.window)
            errors[name] = error
            lag = shift if name == self.options.loss else lag
        return Evaluation(errors, lag, self.robot, cut, done.fall)

    def with_body(self, values: Mapping[str, float]) -> Model:
        """Base model with the values of the calibrated parameters."""
        changes = parameter_set(self.options.parameters).overrides(values)
        return Model(self.base.robot, {**self.base.overrides, **changes}, self.base.effects)

    def evaluate(self, values: Mapping[str, float]) -> Evaluation:
        """Compare the base model with the values of the calibrated parameters."""
        return self.compare(self.with_body(values))


def _begin(t: np.ndarray, jump: np.ndarray, reference: Reference, settle: float) -> float:
    """Where a replay begins [s]: at most `settle` periods before the first that is compared.

    In the first of these periods it is where the command is nearest to the standing pose,
    so that the model neither jumps nor needs long to settle.

    Args:
        t: Times of the recording [s], (T,).
        jump: Largest distance of the commands from the standing pose [rad], (T,).
        reference: With its borders and robot set.
        settle: Periods.
    """
    first, period = reference.first, reference.robot.period
    earliest = first - settle * period
    latest = min(earliest + period, first - REST * period)
    rows = np.flatnonzero((t >= earliest) & (t <= latest))
    if earliest <= t[0] or not len(rows):
        return max(float(t[0]), earliest - 1e-9)
    return float(t[rows[np.argmin(jump[rows])]])
