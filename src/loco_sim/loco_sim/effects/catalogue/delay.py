# SPDX-License-Identifier: Apache-2.0
"""Pure delays of the motion command to the drives, and of the torque."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import parameter

from .. import rows
from ..base import Effect
from ..chain import DriveEffect
from ..identity import Identity, LookAlike, Prior


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

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return (round(self.period / world.dt) * world.dt,)
