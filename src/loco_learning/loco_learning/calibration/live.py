# SPDX-License-Identifier: Apache-2.0
"""Live comparison of two running robots by their latest period.

`Signals` buffers the latest seconds of one robot; `GapMeter` takes the last whole period
of two robots, each between zero crossings of its own actuation, and compares the passive
joints by the windowed error of thesis eq. (5.4). The robots' clocks and speeds may differ.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import ParameterError

from . import mawe, segments
from .recording import GAP, Recording, align

SEARCH_PERIOD = 0.05  # time between two searches for a crossing [s]
MIN_AGE = 0.15  # [s] age below which a crossing is uncertain, due to the low-pass filter


class Signals:
    """Latest commands and joint angles of one robot, without interruption.

    Args:
        name: Name of the robot, for messages.
        joints: Names of its joints, columns of the angles.
        driven: Names of its driven joints, columns of the commands.
        span: Length of the buffer [s of simulated time].
    """

    def __init__(self, name: str, joints: Sequence[str], driven: Sequence[str], span: float):
        self.name, self.joints, self.driven = name, tuple(joints), tuple(driven)
        self.span = span
        self._states: deque[tuple[float, np.ndarray]] = deque()
        self._commands: deque[tuple[float, np.ndarray]] = deque()

    def add_state(self, t: float, q: np.ndarray) -> None:
        """Append measured angles [rad], (n,), at simulated time t [s]."""
        self._add(self._states, t, q)

    def add_command(self, t: float, q: np.ndarray) -> None:
        """Append commands of the driven joints [rad], (m,), at simulated time t [s]."""
        self._add(self._commands, t, q)

    def _add(self, samples: deque, t: float, value: np.ndarray) -> None:
        # After a restart of the robot or lost messages, only later samples are consecutive.
        if samples and not 0.0 <= t - samples[-1][0] <= GAP:
            self._states.clear()
            self._commands.clear()
        samples.append((t, value))
        while samples[0][0] < t - self.span:
            samples.popleft()

    @property
    def now(self) -> float:
        """Time of the latest state [s], -1 before the first."""
        return self._states[-1][0] if self._states else -1.0

    @property
    def length(self) -> float:
        """Duration that both states and commands cover [s]."""
        if not (self._states and self._commands):
            return 0.0
        start = max(self._states[0][0], self._commands[0][0])
        return max(0.0, min(self._states[-1][0], self._commands[-1][0]) - start)

    def recording(self, rate: float) -> Recording:
        """The buffered signals on one even time axis.

        Raises:
            ParameterError: There are too few samples, or values that are not finite.
        """
        if self.length <= 0.0:
            raise ParameterError(f"{self.name} has sent no joint states or no commands yet")
        states, commands = (
            (np.array([t for t, _ in samples]), np.array([x for _, x in samples]))
            for samples in (self._states, self._commands)
        )
        return align(self.name, (*states, self.joints), (*commands, self.driven), rate)


@dataclass(frozen=True)
class Gap:
    """Difference between a model and a measured robot over one period.

    Attributes:
        number: Number of the period, from 0.
        t: End of the period on the measured robot's clock [s].
        since: Start of the model's period on its clock [s].
        gap: Windowed error, summed over the joints [rad].
        lag: Delay of the measured robot behind its model [s].
        joints: Mean absolute error of each joint at that shift [rad], (J,).
        period: Length of the period [s].
    """

    number: int
    t: float
    since: float
    gap: float
    lag: float
    joints: np.ndarray
    period: float


class GapMeter:
    """Compares the latest whole period of two running robots.

    Args:
        measured: Signals of the measured robot.
        model: Signals of its model.
        passive: Joints that are compared.
        rate: Samples per second.
        window: Largest shift of one against the other [s].
    """

    def __init__(
        self,
        measured: Signals,
        model: Signals,
        passive: Sequence[str],
        rate: float,
        window: float = mawe.WINDOW,
    ):
        self._measured, self._model = measured, model
        self.passive, self._rate, self._window = tuple(passive), rate, window
        self._number, self._newest = 0, -np.inf
        self._next_look = -np.inf  # earliest time at which the next period may be complete [s]

    def update(self) -> Gap | None:
        """The gap over the latest period; None if it is not complete or was already returned."""
        time_now = self._measured.now
        if time_now < self._newest:  # the robot was restarted
            self._newest = self._next_look = -np.inf
        if time_now < self._next_look:
            return None
        self._next_look = time_now + SEARCH_PERIOD
        measured = self._last_period(self._measured, self._newest)
        model = measured and self._last_period(self._model)
        if not measured or not model:
            return None
        (_, end), measured_values = measured
        self._next_look = end + 0.95 * measured_values.period + MIN_AGE
        (since, _), model_values = model
        self._newest = end
        robot, body, period = measured_values.mean, model_values.mean, measured_values.period
        gap, lag = mawe.thesis(robot, body, period, self._window)
        shifted = np.roll(body, round(lag / period * segments.POINTS), axis=0)
        self._number += 1
        joints = np.abs(robot - shifted).mean(axis=0)
        return Gap(self._number - 1, end, since, gap, lag, joints, period)

    def _last_period(
        self, signals: Signals, after: float = -np.inf
    ) -> tuple[np.ndarray, segments.Segments] | None:
        """Borders and signals of the latest period that ends after a time; None without one."""
        try:
            recording = signals.recording(self._rate)
            moving = segments.leading(recording.command)
            at = segments.crossings(recording.t, recording.command[:, moving], 1)
        except ParameterError:
            return None
        at = at[at <= recording.t[-1] - MIN_AGE]
        if len(at) < 2 or at[-1] <= after + 0.5 * (at[-1] - at[-2]):
            return None
        columns = [signals.joints.index(name) for name in self.passive]
        return at[-2:], segments.cut(recording.t, recording.q[:, columns], at[-2:])
