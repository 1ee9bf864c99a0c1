# SPDX-License-Identifier: Apache-2.0
"""Simulation of whole control periods in one compiled call, on engines that allow it.

Drives, springs and effects act as in `Simulation.step`; each step is a call of the engine's own C
function, contacts included.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from loco_control.exceptions import DivergedError

from ..drives.actuators import Actuators
from ..effects.base import ON_TORQUES, Effect, overrides, windows
from ..effects.chain import Chain, JointEffect
from ..effects.pulls import Pulls, laid_out
from ..effects.pulls import of as pulls
from ..effects.rows import NO_LAWS, ON_MOTOR, Laws
from ..world.world import World
from . import kernels
from .sensing import BASE
from .timetable import Script, behind_springs, commanding, received

IN_JOINTS = *ON_TORQUES, "on_motor", "on_brake"  # hooks that must be laws of `effects.laws`


class Acting(NamedTuple):
    """Actions of effects, as input arrays of `kernels.run`."""

    change: Laws  # laws of torques and motors
    brakes: Laws
    weakens: bool  # whether a law acts on motors
    motor_torque: bool  # whether measured torques are those of the drives alone
    hinges: np.ndarray  # stiffness, damping and inertia of each sprung hinge, (h, 3)
    pulls: Pulls
    slips: tuple[np.ndarray, np.ndarray]  # step and shape, (c, 2), and new friction, (c,)


def ordinary(effects: Sequence[Effect]) -> str:
    """Reason why effects cannot act in a compiled loop; "" if they can."""
    acting = [effect for effect in effects if not effect.absent()]
    for effect in acting:
        if any(overrides(effect, h) for h in IN_JOINTS) and not isinstance(effect, JointEffect):
            return f"{effect.name} has no compiled law"
    for effect, pull in pulls(acting):
        if pull is None and not effect.stateless:
            return f"{effect.name} looks at the world in each step"
    return behind_springs(acting)


class Compiled:
    """Compiled loop of one world, valid from a reset to the next.

    Args:
        world: Newly built world, of an engine with `handles`.
        drive: Drives and springs.
        effects: Effects that `ordinary` accepts, configured and reset.
        steps: Physics steps in a control period.
    """

    def __init__(self, world: World, drive: Actuators, effects: Sequence[Effect], steps: int):
        self._world, self._drive, self._dt = world, drive, world.dt
        self._handles, frames = world.handles(), world.frames()
        acting = [effect for effect in effects if not effect.absent()]
        forces = [effect for effect, pull in pulls(acting) if pull is not None]
        self._state_independent = windows(
            [e for e in acting if e.stateless and e not in forces], "on_step", self._dt
        )
        self._commands = commanding(acting, self._dt)
        brakes, change = self._laws(acting, "on_brake"), self._laws(acting, *ON_TORQUES)
        springs = [(*spring, felt) for spring, felt in world.sprung()]
        self._acting = Acting(
            change,
            brakes,
            any(overrides(e, "on_motor") and np.any(e.rows[:, ON_MOTOR]) for e in acting),
            world.robot.motor_torque,
            np.array(springs, float).reshape(-1, 3),
            laid_out(forces, frames, 0.0, self._dt),
            (np.zeros((0, 2), np.int64), np.zeros(0)),
        )
        self._measures = any(overrides(e, "on_measurement") for e in acting) and len(change.plan)
        self._script = Script(frames, {foot: world.shapes(foot) for foot in world.robot.feet})
        self._no_memory = np.zeros((0, *change.memory.shape))
        self._one = np.zeros(steps, dtype=np.int64)

    def engine_time(self, steps: int) -> float:
        """Processor time of `steps` steps of the engine alone [s]; the state advances."""
        kernels.step_engine(self._handles, 0)
        began = time.process_time()
        kernels.step_engine(self._handles, steps)
        return time.process_time() - began

    def restore_memory(self, memory_log: np.ndarray, row: int) -> None:
        """Restore the memory of effects on sensors at a row, if there is any."""
        if len(memory_log):
            self._acting.change.memory[:] = memory_log[row]

    def _laws(self, effects: Sequence[Effect], *hooks: str) -> Laws:
        acting = [e for e in effects if any(overrides(e, hook) for hook in hooks)]
        return Chain(acting, self._dt).laws() if acting else NO_LAWS

    def period(self, before: np.ndarray, first: int) -> np.ndarray:
        """States before and after a control period, rows of `sensing.readings`, (2, …).

        Args:
            before: State before the period.
            first: Number of the first physics step.

        Raises:
            DivergedError: The state is no longer finite.
        """
        drive = self._drive
        power, motions = np.array([[drive.supply, drive.on]]), [(drive.q, drive.dq)]
        rows, done, _ = self.run(drive.command, self._one, power, first, motions)
        if not done:
            raise DivergedError(f"the physics diverged by t = {first * self._dt:.3f} s (MuJoCo)")
        return rows

    def run(
        self,
        table: np.ndarray,
        which: np.ndarray,
        power: np.ndarray,
        first: int,
        targets: Sequence[tuple[np.ndarray, np.ndarray]] | None = None,
    ) -> tuple[np.ndarray, int, np.ndarray]:
        """Simulate a command sequence.

        Args:
            table: Commands as in `Actuators`, (k, COMMANDS, n).
            which: Index of the command of each physics step, (T * steps,).
            power: Supply and switch of the drives, (T, 2).
            first: Number of the first physics step.
            targets: Desired positions and velocities of each command, for effects that detect a
                new command by the identity of its arrays; None if all commands are new.

        Returns:
            The state before each row and after the last, as in `kernels.run`; the number of
            simulated rows; and the memory of effects, (T + 1, rows, MEMORY), empty if no
            sensor needs it.
        """
        acting, stop, n = self._acting, first + len(which), table.shape[2]
        if self._commands:
            targets = targets or [(row[0], row[1]) for row in table]
            table, which = received(self._commands, targets, which, table[:, 2:], first, self._dt)
        if self._state_independent:
            forces, slips = self._script.write(self._state_independent, first, stop, self._dt)
            both = (np.concatenate(pair) for pair in zip(acting.pulls, forces, strict=True))
            acting = acting._replace(pulls=Pulls(*both), slips=slips)
        out = np.zeros((len(power) + 1, 3 * n + len(self._handles.feet) + BASE))
        rows = len(power) + 1 if self._measures and len(power) > 1 else 0
        memory_rows = np.zeros((rows, *self._no_memory.shape[1:])) if rows else self._no_memory
        commands = table, which, power
        done = kernels.run(
            self._handles, self._drive.rows(), acting, commands, first, self._dt, memory_rows, out
        )
        self._world.moved()
        return out, done, memory_rows
