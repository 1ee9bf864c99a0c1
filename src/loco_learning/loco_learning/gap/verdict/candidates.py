# SPDX-License-Identifier: Apache-2.0
"""Candidates of the verdict: an effect of the selected model, its parameters and its rivals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ..statistics.evidence import Comparison


def on_bound(value: float, bounds: Iterable[float], edge: float) -> bool:
    """True if a value is within `edge` of a finite bound, relative to the larger of both."""
    finite = filter(math.isfinite, bounds)
    return any(abs(value - b) <= edge * max(abs(value), abs(b)) for b in finite)


@dataclass(frozen=True)
class Estimate:
    """A fitted parameter with its 95 % interval, all in `unit`.

    Attributes:
        name: Name in the registry.
        value: Best value.
        low: Lower end of the interval.
        high: Upper end of the interval.
        unit: SI unit, - without one.
        least: Smallest value in a fit, -inf without bound.
        most: Largest value in a fit, inf without bound.
        absent: Value without any effect; None for a shape such as a velocity scale.
        sign: +1 or -1 if only this sign is physical, 0 if both are.
        spread: Deviation of the value between parts of the data that errors do not explain.
        with_shapes: Half of the interval with all shapes fixed; None if not computed. If a
            cable's stiffness and free length show as one force only, the cable is established.
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
        """True if the absent value is outside of the interval; False for a shape."""
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
        place: Place of the effect.
        over: Evidence for the candidate over this one.
        closed: Share of the gap that it closes.
        trifle: Whether it is negligible on any robot.
        worse: Ratio of its rms on all data to that of the selected model; at most 1 if its rms
            on held-out data is smaller.
        edge: Whether one of its shapes is on a bound, where it becomes another law.
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
    """A term of the selected model, with its evidence on held-out data.

    Attributes:
        name: Name of the effect.
        place: Place of the effect.
        estimates: Estimates of its parameters.
        gain: Evidence for the model over the same model without the term, refitted.
        closed: Share of the gap that reopens without it.
        rivals: The same model with another effect instead, refitted.
        trifle: Whether it is negligible on any robot.
        total: Gain on all data, with the penalty of its parameters: a few seconds of held-out
            data of slow motion are too few blocks to exclude chance.
        worse: Ratio as in `Rival`, for the model without the term; for effects in a few blocks.
        elsewhere: Whether all data were used, since it shows in no held-out data.
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
