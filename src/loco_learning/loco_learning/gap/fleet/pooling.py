# SPDX-License-Identifier: Apache-2.0
"""Random effects: sizes of members that differ by more than their own errors explain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq


class Mean(NamedTuple):
    """A pooled size and its variance."""

    value: float
    variance: float


def between(sizes: np.ndarray, variances: np.ndarray, groups: Sequence[int]) -> float:
    """Variance of true sizes within groups, by Paule and Mandel (1982).

    With it, the weighted squares about the means of the groups are as many as they have degrees
    of freedom.

    Args:
        sizes: Estimates, (N,).
        variances: Their own variances, (N,).
        groups: Group of each, (N,).

    Returns:
        The variance, at least 0; 0 if no group has two members.
    """
    sizes, variances = np.asarray(sizes, dtype=float), np.asarray(variances, dtype=float)
    _, of = np.unique(np.asarray(groups), return_inverse=True)
    freedom = len(sizes) - len(np.unique(of))

    def excess(heterogeneity: float) -> float:
        weight = 1.0 / (variances + heterogeneity)
        means = np.bincount(of, weight * sizes) / np.bincount(of, weight)
        return float(weight @ np.square(sizes - means[of])) - freedom

    if freedom < 1 or excess(0.0) <= 0.0:
        return 0.0
    limit = float(np.ptp(sizes)) ** 2  # larger than any heterogeneity
    return float(brentq(excess, 0.0, 2.0 * limit * len(sizes)))


def mean(sizes: np.ndarray, variances: np.ndarray, heterogeneity: float = 0.0) -> Mean:
    """Weighted mean of sizes whose true values have a variance.

    Args:
        sizes: Estimates, (N,), at least one.
        variances: Their own variances, (N,).
        heterogeneity: Variance of the true sizes.
    """
    weight = 1.0 / (np.asarray(variances) + heterogeneity)
    return Mean(float(weight @ sizes / weight.sum()), float(1.0 / weight.sum()))
