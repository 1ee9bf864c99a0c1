# SPDX-License-Identifier: Apache-2.0
"""Offers of an effect to gap finding: a place, parameters that stay, and those that are free.

An effect offers this itself (`base.Effect.offers`), in the words of this module.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from loco_control.params import limits

from .coordinates import Coordinate

if TYPE_CHECKING:
    from .base import Effect

AXES = np.eye(3).tolist()


@dataclass(frozen=True)
class Hints:
    """Travel of the joints, and times at which the residual is large, before any fit.

    Attributes:
        low: Smallest measured position of each joint [rad], (n,); NaN if not measured.
        high: Largest measured position of each joint [rad], (n,).
        intervals: Times between which the residual is large, the same in all records [s].
        fast: Largest speed of each joint [rad/s], (n,); NaN or empty if not measured.
        ripples: Periods in 2 pi of each joint with which the residual goes up and down, the
            likeliest first; empty where it does not.
    """

    low: np.ndarray
    high: np.ndarray
    intervals: tuple[tuple[float, float], ...] = ()
    fast: np.ndarray = field(default_factory=lambda: np.zeros(0))
    ripples: tuple[tuple[float, ...], ...] = ()


class Offer(NamedTuple):
    """An effect at a place, with what data shall tell of it."""

    place: str  # joint, link or foot, by name or pattern; empty where it has none
    fixed: tuple[tuple[str, Any], ...]  # parameters that stay as they are
    coordinates: tuple[Coordinate, ...]  # free parameters, strengths first
    variant: str = ""  # which part of an effect with many, e.g. the signal of a sensor


def plain(cls: type[Effect], place: str) -> Offer:
    """Every scalar of an effect that has a prior is free."""
    fixed = (("joint", place),) if place else ()
    free = [coordinate(cls, name) for name in cls.identity.priors]
    return Offer(place, fixed, tuple(sorted(free, key=lambda c: not c.strength)))


def coordinate(cls: type[Effect], name: str) -> Coordinate:
    """Coordinate of a scalar parameter: typical size, bounds, values to start from."""
    prior, bounds = cls.identity.priors[name], bounds_of(cls, name)
    if name in cls.identity.strengths:
        size = prior.typical if prior.low > 0.0 else prior.high / 3.0
        return Coordinate(name, size, (1.0,), *bounds, strength=True)
    if prior.low <= 0.0:
        return Coordinate(name, prior.high / 3.0, (0.0, 1.0, -1.0), *bounds)
    wide = math.log(prior.high / prior.low) / 3.0
    return Coordinate(name, prior.typical, (0.0, -wide, wide), *bounds, logarithmic=True)


def strength(
    cls: type[Effect], name: str, size: float, direction: Sequence[float] = ()
) -> Coordinate:
    """Strength of an effect with a typical size; along a direction where it is a vector."""
    bounds = bounds_of(cls, name)
    return Coordinate(name, size, (1.0,), *bounds, strength=True, direction=tuple(direction))


def vector(cls: type[Effect], name: str) -> tuple[Coordinate, ...]:
    """Strengths along x, y and z of a parameter that is a vector."""
    size = cls.identity.priors[name].high / 3.0
    return tuple(strength(cls, name, size, axis) for axis in AXES)


def logarithmic(cls: type[Effect], name: str, starts: Sequence[float]) -> Coordinate:
    """Logarithm of a shape, from values that are worth a try."""
    low, high, unit = bounds_of(cls, name)
    at = tuple(math.log(value / starts[0]) for value in starts)
    return Coordinate(name, starts[0], at, max(low, 1e-9), high, unit, logarithmic=True)


def at_most(shape: Coordinate, most: float) -> Coordinate:
    """A logarithmic shape that begins and ends at a value, if that is below where it would.

    Args:
        shape: The coordinate.
        most: Largest value; NaN leaves the shape as it is.
    """
    if not shape.low < most < shape.high:
        return shape
    size = min(shape.size, most)
    start = tuple(dict.fromkeys(min(x, math.log(most / size)) for x in shape.start))
    return replace(shape, size=size, start=start, high=most)


def within(
    cls: type[Effect], name: str, size: float, starts: Sequence[float], low: float, high: float
) -> Coordinate | None:
    """A shape between two values, none of them beyond what the parameter may be.

    Args:
        cls: The effect.
        name: Name of the parameter.
        size: Value at coordinate 1.
        starts: Coordinates worth a try; those beyond the bounds are moved onto them.
        low: Smallest value.
        high: Largest value.

    Returns:
        None where no value is left.
    """
    least, most, unit = bounds_of(cls, name)
    low, high = max(low, least), min(high, most)
    if not low < high:
        return None
    inside = tuple(min(max(s * size, low), high) / size for s in starts)
    return Coordinate(name, size, inside, low, high, unit)


def bounds_of(cls: type[Effect], name: str) -> tuple[float, float, str]:
    """Smallest and largest value of a parameter, infinite without bound, and its unit."""
    return (*limits(cls, name), cls.__dataclass_fields__[name].metadata["unit"])
