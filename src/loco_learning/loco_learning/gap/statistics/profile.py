# SPDX-License-Identifier: Apache-2.0
"""Intervals of strengths by likelihood profiles, from simulations beyond the linear range.

The derivative at the optimum predicts how the cost rises. Where a stop gets stiffer the motion
hardly changes any more, and where play or friction sticks it changes in steps: there the cost
rises less than predicted, the interval is longer, and it may be unbounded on a side without a
physical limit.
"""

from __future__ import annotations

import math
from collections.abc import Callable

HOLDS = 0.5  # share of the predicted cost at which the predicted end of an interval holds (taste)
FURTHER = 2.0  # factor between further steps (taste)
STEPS = 5  # largest number of steps
TOWARDS = (0.5, 0.25, 0.1, 0.03)  # tried shares of a strength between its value and 0


def interval(
    cost: Callable[[float], float], at: float, radius: float, predicted: float, one_sided: bool
) -> tuple[float, float]:
    """Lower and upper end of the interval of a strength, in its coordinate.

    Args:
        cost: Rise of the cost at a coordinate [nat], everything else fixed.
        at: Best coordinate; the effect is absent at 0.
        radius: Half of the interval from derivatives.
        predicted: Cost that derivatives predict at its ends [nat].
        one_sided: Whether the coordinate cannot be below 0.

    Returns:
        Both ends; infinite where the cost never rises as far.
    """
    sides = [_end(cost, at, side * radius, predicted) for side in (-1.0, 1.0)]
    if one_sided and not sides[0] > 0.0:
        sides[0] = _towards(cost, at, predicted)
    return sides[0], sides[1]


def _end(cost: Callable[[float], float], at: float, distance: float, predicted: float) -> float:
    """End of the interval on one side: the predicted one, or a farther one if the cost is lower."""
    if cost(at + distance) >= HOLDS * predicted:
        return at + distance
    for _ in range(STEPS):
        distance *= FURTHER
        if cost(at + distance) >= predicted:
            return at + distance
    return math.copysign(math.inf, distance)


def _towards(cost: Callable[[float], float], at: float, predicted: float) -> float:
    """End between 0 and a strength whose cost rises sooner than derivatives predict."""
    for share in TOWARDS:
        if cost(share * at) >= predicted:
            return share * at
    return 0.0
