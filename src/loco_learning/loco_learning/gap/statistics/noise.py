# SPDX-License-Identifier: Apache-2.0
"""White noise floor of each measured channel, from the measurement alone.

Differences of order k remove what a polynomial of degree k - 1 describes over k + 1
samples and keep white noise, whose variance they multiply by ``binomial(2k, k)``. The
smallest estimate over several orders is the one least affected by motion.

For readings that are multiples of a step, a median of differences is a multiple of the step
too, and as much as a third off. Uniform dither as wide as the step makes the differences
continuous; its known variance is subtracted again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

DIFFERENCE_ORDERS = (2, 3, 4, 5, 6)
FEWEST = 8  # smallest number of differences of an order
SEED = 7_290_418_553  # seed of dither; simulated noise has small seeds, so both are independent
DITHERS = 16  # draws of dither on each record: a single one doubles the spread of the estimate
TO_DEVIATION = 1.4826  # standard deviation of a normal law over its median absolute value
RELATIVE = 1e-4  # smallest floor, over the channel's own standard deviation
# Smallest share of a floor that is left without other errors of the readings (taste).
MIN_SHARE = 0.5
EFFORT = 0.02  # the same for a torque: on robots it is an estimate from current or pressure
BUSIEST_SHARE = 1e-3  # smallest floor of a torque, over the largest deviation of any torque


def floor(
    measured: Sequence[np.ndarray],
    resolution: np.ndarray | float = 0.0,
    signals: Sequence[str] = (),
) -> np.ndarray:
    """Standard deviation of the white noise of each channel, in the channel's unit.

    Args:
        measured: One (T, C) array per record; NaN where nothing was measured.
        resolution: Quantisation step per channel, (C,) or one for all; 0 if none is detected.
        signals: Signal of each channel, (C,), for `minimum_floor`; by default none is a torque.

    Returns:
        (C,) floors, all above 0: the largest of noise, step / sqrt(12) and `minimum_floor`.
    """
    columns = [[record[:, c] for record in measured] for c in range(measured[0].shape[1])]
    rounding = np.broadcast_to(np.asarray(resolution, dtype=float), len(columns))
    noise = np.array([white(c, step) for c, step in zip(columns, rounding, strict=True)])
    steps = rounding / math.sqrt(12.0)
    deviations = np.array([_deviation(column) for column in columns])
    return np.maximum(np.maximum(noise, steps), minimum_floor(deviations, signals))


def minimum_floor(deviations: np.ndarray, signals: Sequence[str] = ()) -> np.ndarray:
    """Smallest floor of each channel, so that noise-free data do not need a perfect model, (C,).

    It is a share of the channel's standard deviation. The torque sensors of a robot are alike, so
    that none has a floor below a share of the largest torque deviation.

    Args:
        deviations: Standard deviation of each channel, (C,).
        signals: Signal of each channel, (C,); by default none is a torque.
    """
    torques = np.array([signal == "tau" for signal in signals or [""] * len(deviations)])
    relative = np.where(torques, EFFORT, RELATIVE) * deviations
    common = BUSIEST_SHARE * np.max(deviations, where=torques, initial=0.0) * torques
    return np.maximum(np.maximum(relative, common), np.finfo(float).tiny ** 0.5)


def white(
    columns: Sequence[np.ndarray],
    step: float = 0.0,
    orders: Sequence[int] = DIFFERENCE_ORDERS,
    fewest: int = FEWEST,
) -> float:
    """Standard deviation of the white noise in a channel's records; 0 with too few samples.

    Args:
        columns: (T,) per record, NaN where nothing was measured; samples are taken as
            evenly spaced between gaps.
        step: Quantisation step of the readings; the result includes quantisation noise.
        orders: Orders of differences; the smallest estimate is returned.
        fewest: Smallest number of differences of an order.
    """
    rows = tuple(np.asarray(column, dtype=float).tobytes() for column in columns)
    return _lowest(rows, float(step), tuple(orders), fewest)


@lru_cache(maxsize=128)
def _lowest(columns: tuple[bytes, ...], step: float, orders: tuple[int, ...], fewest: int) -> float:
    """`white` of columns as bytes: trials of a set-up change one joint of many."""
    dithered = [_dithered(np.frombuffer(column), step) for column in columns]
    estimates = []
    for order in orders:
        values = [_differences(column, order) for column in dithered]
        if sum(map(len, values)) >= fewest:
            estimates.append(_white(np.concatenate(values).ravel(), order, step))
    return min(estimates, default=0.0)


def _white(values: np.ndarray, order: int, step: float) -> float:
    """Standard deviation of noise from differences of an order, without that of dither."""
    variance = (TO_DEVIATION * float(np.median(np.abs(values)))) ** 2 / math.comb(2 * order, order)
    return math.sqrt(max(0.0, variance - step**2 / 12.0))


def _dithered(column: np.ndarray, step: float) -> np.ndarray:
    """A record plus each draw of dither, (T, draws); unchanged, (T, 1), without a step."""
    if step == 0.0:
        return column[:, None]
    # The same draws for each record: the estimate does not depend on the order of records.
    dither = np.random.default_rng(SEED).uniform(-0.5, 0.5, (len(column), DITHERS))
    return column[:, None] + step * dither


def without(
    sensors: np.ndarray, errors: Sequence[np.ndarray], measured: Sequence[np.ndarray]
) -> np.ndarray:
    """Floors of the sensors alone, (C,), where medians of differences contain other white errors.

    Args:
        sensors: Floors as estimated from the readings, (C,).
        errors: Standard deviation of the other errors of each reading, (T, C) per record.
        measured: The readings, (T, C) per record; NaN where nothing was measured.
    """
    pairs = zip(errors, measured, strict=True)
    every = np.concatenate([np.where(np.isfinite(m), np.square(e), np.nan) for e, m in pairs])
    is_measured = np.isfinite(every).any(axis=0)
    typical = np.zeros(len(sensors))
    typical[is_measured] = np.nanmedian(every[:, is_measured], axis=0)
    return np.sqrt(np.maximum(np.square(sensors) - typical, np.square(MIN_SHARE * sensors)))


def total(noise: np.ndarray, numeric: np.ndarray | float = 0.0) -> np.ndarray:
    """Total floor: noise of the sensors and error of the model's integrator, (C,)."""
    return np.sqrt(np.square(noise) + np.square(numeric))


def _differences(columns: np.ndarray, order: int) -> np.ndarray:
    """Differences of an order within a (T, k) record, none across a gap: (D, k)."""
    index = np.flatnonzero(np.isfinite(columns[:, 0]))
    if len(index) <= order:
        return np.empty((0, columns.shape[1]))
    values = np.diff(columns[index], order, axis=0)
    stride = np.median(np.diff(index))  # above 1 if sampled more slowly than the axis
    return values[index[order:] - index[:-order] <= 1.5 * stride * order]


def _deviation(columns: Sequence[np.ndarray]) -> float:
    values = np.concatenate(columns)
    values = values[np.isfinite(values)]
    return float(values.std()) if len(values) else 0.0
