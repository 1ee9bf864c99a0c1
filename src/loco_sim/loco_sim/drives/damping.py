# SPDX-License-Identifier: Apache-2.0
"""Implicit damping: torques from the joint speed after the physics step, stable for any damping.

Damping computed from the speed before a step and held over it overshoots once kd dt / I nears
1 (`stability`). Here the drives provide their torque as a function of speed, and the engine
solves for it together with all other forces on the joint: `world.World.damped_step`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..robot.servo import IMPEDANCE, PERIOD
from .actuators import Actuators
from .servo_kernels import PASSIVE, impedance_laws


class DampedDrives:
    """Drives and springs of a robot, with the damping separated for an implicit solution.

    The damping of servos stays explicit: their motors have their own equations. The damping of
    sampled drives stays explicit, too, as in the real drive.
    """

    def __init__(self, drives: Actuators, joint_damping: np.ndarray):
        """Wrap drives.

        Args:
            drives: The drives, which still receive the commands.
            joint_damping: Damping of the joints themselves, apart from drives and springs
                [N·m·s/rad], (n,).
        """
        self._drives = drives
        self._rows, springs, self._memory = drives.rows()
        held, stiff = self._rows.copy(), springs.copy()
        held[(held[:, 0] == IMPEDANCE) & (held[:, PERIOD] <= 0.0), 0] = 0.0
        stiff[:, 2] = 0.0
        self._held = held, stiff
        self._law = np.zeros((4, len(joint_damping)))
        self._dampers, self._law[PASSIVE] = springs[:, 2], springs[:, 2] + joint_damping

    def laws(self, q: Sequence[float], dq: Sequence[float]) -> tuple[list[float], np.ndarray]:
        """Explicit torques for the next step, and the laws of the implicit torques.

        The law of a joint is clip(wanted - gain v, +-limit) - passive v at the joint's speed v
        after the step.

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).

        Returns:
            Torques [N·m], (n,), and rows wanted, gain, limit and passive of the laws
            [N·m, N·m·s/rad], (4, n).
        """
        drives = self._drives
        tau = drives.torque(q, dq, held=self._held)
        power = drives.dt, drives.on
        state = np.array([*q, *dq])
        impedance_laws(state, drives.command[0], self._rows, self._memory, *power, self._law)
        return tau, self._law

    def delivered(self, tau: Sequence[float], solved: np.ndarray, speed: np.ndarray) -> list[float]:
        """Torque of drives and springs in a step [N·m], (n,).

        Args:
            tau: Explicit torques, from `laws` [N·m], (n,).
            solved: Implicit torques, first result of `World.damped_step` [N·m], (n,).
            speed: Joint velocities, second result of `World.damped_step` [rad/s], (n,).
        """
        return (tau + solved - self._dampers * speed).tolist()
