# SPDX-License-Identifier: Apache-2.0
"""All drives and springs of a robot, one kernel call per physics step.

Takes the place of `drive.Drive` for robots whose ``robot.yaml`` lists drives or
springs; a joint without either is free.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite

import numpy as np
from numba import njit

from loco_control.types import MotionCommand, TrunkTorque

from .robot import Robot
from .servo import COLUMNS as DRIVE_COLUMNS
from .servo import IMPEDANCE, SERVO, TORQUE
from .servo_kernels import clipped, servo_torque, share
from .spring import COLUMNS as SPRING_COLUMNS
from .spring_kernels import spring_energy, spring_torque

MADE_OF = "2fa561c645f2"  # of the kernels called here: see tests/loco_sim/test_kernel_caches.py


@njit(cache=True, error_model="numpy")
def joint_torques(
    state: np.ndarray,
    command: np.ndarray,
    drives: np.ndarray,
    springs: np.ndarray,
    rotors: np.ndarray,
    dt: float,
    supply: float,
    on: float,
    tau: np.ndarray,
) -> None:
    """Torque of drive and spring of every joint.

    Args:
        state: Positions, then velocities of the joints [rad, rad/s], (2 n,).
        command: Positions, velocities, torques wanted, (3, n).
        drives: A row per joint, (n, 9).
        springs: A row per joint, (n, 7).
        rotors: Position and speed of each servo's rotor, (n, 2); changed in place.
        dt: Physics step [s].
        supply: Voltage of the servos over the nominal one.
        on: 1, or 0 for drives that are switched off.
        tau: Filled in [N·m], (n,).
    """
    n = len(drives)
    for i in range(n):
        tau[i] = 0.0
        q, dq, row = state[i], state[n + i], drives[i]
        if row[0] == SERVO:
            tau[i] = servo_torque(q, dq, command[0, i], row, rotors[i], dt, supply, on)
        elif row[0] == IMPEDANCE:
            wanted = row[1] * (command[0, i] - q) + row[2] * (command[1, i] - dq)
            tau[i] = on * clipped(wanted + command[2, i], row[8])
        elif row[0] == TORQUE:
            tau[i] = on * clipped(row[1] * command[2, i] + row[2], row[8])
        if springs[i, 0] > 0.0:
            tau[i] += spring_torque(q, dq, springs[i])


@njit(cache=True, error_model="numpy")
def asked(state, command, drives, rotors, supply, on):
    """Share of the voltage that each servo asks for, (n,), and speed of its rotor, (n,).

    Arguments as of `joint_torques`. Both are 0 for other drives, and for one that is off.
    """
    n = len(drives)
    found = np.zeros((2, n))
    for i in range(n):
        if drives[i, 0] == SERVO:
            found[0, i] = supply * on * share(state[i], command[0, i], drives[i])
            found[1, i] = on * rotors[i, 1]
    return found


class Actuators:
    """Drives and springs of a robot, with the face of `drive.Drive`.

    Attributes:
        q: Desired joint positions in force [rad], (n,).
        dq: Desired joint velocities in force [rad/s], (n,).
        supply: Voltage of the servos over the nominal one.
        on: 1, or 0 while all drives are switched off; springs remain.
    """

    def __init__(self, robot: Robot, dt: float):
        n = len(robot.joints)
        self._dt = dt
        self._drives, self._springs = np.zeros((n, DRIVE_COLUMNS)), np.zeros((n, SPRING_COLUMNS))
        for i, joint in enumerate(robot.joints):
            if joint in robot.drives:
                self._drives[i] = robot.drives[joint].row(robot.effort[i])
            if joint in robot.springs:
                self._springs[i] = robot.springs[joint].row()
        self._driven = self._drives[:, 0] > 0.0
        self._rotors, self._command = np.zeros((n, 2)), np.zeros((3, n))

    def reset(self, q: np.ndarray) -> None:
        """Hold a pose [rad], (n,), with the rotors at rest."""
        self._rotors[:, 0], self._rotors[:, 1] = q, 0.0
        self.q, self.dq = np.array(q, dtype=float), np.zeros(len(q))
        self._command[:] = 0.0
        self._command[0] = q
        self.supply = self.on = 1.0

    def start(self, q: np.ndarray, dq: np.ndarray) -> None:
        """As `reset`, in motion: the rotors turn with the joints [rad/s], (n,)."""
        self.reset(q)
        self._rotors[:, 1] = dq

    def rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Drives, springs and rotors, as `joint_torques` takes them."""
        return self._drives, self._springs, self._rotors

    def accept(self, command: MotionCommand, trunk: TrunkTorque) -> bool:
        """Take a command over; False, and nothing changes, if it is not finite."""
        on = self._driven
        if not isfinite(sum((command.q + command.dq + trunk.tau)[on].tolist())):
            return False
        self.q, self.dq = command.q, command.dq
        self._command[0], self._command[1], self._command[2] = command.q, command.dq, trunk.tau
        return True

    def follow(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Follow these references instead of the command's, e.g. late ones."""
        self._command[0], self._command[1] = q, dq

    def torque(
        self,
        joints: tuple[tuple[float, float, tuple, float], ...],
        change: Callable[..., np.ndarray] | None = None,
    ) -> list[float]:
        """Joint torques [N·m], (n,).

        Args:
            joints: Position [rad] and velocity [rad/s] (and more) of each joint.
            change: What the motors are in this step: takes and gives back what the hook
                `on_motor` of effects does; None leaves them alone.
        """
        state = np.array([s[0] for s in joints] + [s[1] for s in joints])
        drives = self._drives
        if change:
            power = self.supply, self.on
            drives = change(drives, *asked(state, self._command, drives, self._rotors, *power))
        tau = np.empty(len(drives))
        joint_torques(
            state,
            self._command,
            drives,
            self._springs,
            self._rotors,
            self._dt,
            self.supply,
            self.on,
            tau,
        )
        return tau.tolist()

    def energy(self, q: np.ndarray) -> tuple[float, float]:
        """Energy in springs and gears, and of the rotors [J]."""
        turned = self._drives[:, 5] * (self._drives[:, 0] == SERVO)
        stretch = (self._rotors[:, 0] - q)[turned > 0.0]
        gears = 0.5 * np.sum(self._drives[turned > 0.0, 6] * stretch**2)
        rows = zip(q, self._springs, strict=True)
        springs = sum(spring_energy(x, row) for x, row in rows if row[0] > 0.0)
        return float(gears + springs), float(0.5 * np.sum(turned * self._rotors[:, 1] ** 2))
