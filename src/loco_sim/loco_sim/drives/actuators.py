# SPDX-License-Identifier: Apache-2.0
"""Drives and springs of a robot, evaluated by one kernel call per physics step.

A joint that has neither in ``robot.yaml`` is free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite

import numpy as np

from loco_control.types import MotionCommand, TrunkTorque

from ..jit import kernel
from ..robot.robot import Robot
from ..robot.servo import AVERAGED, EFFORT, IMPEDANCE, PERIOD, SERVO, TORQUE
from ..robot.servo import COLUMNS as DRIVE_COLUMNS
from ..robot.spring import COLUMNS as SPRING_COLUMNS
from .servo_kernels import (
    INTEGRAL,
    MEMORY,
    ROTOR,
    SPIN,
    clipped,
    due,
    hold,
    impedance_torque,
    in_force,
    servo_torque,
    share,
)
from .spring_kernels import spring_energy, spring_torque

COMMANDS = 4  # rows of a command: positions, velocities, torques, swinging

MADE_OF = "eedea52c7f4c"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py


@kernel
def drive_torques(
    state: np.ndarray,
    command: np.ndarray,
    drives: np.ndarray,
    rotors: np.ndarray,
    dt: float,
    supply: float,
    on: float,
    tau: np.ndarray,
    step: int,
) -> None:
    """Torque of the drive of every joint, without springs.

    Args:
        state: Positions, then velocities of the joints [rad, rad/s], (2 n,).
        command: Desired positions, desired velocities, feed-forward torques, and a value above 0
            where the leg of the joint swings, (COMMANDS, n).
        drives: A row per joint, (n, COLUMNS).
        rotors: Memory of the drives, such as position and speed of a servo's rotor, (n, MEMORY);
            changed in place.
        dt: Physics step [s].
        supply: Voltage of the servos / nominal voltage [-].
        on: 1, or 0 for drives that are switched off.
        tau: Result [N·m], (n,).
        step: Number of the physics step; determines the sampling instants of the drives.
    """
    n = len(drives)
    for i in range(n):
        tau[i] = 0.0
        q, dq, row, memory = state[i], state[n + i], drives[i], rotors[i]
        sample = due(step, dt, row[PERIOD])
        if row[0] == SERVO:
            setpoint = hold(share(q, command[0, i], row), row, memory, sample)
            tau[i] = servo_torque(q, dq, setpoint, row, memory, dt, supply, on)
        elif row[0] == IMPEDANCE:
            each = row[PERIOD] <= 0.0 or row[AVERAGED] > 0.0
            time = dt if each else sample * max(row[PERIOD], dt)
            torque = impedance_torque(q, dq, command[:, i], row, memory, on * time)
            tau[i] = on * clipped(hold(torque, row, memory, sample), row[EFFORT])
        elif row[0] == TORQUE:
            torque_command = hold(command[2, i], row, memory, sample)
            tau[i] = on * clipped(row[1] * torque_command + row[2] - row[3] * dq, row[EFFORT])


@kernel
def add_springs(state, springs, tau):
    """Add the torques of springs and dampers parallel to the drives [N·m], in place.

    Args:
        state: Positions, then velocities of the joints, (2 n,).
        springs: A row per joint, (n, 7).
        tau: Torques of the drives after all effects [N·m], (n,); changed.
    """
    n = len(springs)
    for i in range(n):
        if springs[i, 0] > 0.0:
            tau[i] += spring_torque(state[i], state[n + i], springs[i])


@kernel
def drive_demand(state, command, drives, rotors, supply, on, dt, step, result):
    """Duty cycle commanded by each servo, in [-1, 1], and speed of its rotor [rad/s], in `result`.

    Both rows of `result`, (2, n), are 0 for other drives and for drives that are off. The other
    arguments are as in `drive_torques`.
    """
    for i in range(len(drives)):
        result[0, i] = result[1, i] = 0.0
        if drives[i, 0] == SERVO:
            setpoint = share(state[i], command[0, i], drives[i])
            sample = due(step, dt, drives[i, PERIOD])
            result[0, i] = supply * on * in_force(setpoint, drives[i], rotors[i], sample)
            result[1, i] = on * rotors[i, SPIN]


class Actuators:
    """Drives and springs of a robot.

    Attributes:
        q: Active desired joint positions [rad], (n,).
        dq: Active desired joint velocities [rad/s], (n,).
        supply: Voltage of the servos / nominal voltage [-].
        on: 1, or 0 while all drives are switched off; springs remain.
        dt: Physics step [s].
    """

    def __init__(self, robot: Robot, dt: float):
        n = len(robot.joints)
        self.dt, self._robot = dt, robot
        self._drives, self._springs = np.zeros((n, DRIVE_COLUMNS)), np.zeros((n, SPRING_COLUMNS))
        for i, joint in enumerate(robot.joints):
            if joint in robot.drives:
                self._drives[i] = robot.drives[joint].row(robot.effort[i])
            if joint in robot.springs:
                self._springs[i] = robot.springs[joint].row()
        self._driven = self._drives[:, 0] > 0.0
        self._all_driven = bool(self._driven.all())
        self._rotors, self._command = np.zeros((n, MEMORY)), np.zeros((COMMANDS, n))
        self._state, self._tau = np.empty(2 * n), np.empty(n)
        impedance = self._drives[:, 0] == IMPEDANCE
        self._two_gains = bool(np.any(self._drives[impedance, 1:3] != self._drives[impedance, 3:5]))
        self._swings: dict[bytes, np.ndarray] = {}  # by stance flags

    def reset(self, q: np.ndarray, step: int = 0) -> None:
        """Reset to hold a pose, with all legs in stance and the rotors at rest.

        Args:
            q: Joint positions of the pose [rad], (n,).
            step: Number of the next physics step; determines the sampling instants of the drives.
        """
        self._rotors[:], self._step = 0.0, step
        self._rotors[:, ROTOR] = q
        self.q, self.dq = np.array(q, dtype=float), np.zeros(len(q))
        self._command[:] = 0.0
        self._command[0] = q
        self.supply = self.on = 1.0

    def start(
        self, q: np.ndarray, dq: np.ndarray, step: int = 0, integral: np.ndarray | float = 0.0
    ) -> None:
        """As `reset`, with rotors that turn at the joint velocities and integrators that are not 0.

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            step: Number of the next physics step.
            integral: Torques of the integrators [N·m], (n,).
        """
        self.reset(q, step)
        self._rotors[:, SPIN], self._rotors[:, INTEGRAL] = dq, integral

    def rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Parameters of drives and of springs, and state of the drives, as in `drive_torques`."""
        return self._drives, self._springs, self._rotors

    def limit(self, effort: np.ndarray) -> None:
        """Set the torque limits of the drives [N·m], (n,)."""
        self._drives[:, EFFORT] = effort

    @property
    def command(self) -> np.ndarray:
        """The active command as a table with one entry, (1, COMMANDS, n); not a copy."""
        return self._command[None]

    def accept(self, command: MotionCommand, trunk: TrunkTorque) -> bool:
        """Activate a command; False, without any change, if it is not finite.

        Raises:
            ParameterError: The gains of a drive depend on the stance, and the number of flags in
                `trunk` differs from the number of feet.
        """
        total = command.q + command.dq + trunk.tau
        if not isfinite(sum((total if self._all_driven else total[self._driven]).tolist())):
            return False
        if self._two_gains:
            self._command[3] = self._swinging(trunk.stance)
        self.q, self.dq = command.q, command.dq
        self._command[0], self._command[1], self._command[2] = command.q, command.dq, trunk.tau
        return True

    def _swinging(self, stance: np.ndarray) -> np.ndarray:
        """`Robot.swinging` of a stance pattern, cached."""
        key = stance.tobytes()
        if key not in self._swings:
            self._swings[key] = self._robot.swinging(stance)
        return self._swings[key]

    def follow(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Replace the desired positions and velocities of the command, e.g. by delayed ones."""
        self._command[0], self._command[1] = q, dq

    def torque(
        self,
        q: Sequence[float],
        dq: Sequence[float],
        change: Callable[..., np.ndarray] | None = None,
        held: tuple[np.ndarray, np.ndarray] | None = None,
        transform: Callable[[np.ndarray], np.ndarray] | None = None,
    ) -> list[float]:
        """Joint torques within their limits in the next physics step [N·m], (n,).

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            change: Function that changes the motors in this step, with the arguments and result
                of the hook `on_motor` of effects; None for no change.
            held: Rows of drives and springs to use instead of the robot's.
            transform: Function that returns the changed torques of the drives in this step, (n,),
                before springs are added.
        """
        state, tau = self._state, self._tau
        drives, springs = held or (self._drives, self._springs)
        state[: len(tau)], state[len(tau) :] = q, dq
        if change:
            power, share = (self.supply, self.on, self.dt, self._step), np.empty((2, len(tau)))
            drive_demand(state, self._command, drives, self._rotors, *power, share)
            drives = change(drives, *share)
        power = self.dt, self.supply, self.on
        drive_torques(state, self._command, drives, self._rotors, *power, tau, self._step)
        if transform:
            tau[:] = transform(tau.copy())
        add_springs(state, springs, tau)
        self._step += 1
        return tau.tolist()

    def energy(self, q: np.ndarray) -> tuple[float, float]:
        """Potential energy in springs and gears, and kinetic energy of the rotors [J]."""
        inertia = self._drives[:, 5] * (self._drives[:, 0] == SERVO)
        stretch = (self._rotors[:, ROTOR] - q)[inertia > 0.0]
        gears = 0.5 * np.sum(self._drives[inertia > 0.0, 6] * stretch**2)
        rows = zip(q, self._springs, strict=True)
        springs = sum(spring_energy(x, row) for x, row in rows if row[0] > 0.0)
        return float(gears + springs), float(0.5 * np.sum(inertia * self._rotors[:, SPIN] ** 2))
