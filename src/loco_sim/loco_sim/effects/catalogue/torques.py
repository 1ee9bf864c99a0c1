# SPDX-License-Identifier: Apache-2.0
"""Additional joint torques: bias, torque ripple, gravity compensation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import parameter

from .. import rows
from ..base import Effect
from ..chain import TorqueEffect
from ..identity import Identity, LookAlike, Prior
from ..offers import Motion, Offer, logarithmic, strength
from .compliance import Elastic


@dataclass
class TorqueBias(Elastic, name="torque_bias"):
    """A constant torque on a joint, from an offset of the drive or a constant force."""

    torque: float = parameter(0.0, "torque", "N·m", -500.0, 500.0)
    law, among = rows.WAVE, "driven"

    identity = Identity(
        site="actuator",
        equation="tau <- tau + torque",
        priors={"torque": Prior(-2.0, 0.0, 2.0)},
        source="Gautier, Briot 2014, Global identification of joint drive gains and dynamic "
        "parameters of robots, J. Dynamic Systems, Measurement and Control 136(5) (offset)",
        look_alikes=(
            LookAlike("slope", "turn the bench around, or level it: a bias does not change"),
            LookAlike("asymmetric_friction", "at rest without a load: friction does not act"),
            LookAlike("com_offset", "two postures: only the torque of a weight changes"),
            LookAlike("joint_offset", "two gains: a bias deflects the joint less at the higher"),
        ),
        touches=("torque",),
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return 0.0, 0.0, self.torque


@dataclass
class TorqueRipple(TorqueEffect, name="torque_ripple"):
    """A torque that is periodic in the angle: cogging of a motor, teeth of a gear."""

    sine: float = parameter(0.0, "amplitude of the sine", "N·m", -200.0, 200.0)
    cosine: float = parameter(0.0, "amplitude of the cosine", "N·m", -200.0, 200.0)
    count: float = parameter(12.0, "periods in 2 pi of the joint", "-", 0.1, 1000.0)
    law, among = rows.WAVE, "driven"

    identity = Identity(
        site="actuator",
        equation="tau <- tau + sine sin(count q) + cosine cos(count q)",
        priors={
            "sine": Prior(-0.3, 0.0, 0.3),
            "cosine": Prior(-0.3, 0.0, 0.3),
            "count": Prior(2.0, 12.0, 100.0),
        },
        strengths=("sine", "cosine"),
        source="Holtz, Springob 1996, Identification and compensation of torque ripple in "
        "high-precision permanent magnet motor drives, IEEE Trans. Industrial Electronics 43(2)",
        look_alikes=(
            LookAlike("coulomb_friction", "constant speed: ripple varies, friction does not"),
            LookAlike("torque_bias", "turn by half a period: ripple changes its sign"),
        ),
        touches=("torque",),
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """At each joint with a residual that is periodic in the angle."""
        free = strength(cls, "sine", 0.1), strength(cls, "cosine", 0.1)
        return [
            Offer(joint, (("joint", joint),), (*free, logarithmic(cls, "count", counts)))
            for joint, counts in zip(robot.joints, motion.ripples, strict=False)
            if counts and joint in robot.drives
        ]

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.sine, self.count, self.cosine

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        at = self.count * q[self.joints]
        return float(np.sum(self.sine * np.cos(at) - self.cosine * np.sin(at)) / self.count)


@dataclass
class GravityCompensation(Effect, name="gravity_compensation"):
    """The drives of a fixed-base robot compensate a share of its weight by themselves.

    Torque readings do not include it, as with controllers that subtract it.
    """

    share: float = parameter(0.0, "compensated share of the weight", "-", -1.0, 2.0)
    needs, lasting = ("bolted", "drives", "turns"), True

    identity = Identity(
        site="actuator",
        equation="tau <- tau + share g(q), g the torque that holds the model",
        priors={"share": Prior(-1.0, 0.0, 1.0)},
        source="Siciliano, Sciavicco, Villani, Oriolo 2009, Robotics, section 8.5.1 (PD control "
        "with gravity compensation)",
        look_alikes=(
            LookAlike("payload", "fast motions: a payload adds inertia, compensation does not"),
            LookAlike("com_offset", "fast motions: a centre of mass also changes inertia"),
            LookAlike("torque_bias", "two postures: a bias does not change"),
        ),
        touches=("model",),
    )

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        world.compensated += self.share
