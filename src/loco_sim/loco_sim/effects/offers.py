# SPDX-License-Identifier: Apache-2.0
"""Offers of an effect to gap finding: a location with fixed and free parameters.

Effects create their offers in `base.Effect.offers`, with the functions of this module.
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
RADIUS = 2.0  # largest distance of the end of a cable from a likely one [m] (taste: a room)


@dataclass(frozen=True)
class Motion:
    """Ranges of joint motion and features of the residual, known before any fit.

    Attributes:
        low: Smallest measured position of each joint [rad], (n,); NaN if not measured.
        high: Largest measured position of each joint [rad], (n,).
        intervals: Time intervals of large residuals, the same in all recordings [s].
        fast: Largest speed of each joint [rad/s], (n,); NaN or empty if not measured.
        ripples: Numbers of periods per turn of the residual's ripple, by joint, the likeliest
            first; empty for joints without ripple.
    """

    low: np.ndarray
    high: np.ndarray
    intervals: tuple[tuple[float, float], ...] = ()
    fast: np.ndarray = field(default_factory=lambda: np.zeros(0))
    ripples: tuple[tuple[float, ...], ...] = ()


class Offer(NamedTuple):
    """An effect at a location, with the parameters to identify."""

    place: str  # name or pattern of joint, link or foot; "" if it has none
    fixed: tuple[tuple[str, Any], ...]  # fixed parameters
    coordinates: tuple[Coordinate, ...]  # free parameters, strengths first
    variant: str = ""  # variant of the effect, e.g. the signal of a sensor


def scalar_offer(cls: type[Effect], place: str) -> Offer:
    """Offer with all scalar parameters that have a prior free."""
    fixed = (("joint", place),) if place else ()
    free = [coordinate(cls, name) for name in cls.identity.priors]
    return Offer(place, fixed, tuple(sorted(free, key=lambda c: not c.strength)))


def coordinate(cls: type[Effect], name: str) -> Coordinate:
    """Coordinate of a scalar parameter: typical size, bounds, initial values."""
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
    """Coordinate of a strength with a typical size, along `direction` for a vector parameter."""
    bounds = bounds_of(cls, name)
    return Coordinate(name, size, (1.0,), *bounds, strength=True, direction=tuple(direction))


def vector(cls: type[Effect], name: str) -> tuple[Coordinate, ...]:
    """Coordinates of the strengths of a vector parameter along x, y and z."""
    return tuple(strength(cls, name, cls.identity.priors[name].high / 3.0, axis) for axis in AXES)


def place(cls: type[Effect], name: str, at: Sequence[float]) -> tuple[Coordinate, ...]:
    """Coordinates of a place along x, y and z, within `RADIUS` of where it is looked for [m]."""
    unit = bounds_of(cls, name)[2]
    return tuple(
        Coordinate(
            name, 0.3, (0.0,), origin - RADIUS, origin + RADIUS, unit, False, False, tuple(axis),
            origin=origin,
        )
        for axis, origin in zip(AXES, at, strict=True)
    )  # fmt: skip


def logarithmic(cls: type[Effect], name: str, starts: Sequence[float]) -> Coordinate:
    """Logarithmic coordinate of a shape parameter, with initial values."""
    low, high, unit = bounds_of(cls, name)
    at = tuple(math.log(value / starts[0]) for value in starts)
    return Coordinate(name, starts[0], at, max(low, 1e-9), high, unit, logarithmic=True)


def at_most(shape: Coordinate, limit: float) -> Coordinate:
    """A logarithmic coordinate with initial value and upper bound reduced to at most a value.

    Args:
        shape: The coordinate.
        limit: Largest value; NaN for no change.
    """
    if not shape.low < limit < shape.high:
        return shape
    size = min(shape.size, limit)
    start = tuple(dict.fromkeys(min(x, math.log(limit / size)) for x in shape.start))
    return replace(shape, size=size, start=start, high=limit)


def within(
    cls: type[Effect], name: str, size: float, starts: Sequence[float], low: float, high: float
) -> Coordinate | None:
    """Coordinate of a shape parameter between two values, within the parameter's legal range.

    Args:
        cls: The effect.
        name: Name of the parameter.
        size: Value at coordinate 1.
        starts: Initial coordinates, clipped to the bounds.
        low: Smallest value.
        high: Largest value.

    Returns:
        The coordinate; None if the interval is empty.
    """
    lower, upper, unit = bounds_of(cls, name)
    low, high = max(low, lower), min(high, upper)
    if not low < high:
        return None
    inside = tuple(min(max(s * size, low), high) / size for s in starts)
    return Coordinate(name, size, inside, low, high, unit)


def bounds_of(cls: type[Effect], name: str) -> tuple[float, float, str]:
    """Smallest and largest legal value of a parameter, infinite if unbounded, and its unit."""
    return (*limits(cls, name), cls.__dataclass_fields__[name].metadata["unit"])
