# SPDX-License-Identifier: Apache-2.0
"""What may be missing in a model: every effect of the registry that fits the robot, everywhere.

A `Hypothesis` is an effect at a place with its free parameters as `Coordinate`s: strengths,
which are 0 when the effect is absent, and shapes, which say how it acts while it is there.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from loco_sim import effects
from loco_sim.effects.base import Effect
from loco_sim.effects.identity import Prior
from loco_sim.robot import Robot

from . import structured
from .coordinates import Coordinate, assemble
from .decide import TWINS
from .hints import Hints
from .places import joint_places

NOISE = ("sensor_noise", "command_dropout", "slip", "sensor_stuck", "quantisation")


@dataclass(frozen=True)
class Term:
    """An effect with its parameters, as it stands in a model.

    Attributes:
        effect: Its name.
        place: Joint, link or foot, by name or pattern; empty where it has none.
        params: Values as in an experiment's list, without the name.
    """

    effect: str
    place: str
    params: dict[str, Any]

    @property
    def spec(self) -> dict[str, Any]:
        """Entry of an experiment's list of effects."""
        return {"name": self.effect, **self.params}


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a place, with what data shall tell of it.

    Attributes:
        effect: Its name.
        place: As in `Term`.
        fixed: Parameters that stay as they are.
        coordinates: Free parameters, strengths first.
        variant: Which part of an effect with many, e.g. the signal of a sensor.
    """

    effect: str
    place: str
    fixed: tuple[tuple[str, Any], ...]
    coordinates: tuple[Coordinate, ...]
    variant: str = ""

    @property
    def key(self) -> str:
        """Name of the hypothesis, for sorting, messages and random streams."""
        return " ".join(filter(None, (self.effect, self.variant, self.place)))

    @property
    def strengths(self) -> list[int]:
        """Which coordinates are 0 when the effect is absent."""
        return [i for i, c in enumerate(self.coordinates) if c.strength]

    def term(self, x: Sequence[float]) -> Term:
        """The effect at values of its coordinates, each forced into its bounds."""
        values = assemble(self.coordinates, x)
        if "stop" in values:  # of a push: never before its start
            values["stop"] = max(values["stop"], values["start"])
        return Term(self.effect, self.place, {**dict(self.fixed), **values})

    def starts(self) -> list[list[float]]:
        """Values of the shapes that are worth a try, strengths one typical unit.

        A lone strength of two signs is tried with the other one, too: a joint that is bolted on
        with a turn starts elsewhere, however small the turn, which hides its sign.
        """
        count = max(len(c.start) for c in self.coordinates)
        made = [[c.start[min(k, len(c.start) - 1)] for c in self.coordinates] for k in range(count)]
        lone = self.strengths if len(self.strengths) == 1 else ()
        if lone and not self.coordinates[lone[0]].one_sided:
            made.append([-v if i in lone else v for i, v in enumerate(made[0])])
        return made


def separable(hypotheses: Sequence[Hypothesis]) -> list[Hypothesis]:
    """Without those that no recording tells from another one that is there: see `TWINS`."""
    twins = {twin for h in hypotheses for twin in TWINS.get(h.effect, ())}
    return [h for h in hypotheses if h.effect not in twins or h.variant]


def offer(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Hypothesis]:
    """All hypotheses about a robot.

    Args:
        robot: Which robot.
        signals: What was measured, e.g. ("q", "dq", "gyro").
        hints: What the data say before any fit.
    """
    found: list[Hypothesis] = []
    for name in effects.applicable(robot):
        if name in NOISE:
            continue
        cls = effects.EFFECTS[name]
        if name in structured.BUILDERS:
            made = structured.BUILDERS[name](robot, signals, hints)
            found += [Hypothesis(name, *entry) for entry in made]
        else:
            found += [_plain(cls, place) for place in _places(cls, robot)]
    return found


def _places(cls: type[Effect], robot: Robot) -> list[str]:
    """Where an effect may sit: joints one by one and in groups, or nowhere in particular."""
    names = {f.name for f in dataclasses.fields(cls)}
    if "joint" not in names or getattr(cls, "shared", False):
        return [""]
    return joint_places(robot, getattr(cls, "among", "all"))


def _plain(cls: type[Effect], place: str) -> Hypothesis:
    """Every scalar with a prior is free."""
    known = cls.identity
    fixed = (("joint", place),) if place else ()
    coordinates = [
        coordinate(cls, name, prior, name in known.strengths)
        for name, prior in known.priors.items()
    ]
    coordinates.sort(key=lambda c: not c.strength)
    return Hypothesis(cls.name, place, fixed, tuple(coordinates))


def coordinate(cls: type[Effect], name: str, prior: Prior, strength: bool) -> Coordinate:
    """Coordinate of a scalar parameter: typical size, bounds, values to start from."""
    meta = next(f.metadata for f in dataclasses.fields(cls) if f.name == name)
    low, high = meta.get("low"), meta.get("high")
    low = -math.inf if low is None else low
    high = math.inf if high is None else high
    if strength:
        size = prior.typical if prior.low > 0.0 else prior.high / 3.0
        return Coordinate(name, size, (1.0,), low, high, meta["unit"], strength=True)
    if prior.low <= 0.0:
        return Coordinate(name, prior.high / 3.0, (0.0, 1.0, -1.0), low, high, meta["unit"])
    wide = math.log(prior.high / prior.low) / 3.0
    return Coordinate(
        name, prior.typical, (0.0, -wide, wide), low, high, meta["unit"], logarithmic=True
    )
