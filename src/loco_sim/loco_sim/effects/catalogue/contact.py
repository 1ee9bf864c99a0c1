# SPDX-License-Identifier: Apache-2.0
"""Effects of the ground: friction, compliance, height and slope that differ from the model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from math import cos, sin
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.exceptions import NameUnknownError
from loco_control.params import parameter

from ... import lazy
from ...geometry import Quaternion, multiply, rotate_back, rotation_matrix, seen_from
from ...terrain import RELIEFS, Patches, Terrain
from ..base import Effect
from ..identity import Identity, LookAlike, Prior
from ..offers import Motion, Offer, scalar_offer
from ..readings import Layout, Measuring

if TYPE_CHECKING:
    from ...world.world import Base

reading_laws = lazy.module("loco_sim.effects.reading_laws")


def feet(robot: Any, pattern: str) -> list[str]:
    """Feet that match a name or pattern; all feet for "".

    Raises:
        NameUnknownError: The name or pattern matches no foot.
    """
    if not (selected := named(robot.feet, pattern)):
        raise NameUnknownError("foot", pattern, robot.feet)
    return selected


def named(feet: Iterable[str], pattern: str) -> list[str]:
    """The feet that match a name or pattern; all for ""."""
    return [foot for foot in feet if not pattern or fnmatchcase(foot, pattern)]


def under_feet(all_feet: Offer, robot: Any) -> list[Offer]:
    """An offer for all feet together, then the same for each foot."""
    if len(robot.feet) < 2:
        return [all_feet]
    return [all_feet, *(all_feet._replace(place=f, fixed=(("foot", f),)) for f in robot.feet)]


@dataclass
class FootFriction(Effect, name="foot_friction"):
    """The friction of feet on the ground differs from the model; list it once per foot."""

    error: float = parameter(0.0, "relative error of the coefficient", "-", -0.999, 20.0)
    foot: str = parameter("", "feet, by name or pattern; empty is all")
    lasting, needs = True, ("feet",)

    identity = Identity(
        site="contact",
        equation="mu <- (1 + error) mu",
        priors={"error": Prior(-0.8, 0.0, 2.0)},
        source="thesis Table 5.1: front 0.1 to 0.283, hind 0.1 to 0.0008",
        look_alikes=(
            LookAlike("slip", "the same step many times: slip does not occur in each"),
            LookAlike("slope", "walk in both directions: friction is the same"),
            LookAlike("ground_compliance", "stand still: feet sink into soft ground only"),
        ),
        touches=("model",),
        smooth=False,
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """Under all feet, and under each."""
        return under_feet(scalar_offer(cls, ""), robot)

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        for foot in feet(world.robot, self.foot) if self.error else ():
            before = world.friction.get(foot, world.params.friction)
            world.friction[foot] = (1.0 + self.error) * before


@dataclass
class Slip(Effect, name="slip"):
    """Slippery patches: friction drops at random times, independently for each foot."""

    loss: float = parameter(0.0, "share of the friction lost on a patch", "-", 0.0, 1.0)
    share: float = parameter(0.3, "share of the time that a foot is on patches", "-", 0.01, 0.99)
    duration: float = parameter(0.3, "mean time on a patch", "s", 1e-3, 100.0)
    foot: str = parameter("", "feet, by name or pattern; empty is all")
    needs, stateless = ("feet",), True

    draws = True
    identity = Identity(
        site="contact",
        equation="mu(t) = mu or (1 - loss) mu; times on and off a patch are exponential",
        priors={
            "loss": Prior(0.2, 0.7, 1.0),
            "share": Prior(0.05, 0.2, 0.6),
            "duration": Prior(0.05, 0.3, 3.0),
        },
        source="Focchi, Barasuol, Frigerio, Caldwell, Semini 2018, Slip detection and recovery "
        "for quadruped robots, Robotics Research (ISRR)",
        look_alikes=(
            LookAlike("foot_friction", "the same step many times: low friction acts in each"),
            LookAlike("push", "robot in the air: a push still acts"),
        ),
        touches=("model",),
        smooth=False,
        untried="its patches come at random times, which no prediction can follow",
    )

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        default = world.params.friction
        self._feet = feet(world.robot, self.foot)
        self._normal = [world.friction.get(foot, default) for foot in self._feet]
        self._last = self.stop - 1.5 * world.dt

    def reset(self, rng: np.random.Generator) -> None:
        self._rng = rng
        count = len(self._feet)
        self._slippery = rng.random(count) < self.share
        self._until = self.start + np.array([self._time(on) for on in self._slippery])
        self._next = -np.inf

    def _time(self, on: bool) -> float:
        """Random time on or off a patch [s]."""
        ratio = 1.0 if on else (1.0 - self.share) / self.share
        return self.duration * ratio * self._rng.exponential()

    def on_step(self, world: Any, t: float) -> None:
        over = t >= self._last
        if t < self._next and not over:
            return
        first = self._next == -np.inf
        for k, foot in enumerate(self._feet):
            changed = first
            while self._until[k] <= t:
                self._slippery[k] = changed = not self._slippery[k]
                self._until[k] += self._time(self._slippery[k])
            if changed or over:
                lost = self.loss if self._slippery[k] and not over else 0.0
                world.set_friction(foot, (1.0 - lost) * self._normal[k])
        self._next = self._until.min()


GIVES = {"compliance": Prior(1e-6, 1e-4, 3e-3), "damping": Prior(1.0, 300.0, 5000.0)}
STANCE = (
    "Fahmi, Focchi, Radulescu, Fink, Barasuol, Semini 2020, STANCE: Locomotion adaptation over "
    "soft terrain, IEEE Trans. Robotics 36(2)"
)


@dataclass
class Giving(Effect):
    """Base of effects with compliant ground (spring and damper), everywhere or in patches."""

    compliance: float = parameter(0.0, "sinking per force under one foot", "m/N", 0.0, 1.0)
    damping: float = parameter(300.0, "damping of the ground under one foot", "N·s/m", 0.0, 1e6)

    def softened(self, stiffness: float) -> tuple[float, float]:
        """Stiffness [N/m], damping [N·s/m] of a contact that had `stiffness`; 0 is rigid."""
        rigid = 1.0 / stiffness if stiffness > 0.0 else 0.0
        return 1.0 / (rigid + self.compliance), self.damping


@dataclass
class GroundCompliance(Giving, name="ground_compliance"):
    """The ground under feet is compliant: a spring and damper."""

    foot: str = parameter("", "feet, by name or pattern; empty is all")
    lasting, needs = True, ("feet",)

    identity = Identity(
        site="contact",
        equation="1 / k <- 1 / k + compliance; d <- damping",
        priors=GIVES,
        source=STANCE,
        look_alikes=(
            LookAlike("trunk_flex", "robot in the air: the trunk still bends"),
            LookAlike("stiffness_error", "robot in the air: soft springs still deflect"),
            LookAlike("foot_friction", "stand still: feet do not sink into slippery ground"),
        ),
        touches=("model",),
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """Under all feet, and under each."""
        return under_feet(scalar_offer(cls, ""), robot)

    def depth(self, load: Mapping[str, np.ndarray], dt: float) -> dict[str, np.ndarray]:
        depths = {}
        share = 1.0 - np.exp(-dt / max(self.compliance * self.damping, 1e-9))
        for foot in named(load, self.foot):
            depth = reading_laws.followed(self.compliance * load[foot], share)
            depths[foot] = np.where(load[foot] > 0.0, depth, 0.0)
        return depths

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        for foot in feet(world.robot, self.foot) if self.compliance else ():
            world.contact[foot] = self.softened(world.softness(foot)[0])


@dataclass
class SoftPatches(Giving, name="soft_patches"):
    """The ground is compliant in patches only: a foot sinks in where it steps on one.

    It is firm where the robot starts; the patches are the same in every engine and every run.
    """

    share: float = parameter(0.3, "share of the ground that is soft", "-", 0.01, 0.99)
    length: float = parameter(0.3, "size of patches", "m", 0.1, 10.0)
    pattern: int = parameter(0, "number of the random pattern", "-", 0, 2**31 - 1)
    flat: float = parameter(0.8, "radius of the firm start", "m", 0.0, 10.0)
    needs = ("base", "feet")

    identity = Identity(
        site="contact",
        equation="1 / k <- 1 / k + compliance and d <- damping where s(x, y) = 1, s random",
        priors=GIVES,
        source=STANCE,
        look_alikes=(
            LookAlike("ground_compliance", "stand in many places: it is soft in each"),
            LookAlike("terrain", "stand still: feet do not sink into rough ground"),
        ),
        touches=("model",),
        untried="its places are random, and no prediction knows the pattern",
    )

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        self._patches = Patches(self.share, self.length, self.pattern, self.flat)
        self._firm = {foot: world.softness(foot) for foot in world.robot.feet}
        self._last = self.stop - 1.5 * world.dt

    def reset(self, rng: np.random.Generator) -> None:
        self._under: dict[str, bool] = {}  # contact settings of the previous run are unknown

    def on_step(self, world: Any, t: float) -> None:
        for foot, firm in self._firm.items():
            soft = t < self._last and self._patches.under(*world.place(foot)[:2])
            if soft != self._under.get(foot):
                self._under[foot] = soft
                world.set_softness(foot, *(self.softened(firm[0]) if soft else firm))


@dataclass
class RoughGround(Effect, name="terrain"):
    """The ground is not flat: hills or steps of random height, the same in every engine.

    It is flat where the robot starts, and reaches 30 m ahead and 4 m to each side.
    """

    roughness: float = parameter(0.0, "standard deviation of the height", "m", 0.0, 0.5)
    length: float = parameter(0.3, "size of hills or steps", "m", 0.1, 10.0)
    kind: str = parameter("uneven", "smooth hills, or flat tiles", choices=RELIEFS)
    pattern: int = parameter(0, "number of the random pattern", "-", 0, 2**31 - 1)
    flat: float = parameter(0.8, "radius of the flat start", "m", 0.0, 10.0)
    lasting, needs = True, ("base", "legs")

    identity = Identity(
        site="contact",
        equation="z = h(x, y), h random with standard deviation roughness and size length",
        priors={"roughness": Prior(0.002, 0.01, 0.05)},
        source="Hwangbo, Lee, Dosovitskiy, Bellicoso, Tsounis, Koltun, Hutter 2019, Learning "
        "agile and dynamic motor skills for legged robots, Science Robotics 4(26)",
        look_alikes=(
            LookAlike("push", "the same walk on another path: pushes do not depend on the place"),
            LookAlike("ground_compliance", "stand still: feet sink into soft ground only"),
        ),
        touches=("model",),
        smooth=False,
        untried="its heights are random, and no prediction knows the pattern",
    )

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        if not self.absent():
            world.terrain = Terrain(self.kind, self.roughness, self.length, self.pattern, self.flat)


@dataclass
class GroundHeight(Effect, name="ground_height"):
    """The ground is higher under one foot wherever it steps: a board, a worn sole, a longer leg.

    The radius of the foot is increased by this height, so that it touches earlier.
    """

    height: float = parameter(0.0, "height difference", "m", -0.5, 0.5)
    foot: str = parameter("", "feet, by name or pattern; empty is all")
    lasting, needs = True, ("legs",)

    identity = Identity(
        site="contact",
        equation="radius <- radius + height",
        priors={"height": Prior(-0.02, 0.0, 0.02)},
        source="Focchi, Orsolino, Camurri, Barasuol, Mastalli, Caldwell, Semini 2020, Heuristic "
        "planning for rough terrain locomotion in presence of external disturbances and variable "
        "perception quality, Advances in Robotics Research, Springer",
        look_alikes=(
            LookAlike("joint_offset", "robot in the air: a joint offset is still there"),
            LookAlike("slope", "turn the robot around: a slope does not turn with it"),
            LookAlike("ground_compliance", "stand still: soft ground sinks with the load"),
        ),
        touches=("model",),
        smooth=False,
    )

    @classmethod
    def offers(cls, robot: Any, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """Under each foot; the same height under all feet would have no effect."""
        return under_feet(scalar_offer(cls, ""), robot)[1:]

    def depth(self, load: Mapping[str, np.ndarray], dt: float) -> dict[str, np.ndarray]:
        feet = named(load, self.foot)
        return {foot: np.where(load[foot] > 0.0, -self.height, 0.0) for foot in feet}

    def configure(self, world: Any) -> None:
        self.require(world.robot)
        for foot in feet(world.robot, self.foot) if self.height else ():
            world.description.grow_ball(foot, self.height)


@dataclass
class Slope(Measuring, Effect, name="slope"):
    """The ground (or the bench) is inclined: gravity and the IMU readings are rotated.

    The world frame is fixed to the ground, with x ahead along it.
    """

    pitch: float = parameter(0.0, "inclination, uphill in front", "rad", low=-3.2, high=3.2)
    roll: float = parameter(0.0, "inclination, left side higher", "rad", low=-3.2, high=3.2)
    lasting = True

    identity = Identity(
        site="contact",
        equation="g <- R' g, R = R_y(-pitch) R_x(roll); orientation <- R orientation",
        priors={"pitch": Prior(-0.1, 0.0, 0.1), "roll": Prior(-0.1, 0.0, 0.1)},
        strengths=("pitch", "roll"),
        source="Focchi, del Prete, Havoutis, Featherstone, Caldwell, Semini 2017, High-slope "
        "terrain locomotion for torque-controlled quadruped robots, Autonomous Robots 41",
        look_alikes=(
            LookAlike("imu_tilt", "turn the robot around: a tilted IMU turns with it"),
            LookAlike("com_offset", "turn the robot around: an offset turns with it"),
            LookAlike("push", "let the robot hop: a slope acts on every link"),
            LookAlike("sensor_bias", "look at the motion: a biased sensor does not change it"),
        ),
        touches=("model", "orientation"),
    )

    def turn(self) -> Quaternion:
        """Attitude of the ground, x y z w."""
        tilt, side = -0.5 * self.pitch, 0.5 * self.roll
        return multiply((0.0, sin(tilt), 0.0, cos(tilt)), (sin(side), 0.0, 0.0, cos(side)))

    def begin(self, base: Base) -> Base:
        x, y, z, w = self.turn()
        return seen_from((-x, -y, -z, w), base)

    def configure(self, world: Any) -> None:
        turn = self.turn()
        self._turn = np.array(turn)
        if not self.absent():
            world.gravity = rotate_back(rotation_matrix(turn), world.gravity)

    def measure(self, values: np.ndarray, at: Layout, t: float) -> None:
        first = at["orientation"].start
        reading_laws.product(values, first, self._turn, values[first : first + 4])
