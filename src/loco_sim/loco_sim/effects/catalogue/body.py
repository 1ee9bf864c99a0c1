# SPDX-License-Identifier: Apache-2.0
"""Effects of the body: mass, centre of mass, rotor inertia, trunk flexibility, cable forces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import sqrt
from typing import Any

import numpy as np

from loco_control.params import parameter

from ...geometry import added
from ...robot.description import Description
from ..base import Effect
from ..chain import JointEffect
from ..coordinates import Coordinate
from ..identity import Identity, LookAlike, Prior
from ..offers import AXES, Motion, Offer, logarithmic, place, strength, vector
from ..places import bodies, links, turning
from ..pulls import Pull

PAYLOAD_RANGE = 1.5  # range of payload positions on a base, relative to that of its joints (taste)
ALONG = 1.0, 1.8, 0.4  # first guesses of the place of a payload, over the centre of mass (taste)
AT_JOINT = 1e-3  # distance from the joint up to which a centre of mass has no direction [m] (taste)
FARTHEST = 5.0  # largest coordinate of a payload on a link that turns [m] (taste)
_INERTIA = (
    "Atkeson, An, Hollerbach 1986, Estimation of inertial parameters of manipulator loads and "
    "links, Int. J. Robotics Research 5(3)"
)


def carrier(world: Any, link: str) -> str:
    """Name of a link; for "" the base, or the last link of a fixed-base robot."""
    if link:
        return link
    description = world.description
    fixed = world.robot.fixed_base
    return description.child(world.robot.joints[-1]) if fixed else description.root_link()


def reached(robot: Any) -> list[tuple[str, tuple[float, ...]]]:
    """Links for external forces: all moving links if the base is fixed, else the base."""
    candidates = links(robot)
    return candidates if robot.fixed_base else candidates[:1]


def anywhere(
    com: Sequence[float], size: float, limit: float, starts: Sequence[float] = (1.0,)
) -> list[Coordinate]:
    """Coordinates of a position on a link in all directions, each within `limit` of 0 [m].

    Args:
        com: Centre of mass of the link [m].
        size: Unit of the coordinates [m].
        limit: Largest coordinate of the position [m].
        starts: Shares of `com` from which a fit starts.
    """
    return [
        Coordinate("position", size, tuple(c / size * v for v in starts), -limit, limit, "m",
                   direction=tuple(axis))
        for c, axis in zip(com, AXES, strict=True)
    ]  # fmt: skip


@dataclass
class Payload(Effect, name="payload"):
    """A point mass fixed to a link for the whole run.

    It becomes part of the link's mass, centre of mass and inertia
    (`description.add_point_mass`), which the engine cannot change during a run.
    """

    mass: float = parameter(0.0, "mass of the payload", "kg", low=0.0, high=1000.0)
    position: tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "place, link frame", "m")
    link: str = parameter("", "link that carries it; empty is the base (last link if fixed)")
    lasting = True

    identity = Identity(
        site="body",
        kind="mass",
        equation="m <- m + mass at position; centre of mass and inertia follow",
        priors={"mass": Prior(0.01, 0.3, 20.0)},
        source=_INERTIA,
        look_alikes=(
            LookAlike("torque_constant_error", "two postures, or another gain of the drive"),
            LookAlike("com_offset", "weigh the robot: an offset does not change the weight"),
            LookAlike("cable_force", "walk away: only the force of a hose changes"),
            LookAlike("rest_angle_error", "robot in the air: the legs carry no payload"),
        ),
        touches=("model",),
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """At the middle of each link, along a rotating link and beside it, anywhere on a base.

        Beside a link whose centre of mass is in its joint, as of a flange, as far as others reach.
        """
        text = Description(robot.urdf)
        rows, size = [], max(0.05 * text.mass(), 0.01)
        base = [] if robot.fixed_base else text.fixed_to(text.root_link())
        trunk = next((body for body in bodies(robot) if body in base), "")
        candidates = links(robot)
        lengths = [max(text.extent(link), math.hypot(*com)) for link, com in candidates]
        for link, com in candidates:
            mass, fixed = strength(cls, "mass", size), (("link", link),)
            if link == trunk:
                span = max(PAYLOAD_RANGE * text.extent(link), *map(abs, com))
                rows.append(Offer(link, fixed, (mass, *anywhere(com, span, span))))
            if link in base:
                continue
            reach = float(np.linalg.norm(com))
            if reach < AT_JOINT or not len(turning(robot)):
                rows.append(Offer(link, (*fixed, ("position", list(com))), (mass,)))
                beside = anywhere(com, max(lengths), FARTHEST)
            else:
                along = tuple(float(v) / reach for v in com)
                at = Coordinate("position", reach, ALONG, -FARTHEST, FARTHEST, "m", direction=along)
                rows.append(Offer(link, fixed, (mass, at)))
                beside = anywhere(com, reach, FARTHEST, ALONG)
            if len(turning(robot)):
                rows.append(Offer(link, fixed, (mass, *beside), "beside"))
        return rows

    def configure(self, world: Any) -> None:
        if self.mass > 0.0:
            world.description.add_mass(carrier(world, self.link), self.mass, self.position)


@dataclass
class ComOffset(Effect, name="com_offset"):
    """The centre of mass of a link is displaced; mass and inertia about it are unchanged."""

    offset: tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), "displacement in the link frame", "m", low=-1.0, high=1.0
    )
    link: str = parameter("", "link; empty is the base (last link if fixed)")
    lasting, needs = True, ("turns",)

    identity = Identity(
        site="body",
        kind="mass",
        equation="c <- c + offset",
        priors={"offset": Prior(-0.03, 0.0, 0.03)},
        source=_INERTIA,
        look_alikes=(
            LookAlike("payload", "weigh the robot: a payload adds to the weight"),
            LookAlike("slope", "turn the robot around: an offset turns with it, a slope does not"),
            LookAlike("imu_tilt", "foot forces: a tilted IMU does not change them"),
            LookAlike("joint_offset", "turn the robot: a wrong centre of mass changes the torque"),
            LookAlike("sensor_bias", "another gain: a bias does not change"),
        ),
        touches=("model",),
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """On each rigid body, in all directions."""
        return [Offer(link, (("link", link),), vector(cls, "offset")) for link in bodies(robot)]

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        if any(self.offset):
            world.description.shift_com(carrier(world, self.link), self.offset)


@dataclass
class Armature(JointEffect, name="armature"):
    """Inertia of rotor and gear that the model lacks.

    It acts only on the joint, like the inertia of a rotor behind a gear. PyBullet has no such
    inertia: there it is added to the moved link about the joint's axis. The two other axes get half
    of it, the least that is physically possible, which also loads the joints before it.
    """

    inertia: float = parameter(0.0, "inertia of the rotor, at the joint", "kg·m²", 0.0, 100.0)
    lasting, among = True, "turning"

    identity = Identity(
        site="body",
        kind="mass",
        equation="(I + inertia) ddq = tau",
        priors={"inertia": Prior(1e-4, 0.003, 0.1)},
        source=f"{_INERTIA}; rotor inertia n^2 J as in Robotics (Siciliano 2009), section 7.2",
        look_alikes=(
            LookAlike("payload", "hold still at two angles: inertia needs no torque"),
            LookAlike("actuator_lag", "torque off: inertia still acts, a lag does not"),
            LookAlike("torque_constant_error", "hold a known weight: inertia needs no torque"),
        ),
        touches=("model",),
    )

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        for j in self._joint_indices(world) if self.inertia > 0.0 else ():
            joint = world.robot.joints[j]
            world.armature[joint] = world.armature.get(joint, 0.0) + self.inertia

    def reset(self, rng: np.random.Generator) -> None:
        """The effect has no state."""


@dataclass
class TrunkFlex(Effect, name="trunk_flex"):
    """The trunk bends or twists: its rear part, with the hind legs, is attached by a sprung hinge.

    The root link is split in two at `position`: each half has half its mass and inertia about
    the same centre, so that with a locked hinge the robot is unchanged.
    """

    compliance: float = parameter(0.0, "rotation per torque", "rad/(N·m)", 0.0, 10.0)
    damping: float = parameter(0.1, "damping of the hinge", "N·m·s/rad", 0.0, 1000.0)
    axis: str = parameter(
        "y", "y bends it up and down, x twists it, z sideways", choices=("x", "y", "z")
    )
    position: float = parameter(0.0, "position x of the hinge in the base frame", "m", -10.0, 10.0)
    lasting, needs = True, ("base", "legs")

    identity = Identity(
        site="body",
        equation="hinge between front and rear: tau = -theta / compliance - damping dtheta/dt",
        priors={"compliance": Prior(1e-4, 0.003, 0.1), "damping": Prior(0.01, 0.1, 20.0)},
        source="De Luca, Book 2008, Robots with flexible elements, Springer Handbook of "
        "Robotics, chapter 13",
        look_alikes=(
            LookAlike("series_elasticity", "fix the trunk: the joints alone do not deflect"),
            LookAlike("ground_compliance", "robot in the air: the trunk still bends"),
            LookAlike("com_offset", "shake the robot in the air: a flexible trunk oscillates"),
        ),
        touches=("model",),
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """A hinge in the middle of the trunk, about each axis."""
        free = strength(cls, "compliance", 0.003), logarithmic(cls, "damping", (0.1, 1.0))
        return [Offer("", (("axis", axis),), free, axis) for axis in "yxz"]

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        if self.compliance > 0.0:
            rear = world.description.split_root(self.position, self.axis)
            world.hinges[rear] = (1.0 / self.compliance, self.damping)


@dataclass
class CableForce(Effect, name="cable_force"):
    """A hose or cable that pulls a link towards an anchor when taut; it never pushes."""

    stiffness: float = parameter(0.0, "stiffness of the cable", "N/m", low=0.0, high=1e6)
    anchor: tuple[float, float, float] = parameter((0.0, 0.0, 2.0), "fixed end, world frame", "m")
    length: float = parameter(1.0, "length at which the cable is taut", "m", low=0.0, high=100.0)
    point: tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "place, link frame", "m")
    link: str = parameter("", "link that it pulls; empty is the base (last link if fixed)")

    _link = None  # the base

    identity = Identity(
        site="body",
        equation="F = stiffness max(0, |r| - length) r / |r|, r from the link to the anchor",
        priors={"stiffness": Prior(1.0, 20.0, 500.0), "length": Prior(0.2, 1.0, 5.0)},
        source="Semini, Tsagarakis, Guglielmino, Focchi, Cannella, Caldwell 2011, Design of HyQ, "
        "Proc. IMechE Part I 225(6) (hydraulic hoses)",
        look_alikes=(
            LookAlike("push", "walk to another place: a push does not change"),
            LookAlike("payload", "walk away: the force of a mass does not change"),
            LookAlike("slope", "walk in a circle: a slope always pulls in one direction"),
            LookAlike("added_stiffness", "move the other joints: a spring does not change"),
        ),
        touches=("force",),
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """From each link, or the base, to anchors ahead, behind and above."""
        rows, directions = [], ((1.0, 0.0, 0.3), (-1.0, 0.0, 0.3), (0.0, 0.0, 1.0))
        free = strength(cls, "stiffness", 20.0), logarithmic(cls, "length", (0.8,))
        height = 0.5 if robot.height is None else robot.height
        for direction, (link, com) in product(directions, reached(robot)):
            anchor = [float(v) for v in np.array([0.0, 0.0, height]) + direction]
            fixed = (("link", link), ("point", list(com)))
            rows.append(Offer(link, fixed, (*free, *place(cls, "anchor", anchor)),
                              f"to {anchor[0]:g} {anchor[2]:g}"))  # fmt: skip
        return rows

    def configure(self, world: Any) -> None:
        self._world, self._link = world, carrier(world, self.link)

    def on_step(self, world: Any, t: float) -> None:
        at, (x, y, z), distance = self._reach(world)
        if distance > self.length:
            pull = self.stiffness * (distance - self.length) / distance
            world.push((pull * x, pull * y, pull * z), self._link, at=at)

    def _reach(self, world: Any) -> tuple[Any, list[float], float]:
        """Attachment point, vector from there to the anchor, and its length, world frame [m]."""
        at = world.place(self._link, self.point)
        to_anchor = [anchor - x for anchor, x in zip(self.anchor, at, strict=True)]
        return at, to_anchor, sqrt(added(w * w for w in to_anchor))

    def pull(self) -> Pull:
        cable = {"anchor": self.anchor, "stiffness": self.stiffness, "length": self.length}
        return Pull(self._link, self.point, **cable)

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        return 0.5 * self.stiffness * max(0.0, self._reach(self._world)[2] - self.length) ** 2
