# SPDX-License-Identifier: Apache-2.0
"""Base class of the named physical effects, their registry, and their form in experiments.

An effect is a dataclass of parameters, each with unit and range, whose defaults
switch it off, an `Identity`, and a few hooks. To add one: derive from `Effect` with a
name in a module of ``effects/catalogue``, declare the parameters, fill in its `identity`,
and override the hooks it needs. The tests over the registry then cover it.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import Params, from_dict, parameter
from loco_control.reading import shown
from loco_control.types import RobotState

from ..robot.servo import TorqueDrive
from .identity import Identity
from .offers import Motion, Offer, scalar_offer
from .places import turning

if TYPE_CHECKING:
    from ..robot.robot import Robot
    from ..world.world import Base, World

EFFECTS: dict[str, type[Effect]] = {}
ON_TORQUES = "on_drive", "on_torque"  # hooks on the torques of the drives, then of the joints


@dataclass
class Effect:
    """One departure of the plant from the ideal robot, e.g. a delay or a push.

    The simulation calls only hooks that a subclass overrides, in the order in
    which the experiment lists the effects, and only between `start` and `stop`.
    A hook returns new arrays and never changes those it was given.
    """

    name: ClassVar[str] = ""
    identity: ClassVar[Identity | None] = None
    needs: ClassVar[tuple[str, ...]] = ()  # keys of `NEEDS`: required parts of the robot
    lasting: ClassVar[bool] = False  # active for the whole run, since it is built into the world
    shared: ClassVar[bool] = False  # couples all its joints, e.g. by their power supply
    draws: ClassVar[bool] = False  # random: depends on the seed
    stateless: ClassVar[bool] = False  # `on_step` sets forces and friction regardless of the state

    start: float = parameter(0.0, "the effect begins", "s", low=0.0)
    stop: float = parameter(math.inf, "the effect ends", "s", low=0.0)

    def __init_subclass__(cls, name: str = "", **kwargs: Any) -> None:
        """Register the class; a class without a name is a base class and is not registered.

        Raises:
            ParameterError: The name is taken.
        """
        super().__init_subclass__(**kwargs)
        if not name:
            return
        if name in EFFECTS:
            raise ParameterError(f"there is an effect named {name!r} already")
        cls.name = name
        EFFECTS[name] = cls

    def __post_init__(self) -> None:
        Params.__post_init__(self)  # the checks of `Params`, but not frozen: hooks keep state
        if self.stop < self.start:
            raise ParameterError(
                f"effect {self.name}: stop ({self.stop:g} s) is before start ({self.start:g} s)"
            )
        if self.lasting and (self.start > 0.0 or self.stop != math.inf):
            raise ParameterError(
                f"effect {self.name} is there from start to end: start {self.start:g} s and "
                f"stop {self.stop:g} s are not possible, only 0 and .inf"
            )

    @classmethod
    def lacks(cls, robot: Robot) -> str:
        """Description of the parts that the effect needs and a robot lacks; "" if it has all."""
        missing = [text for text, has in map(NEEDS.__getitem__, cls.needs) if not has(robot)]
        return " and ".join(missing)

    @classmethod
    def applies(cls, robot: Robot) -> bool:
        """Whether the robot has all parts that the effect needs."""
        return not cls.lacks(robot)

    def require(self, robot: Robot) -> None:
        """Refuse a robot that lacks a part that the effect needs.

        Raises:
            ParameterError: The robot lacks a part; the message names it.
        """
        if missing := self.lacks(robot):
            raise ParameterError(
                f"effect {self.name} does not apply to robot {robot.name!r}: it has no {missing}"
            )

    @classmethod
    def places(cls, robot: Robot) -> list[str]:
        """Possible locations: single joints and groups of joints; "" for an effect without one."""
        return [""]

    @classmethod
    def offers(cls, robot: Robot, signals: Sequence[str], motion: Motion) -> list[Offer]:
        """Locations at which gap finding tries the effect, with the parameters to identify.

        By default each of its `places`, with all scalar parameters that have a prior free.

        Args:
            robot: A robot to which the effect applies.
            signals: Measured signals, e.g. ("q", "gyro").
            motion: Ranges of joint motion, and times at which the residual is large.
        """
        return [scalar_offer(cls, place) for place in cls.places(robot)]

    @classmethod
    def fuse(cls, hook: str) -> Callable[..., Any] | None:
        """Function that fuses hooks of adjacent effects into one, or None: see `windows`."""
        return None

    def absent(self) -> bool:
        """Whether the parameter values switch the effect off."""
        strengths = self.identity.strengths if self.identity else ()
        return bool(strengths) and not any(np.any(getattr(self, name)) for name in strengths)

    def amount(self, robot: Any) -> str:
        """The size of the effect on a robot, in other words; "" if its parameters say it."""
        return ""

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        """Energy stored in the effect itself, e.g. in a spring [J].

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
        """
        return 0.0

    def configure(self, world: World) -> None:
        """Change the world before it is built.

        It may change `world.description`, `world.friction`, `world.contact` and
        `world.gravity`; `world.joint_index` finds joints, `world.dt` is the physics
        step, `world.robot` the robot. Called first at every reset, regardless of
        `start`.
        """

    def reset(self, rng: np.random.Generator | None) -> None:
        """Reset all state; `rng` is the effect's own random stream, None unless it `draws`."""

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Motion command as received by the drives.

        Called before every physics step. Between two commands the same array objects are
        passed (`is`), so an effect can detect a new command.

        Args:
            q: Desired joint positions [rad], (n,).
            dq: Desired joint velocities [rad/s], (n,).
            t: Time [s].
        """
        return q, dq

    def on_drive(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Actual torque of the drives, from the torque of their control laws within their limits.

        Springs of the robot are parallel to the drives and not included. Called before every
        physics step; arguments as in `on_torque`.
        """
        return tau

    def on_torque(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Torque on the joints, from the torque of drives and springs.

        Called before every physics step, after `on_drive` of all effects.

        Args:
            tau: Torque [N·m], (n,).
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            dt: Physics step [s].
            t: Time [s].
        """
        return tau

    def on_motor(
        self, rows: np.ndarray, duty: np.ndarray, speed: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Motor constants of the servos in this physics step.

        Called before every physics step, after `on_command`, for robots that list drives.

        Args:
            rows: Unchanged parameter rows of the drives (`servo.ServoParams.row`),
                (n, COLUMNS).
            duty: Duty cycle commanded by each servo, in [-1, 1], (n,).
            speed: Speed of its rotor [rad/s], (n,).
            dt: Physics step [s].
            t: Time [s].
        """
        return rows

    def on_brake(
        self,
        budget: np.ndarray,
        tau: np.ndarray,
        q: np.ndarray,
        dq: np.ndarray,
        dt: float,
        t: float,
    ) -> np.ndarray:
        """Available braking torque of each joint, e.g. dry friction.

        The engine applies at most the part that stops the joint: it never reverses a
        motion, never adds energy, and does not chatter. Called before every physics
        step, after `on_torque`.

        Args:
            budget: Braking torque of the effects before this one [N·m], (n,), >= 0; add to it.
            tau: Torque of the drives, after `on_drive` of all effects [N·m], (n,).
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
            dt: Physics step [s].
            t: Time [s].
        """
        return budget

    def on_step(self, world: World, t: float) -> None:
        """Act on the world, e.g. push it. Called before every physics step."""

    def begin(self, base: Base) -> Base:
        """True state of the base for a given IMU reading.

        Gap finding starts models at the state estimated from IMU and legs.

        Args:
            base: State of a robot without the effect that would give the same IMU reading.
        """
        return base

    def depth(self, load: Mapping[str, np.ndarray], dt: float) -> Mapping[str, np.ndarray]:
        """Penetration depth of the feet that the effect lets sink into the ground [m], (T,) each.

        Args:
            load: Ground force by foot [N], (T,) each.
            dt: Time between samples [s].
        """
        return {}

    def pull(self) -> Any:
        """`on_step` as a single `pulls.Pull`; None if it is not a single force."""
        return None

    def on_measurement(self, state: RobotState) -> RobotState:
        """Sensor readings, from the true state. Called once per control period."""
        return state


def names() -> list[str]:
    """Names of all effects."""
    return sorted(EFFECTS)


def applicable(robot: Robot) -> list[str]:
    """Names of the effects that apply to a robot."""
    return [name for name in names() if EFFECTS[name].applies(robot)]


def make(name: str, **params: Any) -> Effect:
    """New effect by name.

    Raises:
        NameUnknownError: There is no such effect or parameter.
        ParameterError: A parameter has the wrong type or is out of range.
    """
    if not isinstance(name, str) or name not in EFFECTS:
        raise NameUnknownError("effect", str(name), EFFECTS)
    return from_dict(EFFECTS[name], params, f"effect {name}")


def from_list(specs: Iterable[Mapping[str, Any]] | None) -> list[Effect]:
    """Effects from an experiment's list: ``[{name: push, force: [0, 40, 0], start: 3}, …]``.

    Raises:
        NameUnknownError: There is no such effect or parameter.
        ParameterError: An entry is not a mapping with a name, or a value is wrong.
    """
    effects = []
    for i, spec in enumerate(specs or ()):
        if not isinstance(spec, Mapping) or "name" not in spec:
            raise ParameterError(f"effects[{i}] must be a mapping with a 'name', got {shown(spec)}")
        effects.append(make(**{str(key): value for key, value in spec.items()}))
    return effects


def to_list(effects: Iterable[Effect]) -> list[dict[str, Any]]:
    """Inverse of `from_list`, with every parameter."""
    return [{"name": effect.name, **dataclasses.asdict(effect)} for effect in effects]


def streams(effects: Iterable[Effect], seed: int) -> list[np.random.Generator | None]:
    """One random stream per effect that draws, keyed by the seed and the effect's name.

    Adding an effect does not change the noise of another. An effect listed
    twice gets two streams.
    """
    counts: dict[str, int] = {}
    generators = []
    for effect in effects:
        count = counts[effect.name] = counts.get(effect.name, -1) + 1
        key = seed, count, *effect.name.encode()
        generators.append(np.random.default_rng(key) if effect.draws else None)
    return generators


def overrides(effect: Effect, hook: str) -> bool:
    """Whether the effect's class overrides a hook."""
    return getattr(type(effect), hook) is not getattr(Effect, hook)


def windows(effects: Iterable[Effect], hook: str, dt: float) -> list[tuple[int, float, Any]]:
    """First physics step, step after the last, and function of each effect that overrides a hook.

    Adjacent effects with the same `fuse` become one function, which applies them in sequence
    within their windows, since a call costs more than a law. Effects that are switched off by
    their parameters are omitted.

    Args:
        effects: Effects in the order in which they act.
        hook: Name of a method of `Effect`.
        dt: Physics step [s].
    """
    entries, acting = [], [e for e in effects if overrides(e, hook) and not e.absent()]
    for fuse, consecutive in itertools.groupby(acting, lambda e: e.fuse(hook)):
        group = list(consecutive)
        each = [(*span(e, dt), getattr(e, hook)) for e in group]
        if fuse is None or len(group) == 1:
            entries += each
        else:
            first, last, _ = zip(*each, strict=True)
            entries.append((min(first), max(last), fuse(group, hook, dt)))
    return entries


def span(effect: Effect, dt: float) -> tuple[int, float]:
    """First physics step of an effect and the step after its last."""
    stop = round(effect.stop / dt) if effect.stop < math.inf else effect.stop
    return round(effect.start / dt), stop


def listens(robot: Robot) -> bool:
    """Whether any drive follows joint positions; a plain torque drive does not."""
    return any(not isinstance(drive, TorqueDrive) for drive in robot.drives.values())


# Parts that effects may need: name in messages, and a test on the robot.
NEEDS: dict[str, tuple[str, Callable[[Robot], bool]]] = {
    "base": ("base that moves", lambda robot: not robot.fixed_base),
    "feet": ("feet", lambda robot: len(robot.feet) > 0),
    "legs": ("legs", lambda robot: len(robot.feet) > 1),
    "turns": ("link that turns", lambda robot: not robot.fixed_base or len(turning(robot)) > 0),
    "drives": ("drive", lambda robot: len(robot.driven) > 0),
    "bolted": ("base that is bolted", lambda robot: robot.fixed_base),
    "follower": ("drive that follows a position", lambda robot: listens(robot)),
}
