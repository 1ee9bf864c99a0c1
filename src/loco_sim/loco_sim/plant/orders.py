# SPDX-License-Identifier: Apache-2.0
"""Commands of a whole run that are known beforehand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..robot.robot import Robot


class Orders(NamedTuple):
    """Commands of a robot, in the order of its joints."""

    q: np.ndarray  # positions wanted [rad or m], (T, n)
    dq: np.ndarray  # velocities wanted, (T, n)
    tau: np.ndarray  # torques wanted [N·m or N], (T, n)
    power: np.ndarray | None  # supply and switch of the drives, (T, 2); None is on
    ramps: tuple[bool, bool, bool]  # positions, velocities, torques go straight between rows
    stance: np.ndarray  # feet that stand as the drives were told, (T, feet) bool

    def rows(self, first: int, stop: int) -> Orders:
        """Rows from `first` until before `stop`; the last ramps have nowhere to go."""
        power = None if self.power is None else self.power[first:stop]
        parts = (values[first:stop] for values in (self.q, self.dq, self.tau))
        return Orders(*parts, power, self.ramps, self.stance[first:stop])

    def held(self) -> Orders:
        """The same with values that are held, in place of those that go straight between rows."""
        values = [
            0.5 * (values + np.concatenate([values[1:], values[-1:]])) if ramp else values
            for values, ramp in zip(self[:3], self.ramps, strict=True)
        ]
        return Orders(*values, self.power, (False, False, False), self.stance)

    def table(
        self, robot: Robot, steps: int, power: tuple[float, float] = (1.0, 1.0)
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Commands as `Actuators` takes them, which counts in each physics step, and the power.

        Args:
            robot: The robot.
            steps: Physics steps in a control period.
            power: Supply and switch where the orders say nothing of them.
        """
        swinging = self.swinging(robot)
        rows = [*self[:3], np.zeros(self.q.shape) if swinging is None else swinging]
        given = np.tile(power, (len(self.q), 1)) if self.power is None else self.power
        targets = np.stack(rows, axis=1).astype(float)
        return *ramped(targets, steps, self.ramps), np.array(given, dtype=float)

    def swinging(self, robot: Robot) -> np.ndarray | None:
        """1 where the leg of a joint swings, (T, n); None where none ever does."""
        if self.stance.all():
            return None
        patterns, which = np.unique(self.stance, axis=0, return_inverse=True)
        return np.array([robot.swinging(pattern) for pattern in patterns])[which.ravel()]


def ramped(
    targets: np.ndarray, steps: int, ramps: tuple[bool, bool, bool]
) -> tuple[np.ndarray, np.ndarray]:
    """Commands, and which of them in each physics step; one per step where any ramps.

    Args:
        targets: Commands as `Actuators` takes them, (T, COMMANDS, n).
        steps: Physics steps in a control period.
        ramps: Whether positions, velocities and torques go straight between rows.
    """
    which = np.repeat(np.arange(len(targets)), steps)
    if not any(ramps):
        return targets, which
    # The torque at the start of a step: then positions are right to second order (leapfrog).
    share = np.tile(np.arange(steps) / steps, len(targets))
    after = np.minimum(which + 1, len(targets) - 1)
    fine = targets[which]
    for kind in np.flatnonzero(ramps):
        way = targets[after, kind] - targets[which, kind]
        fine[:, kind] += share[:, None] * way
    return fine, np.arange(len(which))
