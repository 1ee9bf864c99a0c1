# SPDX-License-Identifier: Apache-2.0
"""Fused execution of the effects on sensor readings.

A `RobotState` is copied into one vector, each effect changes it in place, and a new
state is built from it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from loco_control.types import RobotState

from .base import span
from .identity import SENSOR_SIGNALS

ITERATIONS = 8  # fixed-point iterations of `behind`


def unpacked(tick: int, t: float, values: np.ndarray, contact: np.ndarray) -> RobotState:
    """State of a robot whose signals are views of a vector, in the order of `Layout`."""
    imu = len(values) - 10
    n = imu // 3 - len(contact)
    return RobotState(
        tick=tick,
        t=t,
        q=values[:n],
        dq=values[n : 2 * n],
        tau=values[2 * n : 3 * n],
        grf=values[3 * n : imu].reshape(-1, 3),
        orientation=values[imu : imu + 4],
        angular_velocity=values[imu + 4 : imu + 7],
        linear_acceleration=values[imu + 7 :],
        contact=contact,
    )


class Layout:
    """Positions of the signals in the vector of a robot with n joints and m feet.

    Attributes:
        size: Length of the vector.
        n: Number of joints.
    """

    def __init__(self, n: int, m: int):
        self.n, self.size, self._at = n, 0, {}
        for name, width in zip(SENSOR_SIGNALS, (n, n, n, 3 * m, 4, 3, 3), strict=True):
            self._at[name] = slice(self.size, self.size + width)
            self.size += width

    def __getitem__(self, name: str) -> slice:
        return self._at[name]

    def pack(self, state: RobotState) -> np.ndarray:
        """New vector of all signals, (size,)."""
        q, grf, gyro = state.q, state.grf.reshape(-1), state.angular_velocity
        rest = state.orientation, gyro, state.linear_acceleration
        return np.concatenate((q, state.dq, state.tau, grf, *rest))

    def unpack(self, values: np.ndarray, state: RobotState) -> RobotState:
        """The state with its signals replaced by those of a vector."""
        return unpacked(state.tick, state.t, values, state.contact)


class Readings:
    """Hook `on_measurement` of several effects, in order."""

    def __init__(self, effects: Sequence[Any], hook: str = "on_measurement", dt: float = 0.0):
        """Combine effects with a method `measure`; with `dt` 0 they are active at all times.

        Args:
            effects: Effects in the order in which they act.
            hook: Name of the hook, always `on_measurement`.
            dt: Physics step [s].
        """
        self._dt = dt
        self._all = [(*(span(e, dt) if dt else (0, np.inf)), e.measure) for e in effects]
        self._at: Layout | None = None

    def __call__(self, state: RobotState) -> RobotState:
        if self._at is None:
            self._at = Layout(len(state.q), len(state.grf))
        values = self._at.pack(state)
        step = round(state.t / self._dt) if self._dt else 0
        for first, last, measure in self._all:
            if first <= step < last:
                measure(values, self._at, state.t)
        return self._at.unpack(values, state)


def behind(
    effects: Sequence[Measuring], q: np.ndarray, dq: np.ndarray, feet: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """True joint positions and velocities for the readings `q` and `dq` of sensors with effects.

    A reading without a solution, possible for non-monotonic characteristics, is returned unchanged.

    Args:
        effects: Effects that are `by_itself`, configured, in the order in which they act.
        q: Measured positions [rad or m], (n,).
        dq: Measured velocities [rad/s or m/s], (n,).
        feet: Number of the robot's feet.
    """
    at = Layout(len(q), feet)
    read = np.zeros(at.size)
    read[at["q"]], read[at["dq"]] = q, dq

    def missed(true: np.ndarray) -> np.ndarray:
        reading = true.copy()
        for effect in effects:
            effect.measure(reading, at, 0.0)
        return read - reading

    first = missed(read)
    true = read + first
    with np.errstate(over="ignore", invalid="ignore"):
        for _ in range(ITERATIONS - 1):
            true += missed(true)
        improved = np.abs(missed(true)) <= np.abs(first)
    true = np.where(improved, true, read)
    return true[at["q"]], true[at["dq"]]


class Measuring:
    """Interface of effects that change sensor readings.

    Attributes:
        by_itself: Whether a reading depends on the current values only, so that `measure`
            accepts many samples at once, (T, at.size).
        remembers: Whether a reading depends on the memory of the effect's law (`Laws.memory`).
    """

    by_itself: ClassVar[bool] = False
    remembers: ClassVar[bool] = False

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        """Change sensor readings in place.

        Args:
            values: All signals, (at.size,).
            at: Position of each signal.
            t: Time [s].
        """
        raise NotImplementedError

    def measure_run(
        self, values: np.ndarray, at: Layout, times: np.ndarray, memory: np.ndarray
    ) -> None:
        """Change the sensor readings of a run in place, as `measure` does in each sample.

        Args:
            values: All signals, (T, at.size).
            at: Position of each signal.
            times: Times of the samples [s], (T,).
            memory: State of all laws, (T, r, MEMORY); (0, r, MEMORY) if no effect `remembers`.
        """
        if self.by_itself:
            self.measure(values, at, 0.0)
            return
        for row, t in zip(values, times, strict=True):
            self.measure(row, at, t)

    def on_measurement(self, state: RobotState) -> RobotState:
        """The state as measured under this effect alone."""
        return Readings([self])(state)

    @classmethod
    def fuse(cls, hook: str) -> Callable[..., Any] | None:
        """`Readings` for the hook `on_measurement`, None for other hooks."""
        return Readings if hook == "on_measurement" else super().fuse(hook)
