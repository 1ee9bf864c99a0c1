# SPDX-License-Identifier: Apache-2.0
"""Lower bound of the time of a step: its arithmetic operations alone, on full SIMD lanes.

It is measured with independent operations without memory access. A real step also has loads,
stores and latencies.
"""

from __future__ import annotations

import time
from functools import cache

import numpy as np

from .integrator import outer
from .lanes import WIDTH, fma, get, inverse_length, put

# Operations of `integrator` in two dimensions with dampers along the links; each addition,
# product or fused pair counts as one. `inverse_length` is timed separately.
PER_LINK = 30  # differences 4, square and closing speed 4, drive 6, force 10, sums 6
PER_NODE = 2 * 11 + 2  # each axis: 5 drift, 2 ground, 1 drag, 3 kick; and the height


@outer
def _products(turns, values):
    """Eight independent chains of fused multiply-adds, 8 per iteration."""
    a, b, c, d = get(values, 0), get(values, 1), get(values, 2), get(values, 3)
    e, f, g, h = get(values, 4), get(values, 5), get(values, 6), get(values, 7)
    by, plus = get(values, 8), get(values, 9)
    for _ in range(turns):
        a, b, c, d = fma(a, by, plus), fma(b, by, plus), fma(c, by, plus), fma(d, by, plus)
        e, f, g, h = fma(e, by, plus), fma(f, by, plus), fma(g, by, plus), fma(h, by, plus)
    put(values, 0, a + b + c + d + e + f + g + h)


@outer
def _roots(turns, values):
    """Eight independent chains of inverse lengths, 8 per iteration."""
    a, b, c, d = get(values, 0), get(values, 1), get(values, 2), get(values, 3)
    e, f, g, h = get(values, 4), get(values, 5), get(values, 6), get(values, 7)
    for _ in range(turns):
        a, b, c, d = inverse_length(a), inverse_length(b), inverse_length(c), inverse_length(d)
        e, f, g, h = inverse_length(e), inverse_length(f), inverse_length(g), inverse_length(h)
    put(values, 0, a + b + c + d + e + f + g + h)


@cache
def operation_times() -> tuple[float, float]:
    """Time per fused multiply-add and per inverse length, for one number in full lanes [s]."""
    values = np.full((10, WIDTH), 0.5)
    best = [np.inf, np.inf]
    for _ in range(12):
        for k, kernel in enumerate((_products, _roots)):
            kernel(1, values)
            values[:] = 0.5
            began = time.thread_time()
            kernel(40_000, values)
            took = time.thread_time() - began
            best[k] = min(best[k], took / (40_000 * 8 * WIDTH))
    return best[0], best[1]


def seconds_per_step(nodes: int, links: int) -> float:
    """Time of the operations of one step of one network [s], on one core."""
    product, root = operation_times()
    return (links * PER_LINK + nodes * PER_NODE) * product + links * root
