# SPDX-License-Identifier: Apache-2.0
"""Fitted parameters with their intervals, and what about them is implausible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from loco_control.params import Params, parameter

from ..probability.prices import on_bound
from ..probability.weights import CRITERION


@dataclass(frozen=True)
class Alarms(Params):
    """Limits of plausible fitted values, for alarms. No verdict depends on these numbers."""

    spread: float = parameter(
        0.3, "deviation of a strength between parts of the data, over its value, from which on "
        "it is no constant of the robot", low=0.0
    )  # fmt: skip
    strained: float = parameter(
        2.0, "deviations of its prior that a value of the robot may be from what robot.yaml says",
        low=0.0,
    )  # fmt: skip


ALARMS = Alarms()


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


def absent(estimates: Sequence[Estimate]) -> bool:
    """True if all strengths of an effect may be those of its absence; False without a strength."""
    strengths = [e for e in estimates if e.absent is not None]
    return bool(strengths) and not any(e.excludes_absent for e in strengths)


def alarms(effect: str, estimates: Sequence[Estimate]) -> tuple[str, ...]:
    """Implausible parameters of an effect, with the reason, one line each.

    Args:
        effect: Name and place of the effect.
        estimates: Parameters of the effect with their intervals.
    """
    messages, open_ends = [], _undetermined(estimates)
    for e in estimates:
        where = f"{effect}: {e.name} = {e.value:.3g}" + f" {e.unit}" * (e.unit != "-")
        bounds = (b for b in (e.least, e.most) if b != e.absent)
        acts = math.isfinite(e.low) or math.isfinite(e.high)  # a place along an axis does not
        if acts and on_bound(e.value, bounds, CRITERION.edge):
            messages.append(f"{where} is on the bound of its range {e.least:g} to {e.most:g}")
        if e.sign * e.value < 0.0:
            kind = "negative" if e.value < 0.0 else "positive"
            messages.append(f"{where} is {kind}, which is not physical")
        if e in open_ends:
            messages.append(f"{where} has no interval: the data do not determine it")
        if e.absent is not None and e.spread > ALARMS.spread * _size(e, estimates):
            messages.append(f"{where} differs by {e.spread:.2g} between parts of the data")
    return tuple(messages)


def _size(one: Estimate, estimates: Sequence[Estimate]) -> float:
    """Largest distance from absence of strengths in its unit: a vector may have components of 0."""
    same_unit = (e for e in estimates if e.absent is not None and e.unit == one.unit)
    return max(abs(e.value - e.absent) for e in same_unit)


def _undetermined(estimates: Sequence[Estimate]) -> list[Estimate]:
    """Parameters without a finite interval, if no strength is determined; otherwise none.

    A stop that is too stiff to be determined has a smallest size: its interval has no upper end.

    A force along one axis of a hinge has two components without effect; a stop that is hardly
    touched has an undetermined damping. Only the strength of the effect must be determined.
    """
    open_ends = [e for e in estimates if not (math.isfinite(e.low) and math.isfinite(e.high))]
    candidates = [e for e in open_ends if e.absent is None or e.low <= e.absent <= e.high]
    determined = any(e.absent is not None and e not in candidates for e in estimates)
    return [] if determined else candidates
