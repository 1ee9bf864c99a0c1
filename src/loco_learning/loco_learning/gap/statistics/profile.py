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

FLAT = 0.5  # share of the predicted cost at which the predicted end of an interval holds (taste)
FURTHER = 2.0  # factor between further steps (taste)
STEPS = 5  # largest number of steps
TOWARDS = (0.5, 0.25, 0.1, 0.03)  # tried shares of a strength between its value and 0


def ends(
    cost: Callable[[float], float], at: float, far: float, promised: float, one_sided: bool
) -> tuple[float, float]:
    """Lower and upper end of the interval of a strength, in its coordinate.

    Args:
        cost: Rise of the cost at a coordinate [nat], everything else fixed.
        at: Best coordinate; the effect is absent at 0.
        far: Half of the interval from derivatives.
        promised: Cost that derivatives predict at its ends [nat].
        one_sided: Whether the coordinate cannot be below 0.

    Returns:
        Both ends; infinite where the cost never rises as far.
    """
    sides = [_end(cost, at, side * far, promised) for side in (-1.0, 1.0)]
    if one_sided and at > 0.0 and not sides[0] > 0.0:
        sides[0] = _towards(cost, at, promised)
    return sides[0], sides[1]


def _end(cost: Callable[[float], float], at: float, far: float, promised: float) -> float:
    """End of the interval on one side: the predicted one, or a farther one if the cost is lower."""
    if cost(at + far) >= FLAT * promised:
        return at + far
    for _ in range(STEPS):
        far *= FURTHER
        if cost(at + far) >= promised:
            return at + far
    return math.copysign(math.inf, far)


def _towards(cost: Callable[[float], float], at: float, promised: float) -> float:
    """End between 0 and a strength whose cost rises sooner than derivatives predict."""
    for share in TOWARDS:
        if cost(share * at) >= promised:
            return share * at
    return 0.0
