# SPDX-License-Identifier: Apache-2.0
"""Fused execution of effects in the joints by one kernel call.

An effect in the joints specifies a compiled law (`laws`), the joints, and the constants of
each. A `Chain` runs a list of them in order, each in its time window, with one kernel call:
for a dozen joints a call from Python costs ten times as much as a law.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import parameter

from .base import Effect, span
from .places import AMONG, eligible, joint_places
from .rows import CONSTANTS, DELAY, MAX_INT, MEMORY, ON_MOTOR, Laws

if TYPE_CHECKING:
    from ..world.world import World

HOOKS = {  # method of a chain by hook
    "on_drive": "drive", "on_torque": "torque", "on_motor": "motor", "on_brake": "brake",
}  # fmt: skip


class Chain:
    """Laws of several effects, in order, as one function."""

    def __init__(self, effects: Sequence[JointEffect], dt: float):
        """Allocate the rows and memory of the effects, which must be configured.

        Args:
            effects: Effects in the order in which they act.
            dt: Physics step [s].
        """
        from . import laws  # imported here, so that reading an experiment does not load numba

        self._kernels = laws
        rows = np.cumsum([0, *(len(e.joints) for e in effects)])
        windows = [(first, min(last, MAX_INT)) for first, last in (span(e, dt) for e in effects)]
        self._plan = np.array(
            [
                (e.law, a, b, *window)
                for e, a, b, window in zip(effects, rows[:-1], rows[1:], windows, strict=True)
            ],
            dtype=np.int64,
        )
        self._joint = np.concatenate([e.joints for e in effects])
        self._const = np.concatenate([e.rows for e in effects])
        self._memory = np.zeros((rows[-1], MEMORY))
        for effect, a, b in zip(effects, rows[:-1], rows[1:], strict=True):
            effect.memory, effect.in_chain = self._memory[a:b], slice(a, b)
        self._line = np.zeros(self._lay_lines())

    def _lay_lines(self) -> int:
        """Set the start of the delay line of each delaying row; the total length."""
        length = 0
        for law, first, last, *_ in self._plan:
            for row in self._const[first:last] if law == DELAY else ():
                row[1] = length
                length += int(row[0])
        return length

    def laws(self) -> Laws:
        """Arrays of the chain, which its kernels change."""
        return Laws(self._plan, self._joint, self._const, self._memory, self._line)

    def torque(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Hook `on_torque` of all effects."""
        return self._changed(False, tau, q, dq, dt, t)

    def drive(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Hook `on_drive` of all effects."""
        return self._changed(True, tau, q, dq, dt, t)

    def _changed(
        self, of_drives: bool, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        out, step = tau.copy(), round(t / dt)
        self._kernels.torques(of_drives, step, dt, self.laws(), out, q, dq)
        return out

    def motor(
        self, rows: np.ndarray, duty: np.ndarray, speed: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Hook `on_motor` of all effects."""
        out, step = rows.copy(), round(t / dt)
        self._kernels.motors(step, self._plan, self._joint, self._const, out, duty, speed)
        return out

    def brake(
        self,
        budget: np.ndarray,
        tau: np.ndarray,
        q: np.ndarray,
        dq: np.ndarray,
        dt: float,
        t: float,
    ) -> np.ndarray:
        """Hook `on_brake` of all effects."""
        out = budget.copy()
        self._kernels.budgets(round(t / dt), self._plan, self._joint, self._const, out, tau, dq)
        return out


def fused(effects: list[JointEffect], hook: str, dt: float) -> Any:
    """A function that runs a hook of several effects."""
    return getattr(Chain(effects, dt), HOOKS[hook])


@dataclass
class JointEffect(Effect):
    """Base of effects in the joints: a law, the joints it acts on, the constants of each."""

    joint: str = parameter("", "joints, by name or pattern; empty is all that it applies to")

    law = 0  # number of the law in `rows`
    among: ClassVar[str] = "all"  # joints it applies to, a key of `AMONG`

    @classmethod
    def lacks(cls, robot: Any) -> str:
        missing = super().lacks(robot)
        return missing or ("" if len(eligible(robot, cls.among)) else AMONG[cls.among])

    @classmethod
    def places(cls, robot: Any) -> list[str]:
        return [""] if cls.shared else joint_places(robot, cls.among)

    @classmethod
    def fuse(cls, hook: str) -> Any:
        return fused if hook in HOOKS else super().fuse(hook)

    def constants(self, world: World, joints: np.ndarray) -> Sequence[Any]:
        """Constants of the law, each a number or an array over the joints.

        Args:
            world: The configured world, see `configure`.
            joints: Indices of the joints, (k,).
        """
        raise NotImplementedError

    def configure(self, world: World) -> None:
        self.require(world.robot)
        self.joints, self._dt = self._joint_indices(world), world.dt
        self.rows = np.zeros((len(self.joints), CONSTANTS))
        for column, value in enumerate(self.constants(world, self.joints)):
            self.rows[:, column] = value

    def reset(self, rng: np.random.Generator) -> None:
        self._chain = Chain([self], self._dt)

    def _joint_indices(self, world: World) -> np.ndarray:
        fitting = eligible(world.robot, self.among)
        if not len(fitting):
            self._refuse(f"robot {world.robot.name!r}")
        if not self.joint:
            return fitting
        named = world.joint_index(self.joint)
        if strange := sorted(set(named) - set(fitting)):
            self._refuse(", ".join(world.robot.joints[j] for j in strange))
        return named

    def _refuse(self, what: str) -> None:
        raise ParameterError(f"effect {self.name} does not apply to {what}: no {AMONG[self.among]}")


@dataclass
class TorqueEffect(JointEffect):
    """Base of effects parallel to the drives, such as springs, which change the joint torques."""

    def on_torque(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        return self._chain.torque(tau, q, dq, dt, t)


@dataclass
class DriveEffect(JointEffect):
    """Base of effects on the torques of the drives, without those of parallel springs."""

    def on_drive(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        return self._chain.drive(tau, q, dq, dt, t)


@dataclass
class MotorEffect(DriveEffect):
    """Base of effects on the motor torque, in a geared servo before rotor and gear.

    Behind the gear it would act as a slipping clutch, without any effect on the rotor.
    """

    def configure(self, world: World) -> None:
        super().configure(world)
        drives = [world.robot.drives.get(world.robot.joints[j]) for j in self.joints]
        self.rows[:, ON_MOTOR] = [getattr(drive, "rotor_inertia", 0.0) > 0.0 for drive in drives]

    def on_motor(
        self, rows: np.ndarray, duty: np.ndarray, speed: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        return self._chain.motor(rows, duty, speed, dt, t)


@dataclass
class BrakeEffect(JointEffect):
    """Base of friction effects, which add to the braking torque of joints.

    The constants of its law are dry torque, extra torque at rest, inverse of the Stribeck
    velocity of that extra torque, viscous damping, and share of the drive torque.
    """

    def on_brake(
        self,
        budget: np.ndarray,
        tau: np.ndarray,
        q: np.ndarray,
        dq: np.ndarray,
        dt: float,
        t: float,
    ) -> np.ndarray:
        return self._chain.brake(budget, tau, q, dq, dt, t)
