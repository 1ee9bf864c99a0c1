# SPDX-License-Identifier: Apache-2.0
"""Damping at the speed that a joint has after the physics step: stable however large.

Damping computed from the speed before a step and held over it overshoots once kd dt / I nears
1 (`stability`). Here the drives say what their torque depends on, and the engine solves for
it together with all else that moves the joint: `world.World.damped_step`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..robot.servo import IMPEDANCE, PERIOD
from .actuators import Actuators
from .servo_kernels import PASSIVE, impedance_laws


class DampedDrives:
    """Drives and springs of a robot, their damping kept apart for the engine to solve.

    The damping of servos stays held over a step: their motors have equations of their own. That
    of drives that are sampled is what they make it.
    """

    def __init__(self, drives: Actuators, own: np.ndarray):
        """Take drives over.

        Args:
            drives: The drives; commands go on to them.
            own: Damping of the joints themselves, which is no torque of drive or spring
                [N·m·s/rad], (n,).
        """
        self._drives = drives
        self._rows, springs, self._memory = drives.rows()
        held, stiff = self._rows.copy(), springs.copy()
        held[(held[:, 0] == IMPEDANCE) & (held[:, PERIOD] <= 0.0), 0] = 0.0
        stiff[:, 2] = 0.0
        self._held = held, stiff
        self._law = np.zeros((4, len(own)))
        self._dampers, self._law[PASSIVE] = springs[:, 2], springs[:, 2] + own

    def laws(self, q: Sequence[float], dq: Sequence[float]) -> tuple[list[float], np.ndarray]:
        """Torques to hold over the next step, and the laws of the others.

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

    def given(self, tau: Sequence[float], solved: np.ndarray, speed: np.ndarray) -> list[float]:
        """Torque of drives and springs in a step [N·m], (n,).

        Args:
            tau: Torques that were held, of `laws` [N·m], (n,).
            solved: First result of `World.damped_step` [N·m], (n,).
            speed: The second [rad/s], (n,).
        """
        return (tau + solved - self._dampers * speed).tolist()
