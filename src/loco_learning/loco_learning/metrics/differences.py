# SPDX-License-Identifier: Apache-2.0
"""Differences of two runs in their metrics: statistically significant, and large enough to matter.

A phase is divided into blocks of whole strides, and each metric is computed for each block of both
runs. If both runs have the same target, blocks of the same ticks are paired, which cancels the
influence of the target. A difference is *lasting* if the confidence interval of the mean over the
blocks excludes zero, and *passing* if single blocks are outliers, as after a push.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import bootstrap, t

from ..runs.log import Log
from .quantities import period
from .registry import METRICS, SHORTEST, Metric

MIN_BLOCKS = 6  # smallest number of blocks of a phase (taste: Student's t is near normal)
CHANCE = 0.01  # probability of any false difference in a whole table (convention)
RESAMPLES = 999  # bootstrap samples (Davison and Hinkley 1997)
NORMAL = 1.4826  # deviation of a normal law over the median of its absolute values (theory)
LASTING, PASSING = "lasting", "passing"


@dataclass(frozen=True)
class Difference:
    """One metric of a phase, compared between the first and another run.

    Attributes:
        metric: Name of the metric.
        first: Mean over the blocks of the first run.
        other: Mean over the blocks of the other run.
        low: Lower end of the interval of the mean difference, other minus first; NaN if there
            are too few blocks.
        high: Upper end of the interval.
        size: Smallest difference that matters.
        kind: `LASTING`, `PASSING` or empty.
        largest: Difference of the most outlying block; NaN if blocks are not paired.
        at: Start of that block in the phase [s].
    """

    metric: str
    first: float
    other: float
    low: float
    high: float
    size: float
    kind: str
    largest: float
    at: float

    @property
    def judged(self) -> bool:
        """True if there were enough blocks."""
        return math.isfinite(self.low)


@dataclass(frozen=True)
class Window:
    """Blocks of a phase in which two runs are compared.

    Attributes:
        phase: Name of the phase.
        ticks: Length of the phase in the shorter run [ticks].
        length: Length of a block [ticks].
        count: Number of blocks.
        dt: Control period [s].
        paired: Whether both runs have the same target at the same tick.
    """

    phase: str
    ticks: int
    length: int
    count: int
    dt: float
    paired: bool

    @property
    def enough(self) -> bool:
        """True if there are enough blocks."""
        return self.count >= MIN_BLOCKS

    @property
    def needed(self) -> float:
        """Length of a phase with enough blocks [s]."""
        return MIN_BLOCKS * self.length * self.dt


def window(first: Log, other: Log, phase: str) -> Window:
    """Blocks of a phase, up to the shorter of both runs."""
    starts = [log.phases()[phase] for log in (first, other)]
    ticks = min(s.stop - s.start for s in starts)
    stride = min(period(first.cut(starts[0])), ticks)
    length = stride * max(1, math.ceil(SHORTEST / (stride * first.dt) - 1e-9))
    one, two = (
        log.target[s.start : s.start + ticks] for log, s in zip((first, other), starts, strict=True)
    )
    paired = np.array_equal(one, two, equal_nan=True)
    return Window(phase, ticks, length, ticks // length, first.dt, paired)


def differences(first: Log, other: Log, phase: str, tests: int = 1) -> list[Difference]:
    """Differences in all metrics of a phase that both runs have.

    Args:
        first: Reference.
        other: Run to compare with it.
        phase: Name of a phase of both.
        tests: Number of tables that share the error probability `CHANCE`.
    """
    blocks = window(first, other, phase)
    metrics = [m for m in METRICS.values() if m.suits(first) and m.suits(other)]
    rows = [(m.name, *(_blocks(m, log, blocks) for log in (first, other))) for m in metrics]
    rows = [row for row in rows if np.isfinite(row[1]).any() and np.isfinite(row[2]).any()]
    chance = CHANCE / (tests * max(1, len(rows)))
    return [_difference(blocks, *row, chance) for row in rows]


def _blocks(metric: Metric, log: Log, blocks: Window) -> np.ndarray:
    """Value of a metric in each block, (N,)."""
    starts = log.phases()[blocks.phase].start + blocks.length * np.arange(blocks.count)
    return np.array([metric(log, slice(s, s + blocks.length)) for s in starts])


def _difference(
    blocks: Window, name: str, one: np.ndarray, two: np.ndarray, chance: float
) -> Difference:
    """Difference of one metric from its blocks, with a given error probability."""
    size, at, largest, kind = METRICS[name].notable(float(np.nanmean(one))), math.nan, math.nan, ""
    low = high = math.nan
    if blocks.paired:
        valid = np.isfinite(one) & np.isfinite(two)
        pairs = (two - one)[valid]
        samples: tuple[np.ndarray, ...] = (pairs,)
    else:
        samples = one[np.isfinite(one)], two[np.isfinite(two)]
    if math.isfinite(size) and min(map(len, samples)) >= MIN_BLOCKS:
        low, high = interval(samples, chance)
        middle = 0.5 * (low + high)
        if low * high > 0.0 and abs(middle) > size:
            kind = LASTING
        if blocks.paired:
            index = int(np.argmax(np.abs(pairs)))
            largest = float(pairs[index])
            at = float(np.flatnonzero(valid)[index] * blocks.length * blocks.dt)
            if not kind and abs(largest) > max(size, outstanding(pairs, chance)):
                kind = PASSING
    means = (float(np.nanmean(values)) for values in (one, two))
    return Difference(name, *means, low, high, size, kind, largest, at)


def interval(samples: tuple[np.ndarray, ...], chance: float) -> tuple[float, float]:
    """Confidence interval of the mean of pairs, or of the second mean minus the first.

    A bootstrap underestimates the error for few or correlated blocks: Student's law and the
    correlation of neighbours widen its standard error.

    Args:
        samples: Differences of pairs, (N,), or the values of both runs.
        chance: Probability that the interval excludes the true value.
    """
    paired, n_min = len(samples) == 1, min(map(len, samples))
    drawn = bootstrap(
        samples, _mean if paired else _mean_difference, n_resamples=RESAMPLES, vectorized=True,
        method="percentile", rng=np.random.default_rng(0),
    )  # fmt: skip
    middle = float((_mean if paired else _mean_difference)(*samples))
    wide = float(t.ppf(1.0 - 0.5 * chance, n_min - 1) * math.sqrt(n_min / (n_min - 1)))
    half_width = wide * float(drawn.standard_error) * max(map(resemblance, samples))
    return middle - half_width, middle + half_width


def resemblance(values: np.ndarray) -> float:
    """Factor by which correlation of neighbours widens the error of a mean, at least 1.

    The correlation is corrected for its bias with few values (Kendall 1954).
    """
    centred, count = values - np.mean(values), len(values)
    power = float(centred @ centred)
    if not power > 0.0:
        return 1.0
    rho = float(centred[1:] @ centred[:-1]) / power
    rho = min(max(rho + (1.0 + 4.0 * rho) / count, 0.0), 0.9)
    return math.sqrt((1.0 + rho) / (1.0 - rho))


def _mean(values: np.ndarray, axis: int = -1) -> np.ndarray:
    return np.mean(values, axis=axis)


def _mean_difference(one: np.ndarray, two: np.ndarray, axis: int = -1) -> np.ndarray:
    return np.mean(two, axis=axis) - np.mean(one, axis=axis)


def outstanding(pairs: np.ndarray, chance: float) -> float:
    """Smallest absolute difference of an outlying block, from the median of all blocks.

    Args:
        pairs: Difference of each block, (N,).
        chance: Probability that any block of noise exceeds it.
    """
    scale = NORMAL * float(np.median(np.abs(pairs)))
    return scale * float(t.ppf(1.0 - 0.5 * chance / len(pairs), len(pairs) - 1))


def shared(logs: Mapping[str, Log]) -> list[str]:
    """Phases that all runs reached, in order."""
    first, *rest = logs.values()
    return [name for name in first.phases() if all(name in log.phases() for log in rest)]
