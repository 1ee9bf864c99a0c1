# SPDX-License-Identifier: Apache-2.0
"""Ends of intervals of strengths, from simulations further off than a derivative sees.

A derivative at the best value promises how the cost rises. Where a stop grows harder the motion
hardly changes any more, and where play or friction sticks it changes in steps: there the cost
rises by less than was promised, the interval is longer, and on the side without an end it may
have none.
"""

from __future__ import annotations

import math
from collections.abc import Callable

FLAT = 0.5  # of the promised cost at the end of an interval that is as good as promised (taste)
FURTHER = 2.0  # factor of each step beyond (taste)
STEPS = 5  # at most
TOWARDS = (0.5, 0.25, 0.1, 0.03)  # shares of a strength between its value and nothing


def ends(
    cost: Callable[[float], float], at: float, far: float, promised: float, one_sided: bool
) -> tuple[float, float]:
    """Lower and upper end of the interval of a strength, in its coordinate.

    Args:
        cost: Rise of the cost at a coordinate [nat], everything else as it is.
        at: Best coordinate, nothing at 0.
        far: Half of the interval by derivatives.
        promised: Cost that derivatives promise at its ends [nat].
        one_sided: It cannot be below 0.

    Returns:
        Both ends; an infinite one where the cost never rises as far.
    """
    sides = [_end(cost, at, side * far, promised) for side in (-1.0, 1.0)]
    if one_sided and at > 0.0 and not sides[0] > 0.0:
        sides[0] = _towards(cost, at, promised)
    return sides[0], sides[1]


def _end(cost: Callable[[float], float], at: float, far: float, promised: float) -> float:
    """End on one side: as promised, or further off where the cost has not risen yet."""
    if cost(at + far) >= FLAT * promised:
        return at + far
    for _ in range(STEPS):
        far *= FURTHER
        if cost(at + far) >= promised:
            return at + far
    return math.copysign(math.inf, far)


def _towards(cost: Callable[[float], float], at: float, promised: float) -> float:
    """End towards nothing of a strength whose cost rises sooner than derivatives promise."""
    for share in TOWARDS:
        if cost(share * at) >= promised:
            return share * at
    return 0.0
