# SPDX-License-Identifier: Apache-2.0
"""Free parameters of a candidate effect, scaled to order one."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Coordinate:
    """One free scalar parameter.

    Attributes:
        name: Parameter of the effect.
        size: Change of the parameter per unit, or its value at coordinate 0 if logarithmic.
        start: Initial coordinates for a fit, the most likely first.
        low: Smallest legal value of the parameter.
        high: Largest legal value of the parameter.
        unit: Unit of the parameter.
        strength: Whether it is a strength; the effect is absent when all its strengths are 0.
        logarithmic: Whether the value is `size exp(x)`; else `size x`.
        direction: Direction, for a parameter that is a vector; empty for a scalar.
        of: Joint of the parameter, for laws with one value per joint.
        origin: Value of a strength up to which the effect is absent in the recordings.
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
    origin: float = 0.0

    @property
    def label(self) -> str:
        """Name of the parameter, with its vector axis and joint if it has them.

        A value along the negative axis z is ``name.-z``.
        """
        parts = zip("xyz", self.direction, strict=False)
        axes = [f".{'-' * (part < 0.0)}{axis}" for axis, part in parts if part]
        return f"{self.name}{axes[0] if len(axes) == 1 else ''} {self.of}".strip()

    @property
    def one_sided(self) -> bool:
        """Whether the parameter is non-negative."""
        return self.low >= 0.0

    def unbounded(self, x: float) -> float:
        """Value of the parameter at a coordinate, without regard to its bounds."""
        return self.origin + self.size * (math.exp(min(x, 50.0)) if self.logarithmic else x)

    def value(self, x: float) -> float:
        """Value of the parameter at a coordinate, clipped to its bounds."""
        return min(max(self.unbounded(x), self.low), self.high)

    def inverse(self, value: float) -> float:
        """Coordinate of a parameter value."""
        ratio = (value - self.origin) / self.size  # `origin` is 0 if logarithmic
        return math.log(ratio) if self.logarithmic else ratio

    def clipped(self, x: float) -> float:
        """Coordinate clipped to the bounds of the parameter; within them the very same number."""
        return x if self.low <= self.unbounded(x) <= self.high else self.inverse(self.value(x))


def assemble(coordinates: Sequence[Coordinate], x: Sequence[float]) -> dict[str, Any]:
    """Parameter values at coordinates `x`; vector parameters are sums of their components."""
    values: dict[str, Any] = {}
    for c, at in zip(coordinates, x, strict=True):
        value = c.value(float(at))
        if c.direction:
            before = values.get(c.name, (0.0,) * len(c.direction))
            values[c.name] = tuple(b + value * d for b, d in zip(before, c.direction, strict=True))
        else:
            values[c.name] = value
    return {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}
