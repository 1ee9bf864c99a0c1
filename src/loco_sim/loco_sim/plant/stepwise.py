# SPDX-License-Identifier: Apache-2.0
"""Simulation of control periods step by step in Python, for any engine and effect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..drives.actuators import Actuators
from ..drives.damping import DampedDrives
from ..effects.base import Effect, windows
from ..geometry import added
from ..world.world import World

HOOKS = "on_command", "on_motor", "on_drive", "on_torque", "on_brake", "on_step"


def sensor_row(world: World, q: Sequence[float], dq: Sequence[float], forces: Sequence[float]):
    """State of a world as a row of `sensing.readings`.

    Args:
        world: The world.
        q: Joint positions [rad], (n,).
        dq: Joint velocities [rad/s], (n,).
        forces: Joint torques [N·m], then forces on the feet [N].
    """
    position, orientation, velocity, spin = world.base()
    return np.array([*q, *dq, *forces, *position, *orientation, *velocity, *spin])


class Stepwise:
    """Loop of one world, valid from a reset to the next; same interface as `compiled.Compiled`.

    Args:
        world: Newly built world.
        drive: Drives and springs.
        effects: Effects, configured and reset.
        damped: The drives if their damping is implicit, else None.
        steps: Physics steps in a control period.
    """

    def __init__(
        self,
        world: World,
        drive: Actuators,
        effects: Sequence[Effect],
        damped: DampedDrives | None,
        steps: int,
    ):
        self._world, self._drive, self._damped = world, drive, damped
        self._steps, self._mean, self._dt = steps, world.params.grf == "mean", world.dt
        schedules = [windows(effects, hook, world.dt) for hook in HOOKS]
        self._on_command, self._on_motor, self._on_drive = schedules[:3]
        self._on_torque, self._on_brake, self._on_step = schedules[3:]
        self._affected = any(schedules)
        self._joints = world.joint_states()
        self._drive_tau = np.zeros(len(world.robot.joints))  # torques of drives after effects

    def period(self, before: np.ndarray, first: int) -> np.ndarray:
        """States before and after a control period, rows of `sensing.readings`, (2, …).

        Args:
            before: State before the period.
            first: Number of the first physics step.

        Raises:
            DivergedError: The state is no longer finite.
        """
        world, taus = self._world, []
        grf = [0.0] * (3 * len(world.robot.feet))
        alone = world.robot.motor_torque
        torque = self._affected_torque if self._affected or alone else self._drive.torque
        for step in range(first, first + self._steps):
            self._step = step
            if self._damped:
                tau = self._damped_step(self._damped)
            else:
                tau = torque(*self._joints)
                world.step(tau)
                self._joints = world.joint_states()
            taus.append(self._drive_tau if alone and not self._damped else tau)
            if self._mean or step == first + self._steps - 1:
                world.add_ground_forces(grf)
        if self._mean:
            grf = [force / self._steps for force in grf]
        tau = [added(steps) / self._steps for steps in zip(*taus, strict=True)]
        return np.array((before, sensor_row(world, *self._joints, tau + grf)))

    def _damped_step(self, damped: DampedDrives) -> list[float]:
        """One physics step with implicit damping; the torques that acted [N·m], (n,)."""
        t = self._step * self._dt
        self._send_command(t)
        self._acted(t)
        tau, law = damped.laws(*self._joints)
        acted = self._world.damped_step(tau, law)
        self._joints = self._world.joint_states()
        return damped.delivered(tau, *acted)

    def _affected_torque(self, q: list[float], dq: list[float]) -> list[float]:
        """Joint torques of this physics step with all active effects [N·m], (n,)."""
        t = self._step * self._dt
        self._send_command(t)
        state = np.array(q), np.array(dq)

        def changed(tau: np.ndarray) -> np.ndarray:
            self._drive_tau = self._passed(self._on_drive, tau, *state, t)
            return self._drive_tau

        tau = self._drive.torque(q, dq, self._motors if self._on_motor else None, None, changed)
        if self._on_torque:
            tau = self._passed(self._on_torque, np.array(tau), *state, t).tolist()
        if self._on_brake:
            self._brake(self._drive_tau, *state, t)
        self._acted(t)
        return tau

    def _send_command(self, t: float) -> None:
        """Pass the command to the drives, as changed by effects."""
        step, drive = self._step, self._drive
        if self._on_command:
            motion = drive.q, drive.dq
            for start, stop, change in self._on_command:
                if start <= step < stop:
                    motion = change(*motion, t)
            drive.follow(*motion)

    def _acted(self, t: float) -> None:
        """Run the hooks `on_step` of active effects."""
        for start, stop, act in self._on_step:
            if start <= self._step < stop:
                act(self._world, t)

    def _motors(self, rows: np.ndarray, duty: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Motor parameter rows in this physics step, with all active effects."""
        step, dt = self._step, self._dt
        for start, stop, change in self._on_motor:
            if start <= step < stop:
                rows = change(rows, duty, speed, dt, step * dt)
        return rows

    def _passed(
        self, hooks: list, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, t: float
    ) -> np.ndarray:
        """Torques after the given hooks of active effects [N·m], (n,)."""
        for start, stop, change in hooks:
            if start <= self._step < stop:
                tau = change(tau, q, dq, self._dt, t)
        return tau

    def _brake(self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, t: float) -> None:
        """Apply the friction of active effects, from the torques of the drives."""
        budget = np.zeros(len(tau))
        for start, stop, brake in self._on_brake:
            if start <= self._step < stop:
                budget = brake(budget, tau, q, dq, self._dt, t)
        self._world.brake(budget, dq)
