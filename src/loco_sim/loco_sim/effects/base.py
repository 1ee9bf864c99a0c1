# SPDX-License-Identifier: Apache-2.0
"""Named physical effects: what one is, the registry, and how experiments list them.

An effect is a dataclass of parameters, each with unit and range, whose defaults
switch it off, an `Identity`, and a few hooks. To add one: derive from `Effect` with a
name, declare the parameters, say what is known about it, override the hooks it needs,
import its module in ``effects/__init__.py``. The tests over the registry then cover it.
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
from .offers import Hints, Offer, plain
from .places import turning

if TYPE_CHECKING:
    from ..robot.robot import Robot
    from ..world.world import Base, World

EFFECTS: dict[str, type[Effect]] = {}
ON_TORQUES = "on_drive", "on_torque"  # hooks on torques: of the drives, then on the joints


@dataclass
class Effect:
    """One departure of the plant from the ideal robot, e.g. a delay or a push.

    The simulation calls only hooks that a subclass overrides, in the order in
    which the experiment lists the effects, and only between `start` and `stop`.
    A hook returns new arrays and never changes those it was given.
    """

    name: ClassVar[str] = ""
    identity: ClassVar[Identity | None] = None
    needs: ClassVar[tuple[str, ...]] = ()  # keys of `NEEDS`: what a robot must have
    lasting: ClassVar[bool] = False  # there from start to end: it is built into the world
    shared: ClassVar[bool] = False  # one cause in all its joints: a supply, not a gear
    draws: ClassVar[bool] = False  # its course depends on the seed
    blind: ClassVar[bool] = False  # `on_step` looks at nothing: it pushes and sets friction

    start: float = parameter(0.0, "the effect begins", "s", low=0.0)
    stop: float = parameter(math.inf, "the effect ends", "s", low=0.0)

    def __init_subclass__(cls, name: str = "", **kwargs: Any) -> None:
        """Enter the class in the registry; one without a name is a base of others.

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
        Params.__post_init__(self)  # the same checks, without being frozen: hooks keep state
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
        """Parts that the effect needs and a robot does not have, in words; empty when it fits."""
        missing = [text for text, has in map(NEEDS.__getitem__, cls.needs) if not has(robot)]
        return " and ".join(missing)

    @classmethod
    def applies(cls, robot: Robot) -> bool:
        """Whether the effect makes sense on a robot."""
        return not cls.lacks(robot)

    def require(self, robot: Robot) -> None:
        """Refuse a robot on which the effect makes no sense.

        Raises:
            ParameterError: The robot lacks something; the message says what.
        """
        if missing := self.lacks(robot):
            raise ParameterError(
                f"effect {self.name} does not apply to robot {robot.name!r}: it has no {missing}"
            )

    @classmethod
    def places(cls, robot: Robot) -> list[str]:
        """Joints, one by one and in groups, at which it may sit; "" where it has no place."""
        return [""]

    @classmethod
    def offers(cls, robot: Robot, signals: Sequence[str], hints: Hints) -> list[Offer]:
        """Places where gap finding tries the effect, with the parameters that data shall tell.

        By default at each of its places, with every scalar that has a prior free.

        Args:
            robot: A robot to which it applies.
            signals: Measured signals, e.g. ("q", "gyro").
            hints: Travel of the joints, and times at which the residual is large.
        """
        return [plain(cls, place) for place in cls.places(robot)]

    @classmethod
    def fuse(cls, hook: str) -> Callable[..., Any] | None:
        """Function that makes one of a hook of neighbours: see `windows`; None if there is none."""
        return None

    def absent(self) -> bool:
        """Whether its parameters switch the effect off."""
        strengths = self.identity.strengths if self.identity else ()
        return bool(strengths) and not any(np.any(getattr(self, name)) for name in strengths)

    def energy(self, q: np.ndarray, dq: np.ndarray) -> float:
        """Energy now stored in the effect itself, e.g. in a spring [J].

        Args:
            q: Joint positions [rad], (n,).
            dq: Joint velocities [rad/s], (n,).
        """
        return 0.0

    def configure(self, world: World) -> None:
        """Change the world before it is built.

        That is `world.description`, `world.friction`, `world.contact` and
        `world.gravity`; `world.joint_index` finds joints, `world.dt` is the physics
        step, `world.robot` the robot. Called at every reset, first, whatever `start`
        says.
        """

    def reset(self, rng: np.random.Generator) -> None:
        """Forget everything; `rng` is this effect's own random stream from now on."""

    def on_command(self, q: np.ndarray, dq: np.ndarray, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Motion command as the drives get it.

        Called before every physics step. Between two commands the same arrays come
        again (`is`), so an effect can tell a new command from an old one.

        Args:
            q: Desired joint positions [rad], (n,).
            dq: Desired joint velocities [rad/s], (n,).
            t: Time [s].
        """
        return q, dq

    def on_drive(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Torque that the drives give, given what they want within their limits.

        Springs of the robot are beside the drives and not in it. Called before every physics
        step; arguments as of `on_torque`.
        """
        return tau

    def on_torque(
        self, tau: np.ndarray, q: np.ndarray, dq: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Torque on the joints, given that of drives and springs.

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
        self, rows: np.ndarray, asked: np.ndarray, speed: np.ndarray, dt: float, t: float
    ) -> np.ndarray:
        """Constants of the motors of servos in this physics step.

        Called before every physics step, after `on_command`, for robots that list drives.

        Args:
            rows: Drives as they are, a row each (`servo.ServoParams.row`),
                (n, COLUMNS).
            asked: Share of its voltage that each servo asks for, (n,).
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
        """Torque that is there to stop each joint, e.g. dry friction.

        The engine gives each joint as much of it as stops the joint and no more: it
        never reverses a motion, never adds energy, and does not chatter. Called
        before every physics step, after `on_torque`.

        Args:
            budget: Stopping torque of the effects before this one [N·m], (n,), >= 0; add to it.
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
        """State of the base in truth, where its IMU says what it says.

        Gap finding starts models where IMU and legs say a robot was.

        Args:
            base: State of a robot without the effect, of which the IMU would say the same.
        """
        return base

    def depth(self, load: Mapping[str, np.ndarray], dt: float) -> Mapping[str, np.ndarray]:
        """Depth in the ground of the feet that the effect lets sink [m], (T,) each.

        Args:
            load: Force of the ground on each foot [N], (T,) each.
            dt: Time between samples [s].
        """
        return {}

    def pull(self) -> Any:
        """The one force that `on_step` is, as a `pulls.Pull`; None where it is more than that."""
        return None

    def on_measurement(self, state: RobotState) -> RobotState:
        """Readings of the sensors, given the truth. Called once per control period."""
        return state


def names() -> list[str]:
    """Names of all effects."""
    return sorted(EFFECTS)


def applicable(robot: Robot) -> list[str]:
    """Names of the effects that make sense on a robot."""
    return [name for name in names() if EFFECTS[name].applies(robot)]


def make(name: str, **params: Any) -> Effect:
    """Effect by name.

    Raises:
        NameUnknownError: No such effect, or no such parameter.
        ParameterError: A parameter has the wrong type or is out of range.
    """
    if not isinstance(name, str) or name not in EFFECTS:
        raise NameUnknownError("effect", str(name), EFFECTS)
    return from_dict(EFFECTS[name], params, f"effect {name}")


def from_list(specs: Iterable[Mapping[str, Any]] | None) -> list[Effect]:
    """Effects from an experiment's list: ``[{name: push, force: [0, 40, 0], start: 3}, …]``.

    Raises:
        NameUnknownError: An effect or a parameter is not known.
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


def streams(effects: Iterable[Effect], seed: int) -> list[np.random.Generator]:
    """One random stream per effect, keyed by the seed and the effect's name.

    So adding an effect does not change the noise of another. An effect listed
    twice gets two streams.
    """
    seen: dict[str, int] = {}
    made = []
    for effect in effects:
        count = seen[effect.name] = seen.get(effect.name, -1) + 1
        made.append(np.random.default_rng([seed, count, *effect.name.encode()]))
    return made


def overrides(effect: Effect, hook: str) -> bool:
    """Whether the effect's class has a hook of its own."""
    return getattr(type(effect), hook) is not getattr(Effect, hook)


def windows(effects: Iterable[Effect], hook: str, dt: float) -> list[tuple[int, float, Any]]:
    """First physics step, the one after the last, and function of each effect with a hook.

    Neighbours of one kind (the same `fuse`) become one function, which does what they
    would do one after the other and minds their windows: a call costs more than a law.
    Effects that their parameters switch off are left out.

    Args:
        effects: Effects in the order in which they act.
        hook: Name of a method of `Effect`.
        dt: Physics step [s].
    """
    made, acting = [], [e for e in effects if overrides(e, hook) and not e.absent()]
    for fuse, neighbours in itertools.groupby(acting, lambda e: e.fuse(hook)):
        group = list(neighbours)
        each = [(*span(e, dt), getattr(e, hook)) for e in group]
        if fuse is None or len(group) == 1:
            made += each
        else:
            first, last, _ = zip(*each, strict=True)
            made.append((min(first), max(last), fuse(group, hook, dt)))
    return made


def span(effect: Effect, dt: float) -> tuple[int, float]:
    """First physics step of an effect and the one after its last."""
    stop = round(effect.stop / dt) if effect.stop < math.inf else effect.stop
    return round(effect.start / dt), stop


def listens(robot: Robot) -> bool:
    """Whether any drive follows joint positions; a plain torque drive does not."""
    return any(not isinstance(drive, TorqueDrive) for drive in robot.drives.values())


# What effects may need: its name in a message, and the question to a robot.
NEEDS: dict[str, tuple[str, Callable[[Robot], bool]]] = {
    "base": ("base that moves", lambda robot: not robot.fixed_base),
    "feet": ("feet", lambda robot: len(robot.feet) > 0),
    "legs": ("legs", lambda robot: len(robot.feet) > 1),
    "turns": ("link that turns", lambda robot: not robot.fixed_base or len(turning(robot)) > 0),
    "drives": ("drive", lambda robot: len(robot.driven) > 0),
    "bolted": ("base that is bolted", lambda robot: robot.fixed_base),
    "follower": ("drive that follows a position", lambda robot: listens(robot)),
}
