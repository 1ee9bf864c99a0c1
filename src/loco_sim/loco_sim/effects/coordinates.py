# SPDX-License-Identifier: Apache-2.0
"""Free parameters of a hypothesis as plain numbers of order one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Coordinate:
    """One free number.

    Attributes:
        name: Parameter of the effect.
        size: Value of the parameter at coordinate 1, or at 0 when logarithmic.
        start: Coordinates worth a try, the most likely first.
        low: Smallest legal value of the parameter.
        high: Largest legal value of the parameter.
        unit: Unit of the parameter.
        strength: The effect is absent when all its strengths are 0.
        logarithmic: The value is `size exp(x)`, else `size x`.
        direction: Addition to a parameter that is a vector per unit of value; empty for a scalar.
        of: Joint that it belongs to, where a law has a size per joint.
    """

    name: str
    size: float
    start: tuple[float, ...]
    low: float
    high: float
    unit: str = "-"
    strength: bool = False
    logarithmic: bool = False
    direction: tuple[float, ...] = ()
    of: str = ""

    @property
    def label(self) -> str:
        """Name with the axis of a vector, and the joint that it belongs to."""
        axes = [axis for axis, part in zip("xyz", self.direction, strict=False) if part]
        name = f"{self.name}.{axes[0]}" if len(axes) == 1 else self.name
        return f"{name} {self.of}".strip()

    @property
    def one_sided(self) -> bool:
        """The parameter cannot be below 0."""
        return self.low >= 0.0

    def value(self, x: float) -> float:
        """Parameter at a coordinate, forced into its bounds."""
        raw = self.size * (math.exp(min(x, 50.0)) if self.logarithmic else x)
        return min(max(raw, self.low), self.high)

    def inverse(self, value: float) -> float:
        """Coordinate of a parameter."""
        return math.log(value / self.size) if self.logarithmic else value / self.size

    def clipped(self, x: float) -> float:
        """Coordinate forced into the bounds of the parameter."""
        return self.inverse(self.value(x))


def assemble(coordinates: Sequence[Coordinate], x: Sequence[float]) -> dict[str, Any]:
    """Parameters of coordinates: vectors from their parts, scalars as they are."""
    values: dict[str, Any] = {}
    for c, at in zip(coordinates, x, strict=True):
        value = c.value(float(at))
        if c.direction:
            before = values.get(c.name, (0.0,) * len(c.direction))
            values[c.name] = tuple(b + value * d for b, d in zip(before, c.direction, strict=True))
        else:
            values[c.name] = value
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
