# SPDX-License-Identifier: Apache-2.0
"""Jitter of the times of readings, from the readings alone.

The difference of order k over k + 1 readings removes the motion and keeps noise. With readings at
uneven times it keeps the change of the signal in these times too: its variance is that of the noise
plus that of the times, times the square of the rate. The rate is the slope of a cubic over the same
readings, which is independent of the difference for white noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .noise import FEWEST

# Orders of differences; the smallest jitter counts, which the motion affects least.
EVEN_ORDERS = 4, 6, 8
DEGREE = 3  # of the polynomial whose slope is the rate
ROUNDS = 5  # updates of the weights of the regression; two are enough (taste)
SIGNIFICANT = 3.0  # standard errors of a jitter that is significant (theory: 3 in 1,000 by chance)


def jitter(records: Sequence[tuple[np.ndarray, float]]) -> float:
    """Standard deviation of the times of readings about even ones [s]; 0 if not significant.

    Args:
        records: Readings of joints that were read together, (T, n), NaN where there is none; and
            time between their rows [s].
    """
    variances = []
    for order in EVEN_ORDERS:
        pairs = [_variance(x, dt, order) for values, dt in records for x in values.T]
        weight = np.array([1.0 / error**2 for _, error in pairs])
        if not weight.any():
            return 0.0
        variance = float(np.array([v for v, _ in pairs]) @ weight / weight.sum())
        if variance < SIGNIFICANT / math.sqrt(weight.sum()):
            return 0.0
        variances.append(variance)
    return math.sqrt(min(variances))


def rate(values: np.ndarray, dt: float, order: int = EVEN_ORDERS[0]) -> np.ndarray:
    """Slope of a cubic over `order` + 1 readings about each one, (T,); NaN where one is missing."""
    radius = order // 2
    place = np.arange(-radius, radius + 1)
    weights = np.linalg.pinv(place[:, None] ** np.arange(DEGREE + 1.0))[1] / dt
    return _window(values, weights)


def _window(values: np.ndarray, weights: Sequence[float]) -> np.ndarray:
    """Weighted sum of the readings about each one, (T,); NaN at the ends."""
    result, radius = np.full(len(values), np.nan), len(weights) // 2
    if len(values) >= len(weights):
        inner = np.convolve(values, np.asarray(weights)[::-1], mode="valid")
        result[radius : radius + len(inner)] = inner
    return result


def _variance(values: np.ndarray, dt: float, order: int) -> tuple[float, float]:
    """Variance of the times of readings [s²], and its standard error; infinite if unknown."""
    signs = [(-1.0) ** k * math.comb(order, k) for k in range(order + 1)]
    square = np.square(_window(values, signs)) / math.comb(2 * order, order)
    speed = np.square(rate(values, dt, order))
    used = np.isfinite(square)
    terms = np.stack([np.ones(used.sum()), speed[used]], axis=1)
    if used.sum() < FEWEST * (order + 1) or np.ptp(terms[:, 1]) <= 0.0:
        return 0.0, math.inf
    size, level = terms.max(axis=0), np.full(len(terms), square[used].mean() or 1.0)
    for _ in range(ROUNDS):  # squares of normal values spread in proportion to their mean
        weighted = terms / size / level[:, None]
        gram = weighted.T @ weighted + 1e-12 * np.eye(2)
        best = np.linalg.solve(gram, weighted.T @ (square[used] / level))
        level = np.maximum(terms / size @ np.maximum(best, 0.0), 1e-6 * level.max())
    error = math.sqrt(2.0 * (order + 1) * np.linalg.inv(gram)[1, 1])  # neighbours share readings
    return float(best[1] / size[1]), float(error / size[1])
