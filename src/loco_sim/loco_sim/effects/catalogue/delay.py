# SPDX-License-Identifier: Apache-2.0
"""Delays of the command to the drives and of the torque, and limited rates of the command."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import parameter

from ... import lazy
from .. import rows
from ..base import Effect
from ..chain import DriveEffect, JointEffect
from ..identity import Identity, LookAlike, Prior
from ..offers import Motion, Offer, strength
from ..places import members

reading_laws = lazy.module("loco_sim.effects.reading_laws")


def delayed(pending: deque, value: Any, steps: int) -> Any:
    """The value of `steps` calls ago; the first value during the first `steps` calls.

    Args:
        pending: Pending values, oldest first; changed in place.
        value: Newest value.
        steps: Delay in calls, >= 0.
    """
    pending.append(value)
    return pending.popleft() if len(pending) > steps else pending[0]


@dataclass
class CommandDelay(Effect, name="command_delay"):
    """Motion commands reach the drives late, by a whole number of physics steps.

    At its start, the current command is held until the delayed commands arrive.
    Source: thesis chapter 8, a delay between network and motors of unpublished size.
    """

    delay: float = parameter(0.0, "delay, rounded to physics steps", "s", low=0.0, high=1.0)
    needs = ("follower",)

    identity = Identity(
        site="actuator",
        kind="delay",
        equation="q_d(t) <- q_d(t - delay)",
        priors={"delay": Prior(0.002, 0.02, 0.2)},
        source="thesis section 5.3.2.2 (about 100 ms on Tigrillo) and chapter 8",
        look_alikes=(
            LookAlike("actuation_delay", "push the robot by hand: only "
                                         "a late torque reduces damping"),
            LookAlike("sensor_latency", "measure the motion by a second, external sensor"),
            LookAlike("actuator_lag", "chirp: a lag reduces the amplitude, a delay does not"),
            LookAlike("command_dropout", "slow ramp: lost commands make steps"),
        ),
        touches=("command",),
        passive=False,
        smooth=False,
        twins=("sensor_latency",),  # of all sensors: the whole motion is late by the same time
        whole_steps="delay",
    )  # fmt: skip

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        self.steps = round(self.delay / world.dt)

    def reset(self, rng: np.random.Generator) -> None:
        self._pending: deque = deque()

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple:
        return delayed(self._pending, (q, dq), self.steps)

    def on_sequence(self, targets: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`on_command` for a whole run: commands, (k, 4, n), and their index at each step."""
        late = min(self.steps, len(which))
        return targets, np.concatenate([np.full(late, which[0]), which[: len(which) - late]])


@dataclass
class CommandRateLimit(JointEffect, name="command_rate_limit"):
    """The desired position follows the command at a limited speed, as by a velocity profile.

    Desired velocities are clipped to that speed. At its start, the current command is reached.
    """

    slowness: float = parameter(0.0, "one over the largest speed", "s/rad", low=0.0, high=1e4)
    among, needs = "driven", ("follower",)

    identity = Identity(
        site="outside",
        kind="rate limit",
        equation="slowness |dq_d/dt| <= 1",
        priors={"slowness": Prior(0.05, 0.5, 5.0)},
        source="Biagiotti, Melchiorri 2008, Trajectory planning for automatic machines and robots, "
        "Springer, chapter 4 (online filters of set-points)",
        look_alikes=(
            LookAlike("viscous_friction", "small steps: their first part is as fast as before"),
            LookAlike("actuator_lag", "steps of two sizes: a limited rate takes twice as long"),
            LookAlike("command_delay", "slow ramp: a limited rate is not late"),
            LookAlike("torque_speed_line", "push the joint by hand: its drive is as strong"),
        ),
        touches=("command",),
        passive=False,
        smooth=False,
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """At each joint, from a limit on that is as fast as the joint was measured to be."""
        fast = dict(zip(robot.joints, motion.fast, strict=False))
        offers = []
        for place in cls.places(robot):
            speed = max((float(fast.get(j, np.nan)) for j in members(robot, place)), default=np.nan)
            size = 1.0 / speed if speed > 0.0 else cls.identity.priors["slowness"].typical
            offers.append(Offer(place, (("joint", place),), (strength(cls, "slowness", size),)))
        return offers

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return ()

    def reset(self, rng: np.random.Generator) -> None:
        self._sent = self._received = None

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple:
        if self._received is None:
            self._received = q, dq
        if q is not self._sent or np.any(self._received[0] != q):
            self._sent, change = q, np.array([[self._received[0], dq], [q, dq]])
            reading_laws.slew(change, self.joints, 1.0 / self.slowness, self._dt)
            self._received = change[1, 0], change[1, 1]
        return self._received

    def on_sequence(self, targets: np.ndarray, which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """`on_command` for a whole run: commands, (k, 4, n), and their index at each step."""
        steps = targets[which]
        reading_laws.slew(steps, self.joints, 1.0 / self.slowness, self._dt)
        return steps, np.arange(len(steps))

    def amount(self, robot: Any) -> str:
        return f"the limit is {1.0 / self.slowness:.3g} rad/s" if self.slowness else ""


@dataclass
class ActuationDelay(DriveEffect, name="actuation_delay"):
    """Joint torques act late, by a whole number of physics steps.

    At its start, the current torque is held until the delayed torques arrive.
    The delay is inside the impedance loop, so it reduces damping.
    """

    delay: float = parameter(0.0, "delay, rounded to physics steps", "s", low=0.0, high=1.0)
    law, among = rows.DELAY, "driven"

    identity = Identity(
        site="actuator",
        kind="delay",
        equation="tau(t) <- tau(t - delay)",
        priors={"delay": Prior(0.001, 0.005, 0.05)},
        source="Tan et al. 2018, Sim-to-real: learning agile locomotion for quadruped robots, RSS",
        look_alikes=(
            LookAlike("command_delay", "push by hand: a late command does not reduce damping"),
            LookAlike("actuator_lag", "chirp: a lag reduces the amplitude, a delay does not"),
            LookAlike("backlash", "constant bias torque: backlash has no effect"),
        ),
        touches=("drive",),
        passive=False,
        smooth=False,
        whole_steps="delay",
    )

    @property
    def lateness(self) -> float:
        """Time by which torques are late [s]."""
        return self.delay

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return (round(self.delay / world.dt),)


@dataclass
class TorqueHold(DriveEffect, name="torque_hold"):
    """A digital controller samples its torque once per period and holds it until the next sample.

    The mean delay of half a period is inside the impedance loop, so it reduces damping. Samples are
    at multiples of the period, which is rounded to physics steps.
    """

    period: float = parameter(0.0, "period of the samples", "s", low=0.0, high=1.0)
    law, among = rows.HOLD, "driven"

    identity = Identity(
        site="actuator",
        kind="delay",
        equation="tau(t) <- tau(period floor(t / period))",
        priors={"period": Prior(0.002, 0.005, 0.05)},
        source="Franklin, Powell, Workman 1998, Digital control of dynamic systems, chapter 5",
        look_alikes=(
            LookAlike("actuation_delay", "record faster than the period: held torques are steps"),
            LookAlike("actuator_lag", "chirp: a lag reduces the amplitude, a hold hardly does"),
        ),
        touches=("drive",),
        passive=False,
        smooth=False,
        whole_steps="period",
    )

    @property
    def lateness(self) -> float:
        """Time by which torques are late on average [s]."""
        return 0.5 * self.period

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return (round(self.period / world.dt) * world.dt,)
