# SPDX-License-Identifier: Apache-2.0
"""Precomputed command sequences of a whole run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..robot.robot import Robot


class CommandSequence(NamedTuple):
    """Commands of a robot, in the order of its joints."""

    q: np.ndarray  # desired positions [rad or m], (T, n)
    dq: np.ndarray  # desired velocities [rad/s or m/s], (T, n)
    tau: np.ndarray  # feed-forward torques [N·m or N], (T, n)
    power: np.ndarray | None  # supply and switch of the drives, (T, 2); None for on
    ramps: tuple[bool, bool, bool]  # positions, velocities, torques are interpolated
    stance: np.ndarray  # feet in stance according to the commands, (T, feet) bool

    def rows(self, first: int, stop: int) -> CommandSequence:
        """Rows from `first` to before `stop`; the last row is held instead of interpolated."""
        power = None if self.power is None else self.power[first:stop]
        parts = (values[first:stop] for values in (self.q, self.dq, self.tau))
        return CommandSequence(*parts, power, self.ramps, self.stance[first:stop])

    def held(self) -> CommandSequence:
        """Equivalent commands with held in place of interpolated values."""
        values = [
            0.5 * (values + np.concatenate([values[1:], values[-1:]])) if ramp else values
            for values, ramp in zip(self[:3], self.ramps, strict=True)
        ]
        return CommandSequence(*values, self.power, (False, False, False), self.stance)

    def table(
        self, robot: Robot, steps: int, power: tuple[float, float] = (1.0, 1.0)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Commands as in `Actuators`, their index at each physics step, and supply and switch.

        Args:
            robot: The robot.
            steps: Physics steps in a control period.
            power: Supply and switch if the orders do not contain them.
        """
        swinging = self.swinging(robot)
        rows = [*self[:3], np.zeros(self.q.shape) if swinging is None else swinging]
        supply = np.tile(power, (len(self.q), 1)) if self.power is None else self.power
        targets = np.stack(rows, axis=1).astype(float)
        return *ramped(targets, steps, self.ramps), np.array(supply, dtype=float)

    def swinging(self, robot: Robot) -> np.ndarray | None:
        """1 where the leg of a joint swings, (T, n); None if none ever does."""
        if self.stance.all():
            return None
        patterns, which = np.unique(self.stance, axis=0, return_inverse=True)
        return np.array([robot.swinging(pattern) for pattern in patterns])[which.ravel()]


def ramped(
    targets: np.ndarray, steps: int, ramps: tuple[bool, bool, bool]
) -> tuple[np.ndarray, np.ndarray]:
    """Commands, and their index at each physics step; one command per step with interpolation.

    Args:
        targets: Commands as in `Actuators`, (T, COMMANDS, n).
        steps: Physics steps in a control period.
        ramps: Whether positions, velocities and torques are interpolated between rows.
    """
    if not any(ramps):
        return targets, np.repeat(np.arange(len(targets)), steps)
    # Values at the start of a step, for which positions are second-order accurate (leapfrog).
    share, fine = (np.arange(steps) / steps)[:, None], np.repeat(targets, steps, axis=0)
    by_row = fine.reshape(len(targets), steps, *targets.shape[1:])
    for kind in np.flatnonzero(ramps):
        change = np.diff(targets[:, kind], axis=0, append=targets[-1:, kind])
        by_row[:, :, kind] += share * change[:, None]
    return fine, np.arange(len(fine))
