# SPDX-License-Identifier: Apache-2.0
"""Effects of joint friction, as braking torques.

A law gives the available braking torque (hook `on_brake`); the engine applies at most the part
that stops the joint. A torque `-torque sign(dq)` would make a joint at rest chatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.params import parameter

from .. import rows
from ..chain import BrakeEffect, JointEffect, TorqueEffect
from ..identity import Identity, LookAlike, Prior
from ..offers import Motion, Offer, at_most
from ..places import eligible, outward
from .delay import CommandRateLimit

_TOUCHES = ("brake",)


@dataclass
class CoulombFriction(BrakeEffect, name="coulomb_friction"):
    """Dry friction: a constant torque slows a moving joint and holds a joint at rest."""

    torque: float = parameter(0.0, "friction torque", "N·m", low=0.0, high=200.0)

    identity = Identity(
        site="friction",
        equation="|tau_f| <= torque, against dq; = torque while the joint moves",
        priors={"torque": Prior(0.005, 0.05, 2.0)},
        source="Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky 1998, Friction models and "
        "friction compensation, European Journal of Control 4(3)",
        look_alikes=(
            LookAlike("stribeck_friction", "very slow ramps: Stribeck friction falls with speed"),
            LookAlike("viscous_friction", "two speeds: viscous friction grows with speed"),
            LookAlike("hysteresis", "small reversals: hysteresis is elastic before it slides"),
            LookAlike("backlash", "hold against a load: friction holds, backlash does not"),
            LookAlike("load_friction", "hang a weight on the joint: load friction grows"),
        ),
        touches=_TOUCHES,
        kind="friction",
        smooth=False,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return (self.torque,)


@dataclass
class OwnFriction(CoulombFriction):
    """Dry friction of the joints of a robot itself, `Robot.joint_friction`."""

    def _joint_indices(self, world: Any) -> np.ndarray:
        has_friction = [joint in world.robot.joint_friction for joint in world.robot.joints]
        return np.flatnonzero(has_friction)

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        values = [world.robot.joint_friction[world.robot.joints[j]] for j in joints]
        return (np.array(values),)


# Largest Stribeck velocity over the largest measured speed, at which a ninth of the friction at rest
# is lost (theory): less is Coulomb friction for these data.
FALLS = 3.0


def inherent(robot: Any) -> list[JointEffect]:
    """Effects that a robot itself has: limited set-points of its drives, and its dry friction."""
    speeds = {j: getattr(drive, "setpoint_speed", 0.0) for j, drive in robot.drives.items()}
    limits = [CommandRateLimit(joint=j, slowness=1.0 / v) for j, v in speeds.items() if v > 0.0]
    return limits + [OwnFriction(torque=1.0)] * bool(robot.joint_friction)


@dataclass
class StribeckFriction(BrakeEffect, name="stribeck_friction"):
    """Dry friction at rest that vanishes with speed; add `coulomb_friction` for a constant part."""

    torque: float = parameter(0.0, "friction torque at rest", "N·m", low=0.0, high=200.0)
    velocity: float = parameter(0.1, "speed at which 37 % of it remains", "rad/s", 1e-4, 100.0)

    identity = Identity(
        site="friction",
        equation="|tau_f| <= torque exp(-(dq / velocity)^2), against dq",
        priors={"torque": Prior(0.005, 0.05, 2.0), "velocity": Prior(0.01, 0.1, 1.0)},
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, A survey of models, analysis "
        "tools and compensation methods for the control of machines with friction, "
        "Automatica 30(7)",
        look_alikes=(
            LookAlike("coulomb_friction", "slow and fast ramps: Coulomb friction is the same"),
            LookAlike("backlash", "hold and reverse a load: backlash has no breakaway torque"),
            LookAlike("hysteresis", "small reversals: hysteresis is elastic before it slides"),
        ),
        touches=_TOUCHES,
        kind="friction",
        smooth=False,
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """At each joint, with Stribeck velocities up to the measured speeds, or `FALLS` times these.

        Velocities above both the measured speeds and the usual ones are left out.
        """
        fast = np.asarray(motion.fast)
        usual = np.minimum(FALLS * fast, cls.identity.priors["velocity"].high)
        highest = dict(zip(robot.joints, np.maximum(fast, usual), strict=False))
        return [
            offer._replace(coordinates=tuple(
                at_most(c, float(highest.get(offer.place, np.nan))) if c.name == "velocity" else c
                for c in offer.coordinates
            ))
            for offer in super().offers(robot, signals, motion)
        ]  # fmt: skip

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return 0.0, self.torque, 1.0 / self.velocity


@dataclass
class ViscousFriction(BrakeEffect, name="viscous_friction"):
    """Friction in proportion to speed.

    As a braking torque it never does more than stop the joint, so it is always stable;
    it is accurate while damping dt / inertia is below 1.
    """

    damping: float = parameter(0.0, "damping", "N·m·s/rad", low=0.0, high=1000.0)

    identity = Identity(
        site="friction",
        equation="tau_f = -damping dq",
        priors={"damping": Prior(0.001, 0.05, 5.0)},
        source="Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky 1998, Friction models and "
        "friction compensation, European Journal of Control 4(3)",
        look_alikes=(
            LookAlike("coulomb_friction", "two speeds: dry friction is the same at both"),
            LookAlike("torque_speed_line", "brake the joint from outside: the line limits "
                                           "only a driving motor at full torque"),
            LookAlike("viscoelasticity", "step and hold: the torque decays; fast "
                                         "motion: it acts as a spring"),
            LookAlike("actuator_lag", "torque off: a lag does not change the free swing"),
        ),
        touches=_TOUCHES,
        kind="friction",
    )  # fmt: skip

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return 0.0, 0.0, 0.0, self.damping


@dataclass
class LoadFriction(BrakeEffect, name="load_friction"):
    """Dry friction of a gear, in proportion to the torque of its drive."""

    share: float = parameter(0.0, "friction torque per drive torque", "-", low=0.0, high=0.95)
    among = "driven"

    identity = Identity(
        site="friction",
        equation="|tau_f| <= share |tau_drive|, against dq",
        priors={"share": Prior(0.02, 0.1, 0.4)},
        source="Duclusaud, Passault, Padois, Ly 2024, Extended friction models for the physics "
        "simulation of servo actuators, arXiv 2410.08650 (model M3)",
        look_alikes=(
            LookAlike("coulomb_friction", "hang a weight on the joint: dry friction is the same"),
            LookAlike("torque_constant_error", "raise and lower a weight slowly: "
                                               "only friction changes its sign"),
        ),
        touches=_TOUCHES,
        kind="friction",
        smooth=False,
    )  # fmt: skip

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return 0.0, 0.0, 0.0, 0.0, self.share


@dataclass
class AsymmetricFriction(BrakeEffect, name="asymmetric_friction"):
    """Dry friction that depends on the direction of motion, as in worm gears and lip seals."""

    forward: float = parameter(0.0, "friction torque where dq > 0", "N·m", low=0.0, high=200.0)
    backward: float = parameter(0.0, "friction torque where dq < 0", "N·m", low=0.0, high=200.0)
    among = "driven"

    identity = Identity(
        site="friction",
        equation="|tau_f| <= forward where dq > 0, backward where dq < 0, against dq",
        priors={"forward": Prior(0.005, 0.05, 2.0), "backward": Prior(0.005, 0.05, 2.0)},
        strengths=("forward", "backward"),
        source="Armstrong-Helouvry, Dupont, Canudas de Wit 1994, A survey of models, analysis "
        "tools and compensation methods for the control of machines with friction, "
        "Automatica 30(7)",
        look_alikes=(
            LookAlike("coulomb_friction", "both directions: Coulomb friction is the same"),
            LookAlike("torque_bias", "at rest, no load: a bias acts, friction does not"),
        ),
        touches=_TOUCHES,
        kind="friction",
        smooth=False,
        untried="dry friction that is the same both ways is a case of it and would lose its name; "
        "coulomb_friction with torque_bias moves as it does",
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.forward, 0.0, 0.0, 0.0, 0.0, self.backward - self.forward


@dataclass
class CoupledFriction(TorqueEffect, name="coupled_friction"):
    """Friction of a part that turns with a joint and the next one outwards; it acts on both.

    It depends on the sum of their speeds, as in a wrist where the motor of one axis sits behind
    the other. Dry friction has an elastic pre-sliding range (`hysteresis`).
    """

    torque: float = parameter(0.0, "dry friction torque", "N·m", low=0.0, high=200.0)
    damping: float = parameter(0.0, "viscous damping", "N·m·s/rad", low=0.0, high=1000.0)
    stroke: float = parameter(0.01, "displacement after which it reaches 63 %", "rad", 1e-4, 3.0)
    law, among, shared = rows.COUPLED, "followed", True

    identity = Identity(
        site="friction",
        equation="w = dq + dq_next; stroke dz/dt = w - |w| z; both joints: tau <- tau - torque z "
        "- damping w",
        priors={"torque": Prior(0.005, 0.05, 2.0), "damping": Prior(0.001, 0.05, 5.0)},
        strengths=("torque", "damping"),
        source="Gautier, Vandanjon, Presse 1994, Identification of inertial and drive gain "
        "parameters of robots, IEEE Conf. Decision and Control (coupled wrist)",
        look_alikes=(
            LookAlike("coulomb_friction", "move one joint alone: a torque acts on the other"),
            LookAlike("viscous_friction", "move one joint alone: a torque acts on the other"),
        ),
        touches=("torque",),
        kind="friction",
    )

    @classmethod
    def places(cls, robot: Any) -> list[str]:
        return [robot.joints[j] for j in eligible(robot, cls.among)]

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.torque, self.stroke, self.damping, outward(world.robot)[joints]

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        return float(0.5 * self.torque * self.stroke * np.sum(self.memory[:, 0] ** 2))


@dataclass
class FrictionCompensation(TorqueEffect, name="friction_compensation"):
    """The drive feeds forward dry and viscous friction: a torque with the motion, not against it.

    What it adds to the friction of the model is negative. Torque readings do not include it, as
    with commands that are logged before the compensation.
    """

    torque: float = parameter(0.0, "compensated dry friction", "N·m", 0.0, 200.0)
    damping: float = parameter(0.0, "compensated viscous damping", "N·m·s/rad", 0.0, 1000.0)
    velocity: float = parameter(0.03, "speed at which it is 76 % of `torque`", "rad/s", 1e-4, 10.0)
    law, among = rows.COMPENSATION, "driven"

    identity = Identity(
        site="friction",
        kind="compensation",
        equation="tau <- tau + torque tanh(dq / velocity) + damping dq",
        priors={
            "torque": Prior(0.005, 0.05, 2.0),
            "damping": Prior(0.001, 0.05, 5.0),
            "velocity": Prior(0.003, 0.03, 0.3),
        },
        strengths=("torque", "damping"),
        source="Olsson, Astrom, Canudas de Wit, Gafvert, Lischinsky 1998, Friction models and "
        "friction compensation, European Journal of Control 4(3)",
        look_alikes=(
            LookAlike("torque_constant_error", "hold a known weight: only a constant shows"),
            LookAlike("actuation_delay", "drive off, swing freely: a delay does not act"),
            LookAlike("armature", "constant speed: inertia needs no torque"),
        ),
        touches=("torque",),
        passive=False,
    )

    def constants(self, world: Any, joints: np.ndarray) -> Sequence[Any]:
        return self.torque, self.velocity, self.damping
