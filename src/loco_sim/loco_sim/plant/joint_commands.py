# SPDX-License-Identifier: Apache-2.0
"""Conversion of commands of the driven joints to arguments of the plant."""

from __future__ import annotations

import numpy as np

from loco_control.types import MotionCommand, TrunkTorque

from ..robot.robot import Robot
from ..robot.servo import TorqueDrive
from .orders import CommandSequence


class JointCommands:
    """Converter from values of the driven joints to the arguments of `Simulation.step`.

    The value of a joint is an angle, or a torque if its drive is of kind ``torque``.
    """

    def __init__(self, robot: Robot):
        self._n, self._driven, self._feet = len(robot.joints), robot.driven, len(robot.feet)
        drives = [robot.drives.get(robot.joints[i]) for i in robot.driven]
        self._torque = np.array([isinstance(d, TorqueDrive) for d in drives], dtype=bool)
        self._any_torque = bool(self._torque.any())

    def __call__(
        self, tick: int, t: float, q: np.ndarray, dq: np.ndarray
    ) -> tuple[MotionCommand, TrunkTorque | None]:
        """Command and, for torque drives, feed-forward torque.

        Args:
            tick: Control periods since reset.
            t: Simulated time [s].
            q: Desired positions [rad] or torques [N·m], (m,).
            dq: Desired velocities [rad/s], (m,).
        """
        position, speed = np.zeros(self._n), np.zeros(self._n)
        position[self._driven], speed[self._driven] = q, dq
        command = MotionCommand(tick, t, position, speed)
        if not self._any_torque:
            return command, None
        tau = np.zeros(self._n)
        tau[self._driven[self._torque]] = q[self._torque]
        return command, TrunkTorque(tick, t, tau, np.zeros(6), np.ones(self._feet, dtype=bool))

    def sequence(self, q: np.ndarray, dq: np.ndarray | None = None) -> CommandSequence:
        """Commands of a whole run.

        Args:
            q: Desired positions [rad] or torques [N·m], (T, m).
            dq: Desired velocities [rad/s], (T, m); None for zero.
        """
        position, speed, tau = np.zeros((3, len(q), self._n))
        position[:, self._driven] = q
        speed[:, self._driven] = 0.0 if dq is None else dq
        tau[:, self._driven[self._torque]] = q[:, self._torque]
        stance = np.ones((len(q), self._feet), dtype=bool)
        return CommandSequence(position, speed, tau, None, (False, False, False), stance)
