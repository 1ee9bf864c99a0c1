# SPDX-License-Identifier: Apache-2.0
"""Hypotheses about a model: every applicable effect of the registry at every possible place.

A `Hypothesis` is an effect at a place with its free parameters as `Coordinate`s: strengths,
which are 0 when the effect is absent, and shapes, which say how it acts while it is present.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from loco_sim import effects
from loco_sim.effects import EFFECTS
from loco_sim.effects.coordinates import Coordinate, assemble
from loco_sim.effects.offers import Motion
from loco_sim.effects.readings import Measuring
from loco_sim.robot.robot import Robot

NOTHING_TO_TRY = "these recordings give it no place, time or signal to act on"
READINGS = "it changes readings, and torques along the motion as it was read are compared"


@dataclass(frozen=True)
class Term:
    """An effect with its parameters, as an entry of a model.

    Attributes:
        effect: Name of the effect.
        place: Joint, link or foot, by name or pattern; empty if it has none.
        params: Values as in the list of an experiment, without the name.
    """

    effect: str
    place: str
    params: dict[str, Any]

    @property
    def spec(self) -> dict[str, Any]:
        """Entry in the list of effects of an experiment."""
        return {"name": self.effect, **self.params}


@dataclass(frozen=True)
class Hypothesis:
    """An effect at a place, with the parameters that the data determine.

    Attributes:
        effect: Name of the effect.
        place: Joint, link or foot, by name or pattern; empty if it has none.
        fixed: Parameters that are not fitted.
        coordinates: Free parameters, strengths first.
        variant: Part of an effect with many, e.g. the signal of a sensor.
        joints: Joints that share the law, each with a size of its own: their coordinates come
            one joint after the other. Empty for an effect at one place.
    """

    effect: str
    place: str
    fixed: tuple[tuple[str, Any], ...]
    coordinates: tuple[Coordinate, ...]
    variant: str = ""
    joints: tuple[str, ...] = ()

    @property
    def key(self) -> str:
        """Name of the hypothesis, for sorting, messages and random streams."""
        return " ".join(filter(None, (self.effect, self.variant, self.place)))

    @property
    def strengths(self) -> list[int]:
        """Indices of the coordinates that are 0 when the effect is absent."""
        return [i for i, c in enumerate(self.coordinates) if c.strength]

    def term(self, x: Sequence[float]) -> Term:
        """The effect at values of its coordinates, each clipped to its bounds."""
        values = assemble(self.coordinates, x)
        if "stop" in values:  # not before its start, see `Effect.start`
            values["stop"] = max(values["stop"], values["start"])
        return Term(self.effect, self.place, {**dict(self.fixed), **values})

    def terms(self, x: Sequence[float]) -> list[Term]:
        """The effect at each of its joints; one term if it is at one place."""
        if not self.joints:
            return [self.term(x)]
        count = len(self.coordinates) // len(self.joints)
        result = []
        for i, joint in enumerate(self.joints):
            span = slice(i * count, (i + 1) * count)
            values = assemble(self.coordinates[span], x[span])
            result.append(Term(self.effect, joint, {**dict(self.fixed), "joint": joint, **values}))
        return result

    def starts(self) -> list[list[float]]:
        """Initial coordinates of a search: shapes from their priors, strengths of one typical unit.

        A lone strength that may be negative is tested with both signs. An example is a joint that
        is mounted with a twist: it starts elsewhere, however small the twist, which hides its sign.
        """
        count = max(len(c.start) for c in self.coordinates)
        rows = [[c.start[min(k, len(c.start) - 1)] for c in self.coordinates] for k in range(count)]
        lone = self.strengths if len(self.strengths) == 1 else ()
        if lone and not self.coordinates[lone[0]].one_sided:
            rows.append([-v if i in lone else v for i, v in enumerate(rows[0])])
        return rows


def separable(
    hypotheses: Sequence[Hypothesis],
) -> tuple[list[Hypothesis], list[tuple[str, str]]]:
    """Hypotheses without those that no recording can distinguish (`Identity.twins`).

    Returns:
        The remaining hypotheses, and the excluded effects with the reason.
    """
    twin_names = {twin: h.effect for h in hypotheses for twin in EFFECTS[h.effect].identity.twins}
    rest = [h for h in hypotheses if h.effect not in twin_names or h.variant]
    excluded = {h.effect for h in hypotheses} - {h.effect for h in rest}
    return rest, [(name, f"no recording tells it from {twin_names[name]}") for name in sorted(excluded)]


def offer(robot: Robot, signals: Sequence[str], motion: Motion) -> list[Hypothesis]:
    """All hypotheses about a robot.

    Args:
        robot: Robot of the model.
        signals: Measured signals, e.g. ("q", "dq", "gyro").
        motion: Travel of the joints, and times at which the residual is large.
    """
    return [
        Hypothesis(name, *entry)
        for name in effects.applicable(robot)
        if not EFFECTS[name].identity.untried
        for entry in EFFECTS[name].offers(robot, signals, motion)
    ]


def omitted(
    robot: Robot, hypotheses: Sequence[Hypothesis], signals: Sequence[str]
) -> list[tuple[str, str]]:
    """Effects that apply to a robot but that no hypothesis contains, each with the reason.

    Args:
        robot: Robot of the model.
        hypotheses: Hypotheses that are tried.
        signals: Compared signals, e.g. ("q", "dq", "gyro").
    """
    present = {h.effect for h in hypotheses}
    names = [name for name in effects.applicable(robot) if name not in present]
    read = (
        {} if "q" in signals else {n: READINGS for n in names if issubclass(EFFECTS[n], Measuring)}
    )
    return [(n, EFFECTS[n].identity.untried or read.get(n, NOTHING_TO_TRY)) for n in names]
