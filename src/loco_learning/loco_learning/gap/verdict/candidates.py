# SPDX-License-Identifier: Apache-2.0
"""Candidates that are weighed: an effect of the selected model, its parameters and its rivals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ..statistics.evidence import Comparison


def on_bound(value: float, bounds: Iterable[float], edge: float) -> bool:
    """Whether a value is next to a finite bound: `edge` is the distance over the larger of both."""
    finite = filter(math.isfinite, bounds)
    return any(abs(value - b) <= edge * max(abs(value), abs(b)) for b in finite)


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95 % interval, all in `unit`.

    Attributes:
        name: Name in the registry.
        value: Best value.
        low: Lower end of the interval.
        high: Upper end.
        unit: SI unit, - without one.
        least: Smallest value the fit may take, -inf without bound.
        most: Largest.
        absent: Value at which the effect is not there; None for a shape such as a velocity scale.
        sign: +1 or -1 where only this sign is physical, 0 where both are.
        spread: Deviation of the value between parts of the data that errors do not explain.
        with_shapes: Half of the interval with all shapes as they are; None where nobody asked.
            A cable's stiffness and free length may show as one force alone: the cable is there.
    """

    name: str
    value: float
    low: float
    high: float
    unit: str = "-"
    least: float = -math.inf
    most: float = math.inf
    absent: float | None = 0.0
    sign: int = 0
    spread: float = 0.0
    with_shapes: float | None = None

    @property
    def excludes_absent(self) -> bool:
        """A size of nothing is outside of the interval; False for a shape."""
        if self.absent is None:
            return False
        if self.with_shapes is not None:
            return abs(self.value - self.absent) > self.with_shapes
        return not self.low <= self.absent <= self.high


@dataclass(frozen=True)
class Rival:
    """Another effect in the place of a candidate, everything else refitted.

    Attributes:
        name: Name of the effect.
        place: Place where it sits.
        over: Evidence for the candidate over this one.
        closed: Share of the gap that it closes.
        trifle: It is too small to matter on any robot.
        worse: Rms that it leaves on all data over that of the selected model; at most 1 if it
            leaves less on held-out data.
        edge: A shape of it lies on the bound of its range, where it is another law.
    """

    name: str
    place: str
    over: Comparison
    closed: float = math.nan
    trifle: bool = False
    worse: float = 1.0
    edge: bool = False


@dataclass(frozen=True)
class Candidate:
    """A term of the selected model, with what speaks for it on held-out data.

    Attributes:
        name: Name of the effect.
        place: Place where it sits.
        estimates: Estimates of its parameters.
        gain: Evidence for the model over the same model without the term, refitted.
        closed: Share of the gap that comes back without it.
        rivals: The same model with another effect instead, refitted.
        trifle: It is too small to matter on any robot.
        total: Gain on all data, its parameters paid: a few seconds of held-out data of
            slow motion are too few blocks to tell chance from an effect.
        worse: Ratio as of a rival, of the model without the term: what acts in a few blocks only.
        elsewhere: It shows in none of the data that judge, so that all were taken.
    """

    name: str
    place: str
    estimates: tuple[Estimate, ...]
    gain: Comparison
    closed: float
    rivals: tuple[Rival, ...] = ()
    trifle: bool = False
    traded: tuple[str, ...] = ()
    total: Comparison | None = None
    worse: float = 1.0
    elsewhere: bool = False
