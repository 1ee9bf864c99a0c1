# SPDX-License-Identifier: Apache-2.0
"""All drives and springs of a robot, one kernel call per physics step.

A joint that has neither in ``robot.yaml`` is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np
from numba import njit

from loco_control.types import MotionCommand, TrunkTorque

from ..robot.robot import Robot
from ..robot.servo import COLUMNS as DRIVE_COLUMNS
from ..robot.servo import IMPEDANCE, SERVO, TORQUE
from ..robot.spring import COLUMNS as SPRING_COLUMNS
from .servo_kernels import clipped, impedance_torque, servo_torque, share
from .spring_kernels import spring_energy, spring_torque

COMMANDS = 4  # rows of a command: positions, velocities, torques, swinging

MADE_OF = "c2fc449d1bc3"  # of the kernels called here: see tests/loco_sim/test_kernel_caches.py


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
        command: Positions, velocities, torques wanted, and above 0 where the leg of the joint
            swings, (COMMANDS, n).
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
            swings = command[3, i] > 0.0
            tau[i] = on * impedance_torque(
                q, dq, command[0, i], command[1, i], command[2, i], row, swings
            )
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
    """Drives and springs of a robot.

    Attributes:
        q: Desired joint positions in force [rad], (n,).
        dq: Desired joint velocities in force [rad/s], (n,).
        supply: Voltage of the servos over the nominal one.
        on: 1, or 0 while all drives are switched off; springs remain.
    """

    def __init__(self, robot: Robot, dt: float):
        n = len(robot.joints)
        self._dt, self._robot = dt, robot
        self._drives, self._springs = np.zeros((n, DRIVE_COLUMNS)), np.zeros((n, SPRING_COLUMNS))
        for i, joint in enumerate(robot.joints):
            if joint in robot.drives:
                self._drives[i] = robot.drives[joint].row(robot.effort[i])
            if joint in robot.springs:
                self._springs[i] = robot.springs[joint].row()
        self._driven = self._drives[:, 0] > 0.0
        self._whole = bool(self._driven.all())
        self._rotors, self._command = np.zeros((n, 2)), np.zeros((COMMANDS, n))
        self._state, self._tau = np.empty(2 * n), np.empty(n)
        impedance = self._drives[:, 0] == IMPEDANCE
        self._two_gains = bool(np.any(self._drives[impedance, 1:3] != self._drives[impedance, 3:5]))
        self._swings: dict[bytes, np.ndarray] = {}  # by stance flags

    def reset(self, q: np.ndarray) -> None:
        """Hold a pose [rad], (n,), with all legs in stance and the rotors at rest."""
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

    def limit(self, effort: np.ndarray) -> None:
        """Change the largest torques of the drives [N·m], (n,)."""
        self._drives[:, -1] = effort

    @property
    def command(self) -> np.ndarray:
        """The command in force as a table of one, (1, COMMANDS, n); not a copy."""
        return self._command[None]

    def accept(self, command: MotionCommand, trunk: TrunkTorque) -> bool:
        """Take a command over; False, and nothing changes, if it is not finite.

        Raises:
            ParameterError: The gains of a drive depend on who stands, and the flags of
                `trunk` are not as many as the feet.
        """
        asked = command.q + command.dq + trunk.tau
        if not isfinite(sum((asked if self._whole else asked[self._driven]).tolist())):
            return False
        if self._two_gains:
            self._command[3] = self._swinging(trunk.stance)
        self.q, self.dq = command.q, command.dq
        self._command[0], self._command[1], self._command[2] = command.q, command.dq, trunk.tau
        return True

    def _swinging(self, stance: np.ndarray) -> np.ndarray:
        """`Robot.swinging` of a stance pattern, computed once."""
        key = stance.tobytes()
        if key not in self._swings:
            self._swings[key] = self._robot.swinging(stance)
        return self._swings[key]

    def follow(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Follow these references instead of the command's, e.g. late ones."""
        self._command[0], self._command[1] = q, dq

    def torque(
        self,
        q: Sequence[float],
        dq: Sequence[float],
        change: Callable[..., np.ndarray] | None = None,
        held: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> list[float]:
        """Joint torques within their limits [N·m], (n,).

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            change: Changes the motors in this step: takes and gives back what the hook
                `on_motor` of effects does; None leaves them alone.
            held: Rows of drives and springs to use instead of the robot's.
        """
        state, tau = self._state, self._tau
        drives, springs = held or (self._drives, self._springs)
        state[: len(tau)], state[len(tau) :] = q, dq
        if change:
            power = self.supply, self.on
            drives = change(drives, *asked(state, self._command, drives, self._rotors, *power))
        joint_torques(
            state,
            self._command,
            drives,
            springs,
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
