# SPDX-License-Identifier: Apache-2.0
"""White noise floor of each measured channel, from the measurement alone.

Differences of order k remove what a polynomial of degree k - 1 describes over k + 1
samples and keep white noise, whose variance they multiply by ``binomial(2k, k)``. The
smallest estimate over several orders is the one least disturbed by motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

ORDERS = (2, 3, 4, 5, 6)
TO_DEVIATION = 1.4826  # standard deviation of a normal law over its median absolute value
RELATIVE = 1e-4  # of a channel's own deviation: no floor is set below it
EFFORT = 0.02  # the same of a torque: on robots it is an estimate from current or pressure


def floor(
    measured: Sequence[np.ndarray],
    resolution: np.ndarray | float = 0.0,
    relative: np.ndarray | float = RELATIVE,
) -> np.ndarray:
    """Standard deviation of the white noise of each channel, in the channel's unit.

    Args:
        measured: One (T, C) array per record; NaN where nothing was measured.
        resolution: Quantisation step per channel, (C,) or one for all; 0 where none is seen.
        relative: Share of a channel's deviation below which no floor is set (`shares`), (C,)
            or one for all, so that a record without noise does not ask for a perfect model.

    Returns:
        (C,) floors, all above 0: the largest of noise, step / sqrt(12) and the share.
    """
    channels = measured[0].shape[1]
    steps = np.broadcast_to(np.asarray(resolution, dtype=float), (channels,))
    share = np.broadcast_to(np.asarray(relative, dtype=float), (channels,))
    found = np.empty(channels)
    for c in range(channels):
        columns = [record[:, c] for record in measured]
        spread = _deviation(columns)
        least = max(share[c] * spread, np.finfo(float).tiny ** 0.5)
        found[c] = max(white(columns), steps[c] / math.sqrt(12.0), least)
    return found


def shares(signals: Sequence[str]) -> np.ndarray:
    """Least floor of each channel over its deviation, by its signal, (C,)."""
    return np.array([EFFORT if signal == "tau" else RELATIVE for signal in signals])


def white(columns: Sequence[np.ndarray]) -> float:
    """Deviation of the white noise in one channel's records, 0 when too few samples.

    Args:
        columns: (T,) per record, NaN where nothing was measured; samples are taken as
            evenly spaced between gaps.
    """
    estimates = []
    for order in ORDERS:
        values = np.concatenate([_differences(column, order) for column in columns])
        if len(values) >= 8:
            gain = math.sqrt(math.comb(2 * order, order))
            estimates.append(TO_DEVIATION * float(np.median(np.abs(values))) / gain)
    return min(estimates, default=0.0)


def total(noise: np.ndarray, numeric: np.ndarray | float = 0.0) -> np.ndarray:
    """Floor used everywhere: noise of the sensors and error of the model's integrator, (C,)."""
    return np.sqrt(np.square(noise) + np.square(numeric))


def _differences(column: np.ndarray, order: int) -> np.ndarray:
    """Differences of an order over neighbouring samples, none across a gap."""
    index = np.flatnonzero(np.isfinite(column))
    if len(index) <= order:
        return np.empty(0)
    values = np.diff(column[index], order)
    stride = np.median(np.diff(index))  # more than 1 when measured more rarely than the axis
    return values[index[order:] - index[:-order] <= 1.5 * stride * order]


def _deviation(columns: Sequence[np.ndarray]) -> float:
    values = np.concatenate(columns)
    values = values[np.isfinite(values)]
    return float(values.std()) if len(values) else 0.0
