# SPDX-License-Identifier: Apache-2.0
"""Errors of a signal against its target, thesis section 3.6.3."""

from __future__ import annotations

import numpy as np


def mse(target: np.ndarray, actual: np.ndarray) -> float:
    """Mean squared error over time and channels, eq. (3.34)."""
    return float(np.mean((target - actual) ** 2))


def nrmse(target: np.ndarray, actual: np.ndarray) -> float:
    """Root mean squared error over the mean range of the target's channels, eq. (3.36).

    sqrt(mean over ticks and channels of (r - q)²) / mean over channels of (max r - min r).
    The horizon H is the given interval. Departure: the equation has one range per
    joint; the author's code uses one global range, see `metrics.signals.nrmse_global`.

    Args:
        target: r, (T, J).
        actual: q, (T, J).
    """
    return float(np.sqrt(mse(target, actual)) / mean_range(target))


def mean_range(target: np.ndarray) -> float:
    """Mean over channels of max minus min over time. target: (T, J)."""
    width = float(np.mean(np.ptp(target, axis=0)))
    return width if width > 0.0 else float("nan")
