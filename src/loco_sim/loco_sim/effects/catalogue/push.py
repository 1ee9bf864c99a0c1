# SPDX-License-Identifier: Apache-2.0
"""External forces on links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.params import parameter

from ..base import Effect
from ..coordinates import Coordinate
from ..identity import Identity, LookAlike, Prior
from ..offers import Motion, Offer, vector
from ..pulls import Pull
from .body import carrier, reached

if TYPE_CHECKING:
    from ...world.world import World


@dataclass
class ConstantForce(Effect, name="constant_force"):
    """A constant force on a point of a link, e.g. of a hose, a balancer or wind.

    Measured torques include what the drives do against it, unlike those with a `torque_bias`.
    """

    force: tuple[float, float, float] = parameter(
        (0.0, 0.0, 0.0), "force, world frame", "N", -1e4, 1e4
    )
    point: tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "place, link frame", "m")
    link: str = parameter("", "link that is pulled; empty is the base (last link if fixed)")

    _link = None  # the base
    stateless = True

    identity = Identity(
        site="outside",
        equation="F = force, on point of link",
        priors={"force": Prior(-50.0, 0.0, 50.0)},
        source="Siciliano, Sciavicco, Villani, Oriolo 2009, Robotics, section 3.8 (statics)",
        look_alikes=(
            LookAlike("slope", "turn the bench around, or add a load: a slope acts on every mass"),
            LookAlike("torque_bias", "measured torque: drives report what they do against a force"),
            LookAlike("push", "record for longer: a push ends"),
            LookAlike("payload", "move fast: a force has no inertia"),
            LookAlike("cable_force", "move to another place: the force of a cable changes"),
        ),
        touches=("force",),
        passive=False,
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """At the middle of each link, or of the base."""
        return [
            Offer(link, (("link", link), ("point", list(com))), vector(cls, "force"))
            for link, com in reached(robot)
        ]

    def configure(self, world: World) -> None:
        root = not self.link and not world.robot.fixed_base
        self._link = None if root else carrier(world, self.link)

    def pull(self) -> Pull | None:
        return Pull(self._link, self.point, self.force)

    def on_step(self, world: World, t: float) -> None:
        world.push(self.force, link=self._link, point=self.point)


@dataclass
class Push(ConstantForce, name="push"):
    """A constant plus a random force on a point of a link.

    The random force is piecewise constant, uniform in +-`random` on each axis, and drawn
    again after a uniform time between `shortest` and `longest`.
    Source: the random force is that of the author's simulation (hyq_ml, hyq/physics.py), where
    a new draw every 25 to 250 control periods replaces the one before.
    """

    random: float = parameter(0.0, "amplitude of the random force on each axis", "N", 0.0, 1e4)
    shortest: float = parameter(0.1, "shortest time between two draws", "s", low=0.0)
    longest: float = parameter(1.0, "longest time between two draws", "s", low=0.0)

    draws = True
    identity = Identity(
        site="outside",
        equation="F = force + u(t), |u_i| <= random, on point of link, from start to stop",
        priors={"force": Prior(-50.0, 0.0, 50.0), "random": Prior(0.5, 10.0, 100.0)},
        strengths=("force", "random"),
        source="thesis section 7.4; random force of the author's simulation (hyq_ml)",
        look_alikes=(
            LookAlike("cable_force", "walk to another place: the force of a cable changes"),
            LookAlike("slope", "let the robot hop: a slope acts on every link"),
            LookAlike("constant_force", "record for longer: a push ends"),
            LookAlike("slip", "robot in the air: a push still acts"),
        ),
        touches=("force",),
        passive=False,
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """On each link, or the base, during the intervals of large residuals."""
        rows = []
        for (start, stop), (link, com) in product(motion.intervals, reached(robot)):
            half_duration = 0.5 * (stop - start)
            margin = half_duration + 0.2  # farther away it is another push
            ranges = (  # residuals continue after the push
                ("start", (start,), max(0.0, start - margin)),
                ("stop", (stop, start + half_duration), start),
            )
            times = tuple(
                Coordinate(name, 0.1, tuple(t / 0.1 for t in at), low, at[0] + margin, "s")
                for name, at, low in ranges
            )
            fixed = (("link", link), ("point", list(com)))
            rows.append(Offer(link, fixed, (*vector(cls, "force"), *times), f"{start:g} s"))
        return rows

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._next = -np.inf
        self._latest, self._drawn = np.array(self.force), None

    def pull(self) -> Pull | None:
        return None if self.random > 0.0 else super().pull()

    def on_step(self, world: World, t: float) -> None:
        if self.random > 0.0 and t >= self._next:
            self._latest = self.force + self._rng.uniform(-self.random, self.random, 3)
            self._next = t + self._rng.uniform(*sorted((self.shortest, self.longest)))
        if self._latest is not self._drawn:
            self._drawn, self._force = self._latest, self._latest.tolist()
        if any(self._force):
            world.push(self._force, link=self._link, point=self.point)
