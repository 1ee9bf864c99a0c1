# SPDX-License-Identifier: Apache-2.0
"""Faults: frozen sensors and lost commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import parameter

from ..base import Effect
from ..identity import SENSOR_SIGNALS, Identity, LookAlike, Prior
from ..readings import Layout, Measuring

if TYPE_CHECKING:
    from ...world.world import World


@dataclass
class SensorStuck(Measuring, Effect, name="sensor_stuck"):
    """A sensor repeats its reading from the start of the fault."""

    channel: str = parameter("none", "sensor", choices=("none", *SENSOR_SIGNALS))
    index: int = parameter(-1, "index of joint, foot or axis; -1 is all", low=-1)

    identity = Identity(
        site="sensor",
        equation="y(t) <- y(start)",
        priors={},
        source="Isermann 2006, Fault-diagnosis systems, Springer",
        look_alikes=(
            LookAlike("end_stop", "push the joint further: only at a stop the torque rises"),
            LookAlike("sensor_latency", "wait: delayed values arrive, a stuck sensor stays"),
        ),
        touches=SENSOR_SIGNALS,
        smooth=False,
        untried="it has no size that could be fitted",
    )

    def absent(self) -> bool:
        return self.channel == "none"

    def configure(self, world: World) -> None:
        sizes = {"grf": len(world.robot.feet), "orientation": 4}
        sizes |= dict.fromkeys(("q", "dq", "tau"), len(world.robot.joints))
        size = sizes.get(self.channel, 3)
        if self.index >= size:
            raise ParameterError(
                f"effect sensor_stuck: index of {self.channel} must be in [-1, {size - 1}], "
                f"got {self.index}"
            )

    def reset(self, rng: np.random.Generator) -> None:
        self._held: np.ndarray | None = None

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        if self.channel == "none":
            return
        value = values[at[self.channel]]
        if self.channel == "grf":
            value = value.reshape(-1, 3)
        if self._held is None:
            self._held = value.copy()
        value[:] = stuck(value, self._held, self.index)


def stuck(value: np.ndarray, held: np.ndarray, index: int) -> np.ndarray:
    """`value` with the element (or row) `index` replaced by the one in `held`; all if -1."""
    if index < 0:
        return held
    mixed = value.copy()
    mixed[index] = held[index]
    return mixed


@dataclass
class CommandDropout(Effect, name="command_dropout"):
    """Motion commands are lost; the drives hold the last received command."""

    probability: float = parameter(0.0, "probability that a command is lost", low=0.0, high=1.0)
    needs = ("follower",)

    draws = True
    identity = Identity(
        site="outside",
        equation="q_d(k) <- q_d(k - 1) with this probability",
        priors={"probability": Prior(0.01, 0.05, 0.5)},
        source="Hespanha, Naghshtabrizi, Xu 2007, A survey of recent results in networked control "
        "systems, Proc. IEEE 95(1)",
        look_alikes=(
            LookAlike("command_delay", "slow ramp: lost commands make steps, late ones do not"),
            LookAlike("quantisation", "hold still at many angles: the sensor has steps"),
        ),
        touches=("command",),
        passive=False,
        smooth=False,
        untried="commands get lost at random times, which no prediction can follow",
    )

    def configure(self, world: World) -> None:
        self.require(world.robot)

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._sent: np.ndarray | None = None
        self._arrived: tuple[np.ndarray, np.ndarray] | None = None

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple:
        if q is not self._sent:  # a new command
            self._sent = q
            lost = self._rng.random() < self.probability
            if self._arrived is None or not lost:
                self._arrived = (q, dq)
        return self._arrived
