# SPDX-License-Identifier: Apache-2.0
"""Weights of models on the same data, from their whitened residuals.

Residuals are whitened: predicted minus measured over the channel's floor, 1 = noise.
Three choices calibrate the weights, because the residual of a wrong model is systematic:

- The noise is the residual of the better of two models, in each channel: its scale (Student-t
  density, at least the floor) and its integrated autocorrelation tau are used for both. As
  long as no model explains the data, small differences are no proof.
- A sample counts 1 / tau (for an AR(1) residual tau = (1 + phi) / (1 - phi)). Predicting
  each residual from the previous one would instead remove the slow errors by which effects
  differ. A slow error of a fraction of the floor is tolerated (`TOLERANCE`).
- The weights are an average over the block bootstrap (BayesBag, Huggins and Miller 2023), not
  those of the one sample: two equally wrong models do not get odds of a million.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln, logsumexp, ndtri, stdtrit

NU = 5.0  # degrees of freedom of the density
LIMIT = 1e5  # [floors] largest whitened residual, and that of a model that diverged
MIN_VALUES = 8  # smallest number of independent values of a channel in all records
SURE_RATIO = 2.0  # rms of two models from which on few blocks are no reason for doubt
DRAWS = 1000  # bootstrap samples
N_BLOCKS = 16  # blocks of all records that are the same for all models
MOST_ODDS = 1e9
LEAST_FREEDOM = 4.0  # degrees of freedom of Student's law for intervals from few blocks
TOLERANCE = 0.3  # [floors] slow error that any model is allowed to have
BLOCK_IS_WON = 10.0  # odds at which the gain of a block is clipped when wins are counted
CAUTION = 1.25  # factor on the bootstrap's spread: blocks are few and not quite independent


@dataclass(frozen=True)
class Score:
    """Residual of a model with its statistics.

    Attributes:
        residuals: Whitened residual per record, (T, C), NaN = not measured.
        scale: Scale of the Student-t density per channel, (C,), at least 1.
        tau: Integrated autocorrelation per record and channel [samples], (R, C), at least 1.
        rms: Over all records and channels [floors].
        log_likelihood: Student-t, each sample counted 1 / tau [nat].
        n_eff: Effective number of independent values.
    """

    residuals: tuple[np.ndarray, ...]
    scale: np.ndarray
    tau: np.ndarray
    rms: float
    log_likelihood: float
    n_eff: float


def whiten(
    measured: Sequence[np.ndarray], predicted: Sequence[np.ndarray], floor: np.ndarray
) -> list[np.ndarray]:
    """Residual per record in floors, (T, C): NaN where nothing was measured.

    A prediction that is not finite (the model diverged) counts as `LIMIT`, it is not left out.

    Args:
        measured: (T, C) per record, NaN = not measured or not compared.
        predicted: (T, C) per record.
        floor: (C,) in the channels' units.
    """
    out = []
    for y, p in zip(measured, predicted, strict=True):
        with np.errstate(over="ignore", invalid="ignore"):
            z = (p - y) / floor
        z = np.where(np.isfinite(p), np.clip(z, -LIMIT, LIMIT), LIMIT)
        out.append(np.where(np.isfinite(y), z, np.nan))
    return out


def rms(residuals: Sequence[np.ndarray]) -> float:
    """Root mean square of all measured values [floors]."""
    energy = sum(float(np.nansum(np.square(r))) for r in residuals)
    count = sum(int(np.isfinite(r).sum()) for r in residuals)
    return math.sqrt(energy / count) if count else math.nan


def by_channel(residuals: Sequence[np.ndarray]) -> list[float]:
    """Root mean square of each channel [floors]; NaN where nothing was measured."""
    return [rms([r[:, [c]] for r in residuals]) for c in range(residuals[0].shape[1])]


def closed(before: float, after: float) -> float:
    """Share of the rms above noise that is closed, 1 = down to the floor, below 0 = worse.

    ``1 - sqrt((after² - 1) / (before² - 1))``; 0 when there was no gap to close.

    Args:
        before: Whitened rms of the initial model [floors].
        after: Whitened rms of the model with the effect [floors].
    """
    gap = before**2 - 1.0
    return 1.0 - math.sqrt(max(after**2 - 1.0, 0.0) / gap) if gap > 1e-9 else 0.0


def excess(residuals: Sequence[np.ndarray]) -> float:
    """Energy above the noise, clipped at 0 per channel so that quiet channels hide no loud one.

    Args:
        residuals: Whitened residual per record, (T, C), NaN = not measured.
    """
    power = _power(residuals) - np.sum([np.isfinite(r).sum(0) for r in residuals], axis=0)
    return float(np.maximum(power, 0.0).sum())


def closed_by(before: Sequence[np.ndarray], after: Sequence[np.ndarray]) -> float:
    """Share of the rms above noise of one model that another one closes; 0 if there was none.

    All shares of the gap are computed by this function, from the root of `excess`.

    Args:
        before: Whitened residual per record, (T, C), NaN = not measured.
        after: Whitened residual of the other model on the same data.
    """
    gap = excess(before)
    count = sum(int(np.isfinite(r).sum()) for r in before)
    return 1.0 - math.sqrt(excess(after) / gap) if gap > 1e-9 * count else 0.0


def smaller(one: Sequence[np.ndarray], other: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
    """Residuals of the better of two models in each channel of each record.

    Args:
        one: Whitened residual of a model per record, (T, C), NaN = not measured.
        other: Whitened residual of the other one, of the same shape; counts where `one` does.
    """
    pairs = [(a, np.where(np.isfinite(a), b, np.nan)) for a, b in zip(one, other, strict=True)]
    return tuple(
        np.where(np.nansum(np.square(a), axis=0) <= np.nansum(np.square(b), axis=0), a, b)
        for a, b in pairs
    )


def score(residuals: Sequence[np.ndarray]) -> Score:
    """Score of the residual of a model.

    Args:
        residuals: Whitened residual per record, (T, C), NaN = not measured.
    """
    records = tuple(np.asarray(r, dtype=float) for r in residuals)
    scale = _scale(np.concatenate(records))
    tau = np.array([[correlation_time(r[:, c]) for c in range(r.shape[1])] for r in records])
    ticks = _ticks(records, scale, tau)
    log_likelihood = float(sum(x.sum() for x in ticks))
    return Score(records, scale, tau, rms(records), log_likelihood, _count(records, tau))


def correlation_time(x: np.ndarray) -> float:
    """Integrated autocorrelation time about zero [measured samples], 1 for white noise.

    ``1 + 2 sum rho_k`` up to the first lag of five times the current sum (Sokal's window). Lags
    count measured samples and ignore rows between them, so the number of measured samples divided
    by this time is the number of independent samples. A residual with a non-zero mean is
    correlated over the whole record.

    Args:
        x: (T,), NaN = not measured; gaps are closed up.
    """
    y = x[np.isfinite(x)]
    if not np.any(y):
        return 1.0
    size = 1 << (2 * len(y) - 1).bit_length()
    covariance = np.fft.irfft(np.abs(np.fft.rfft(y, size)) ** 2, size)[: len(y)]
    rho = covariance / covariance[0] * len(y) / np.arange(len(y), 0, -1)
    sums = 2.0 * np.cumsum(rho) - 1.0
    stop = np.flatnonzero(np.arange(len(sums)) >= 5.0 * sums)
    return float(np.clip(sums[stop[0]] if len(stop) else sums.max(), 1.0, len(y)))


def odds(gain: float, std: float) -> float:
    """Expected odds for a gain in log-likelihood with a standard deviation [nat].

    Average of the posterior probability over a normal law of the gain, in MacKay's closed
    form: ``log odds = gain / sqrt(1 + pi spread² / 8)``.
    """
    power = gain / math.sqrt(1.0 + math.pi * std**2 / 8.0)
    return float(np.clip(math.exp(np.clip(power, -700.0, 700.0)), 1.0 / MOST_ODDS, MOST_ODDS))


def log_weights(
    scores: Sequence[Score],
    first: int,
    prices: Sequence[float],
    rng: np.random.Generator,
) -> np.ndarray:
    """Logarithm of the weight of each model over that of one of them [nat], (M,).

    Pseudo-BMA weights with the bootstrap (Yao and others 2018): of each bootstrap sample of blocks,
    which is the same for all models, the weights are those of the likelihoods; their mean counts.
    Between two equal models, one is better in every one of k independent pieces with probability
    ``2^-k``: the weights are limited accordingly. Noise of unknown size is ``ratio^k`` times less
    probable in a model with a residual larger by a ratio: from `SURE_RATIO` on, the larger counts.

    Args:
        scores: Residuals of models on the same data, M of them.
        first: Index of the model to which all are compared, preferably the best.
        prices: Penalty of each for parameters that the first lacks [nat], (M,).
        rng: Source of the resampling.
    """
    pairs = [_common(scores[first], s) for s in scores]
    sums, blocks, wide = (np.array(x) for x in zip(*pairs, strict=True))
    count, prices = sums.shape[1], np.asarray(prices, dtype=float)
    sign = np.where(sums.sum(1) > 0.0, 1.0, -1.0)
    ratio, total = np.array([
        _ratios(*((scores[first], s) if up > 0.0 else (s, scores[first])))
        for s, up in zip(scores, sign, strict=True)
    ]).T  # fmt: skip
    index = rng.choice(count, (DRAWS, count))
    quantile = stdtrit(max(count - 1.0, LEAST_FREEDOM), 0.975) / ndtri(0.975)
    low, high = np.minimum(-prices, 0.0), np.maximum(-prices, 0.0)
    results, bound = [], math.log(BLOCK_IS_WON)
    for x in (sums, np.clip(sums, -bound, bound)):
        gain = x.sum(1)
        drawn = x[:, index].sum(2) - gain[:, None]
        power = -(gain + prices)[:, None] + CAUTION * quantile * wide[:, None] * drawn  # (M, draws)
        logs = logsumexp(power - logsumexp(power, axis=0), axis=1)
        k = np.minimum(np.square(np.abs(x).sum(1)) / np.fmax(np.square(x).sum(1), 1e-300), blocks)
        logs = np.clip(logs - logs[first], low - k * np.log(ratio), high + k * np.log(ratio))
        by_size = np.where(total >= SURE_RATIO, -sign * k * np.log(total) - prices, 0.0)
        larger = (sign * by_size < 0.0) & (sign * by_size < sign * logs)
        results.append(np.where(larger, by_size, logs))
    sizes, wins = results
    return np.where((sizes * wins > 0.0) & (np.abs(wins) > np.abs(sizes)), wins, sizes)


def _common(a: Score, b: Score) -> tuple[np.ndarray, float, float]:
    """Gain of `a` over `b` in blocks that do not depend on `b`, the independent pieces, and width.

    The width is the factor on the spread of blocks that are too short to be independent.
    """
    ticks, times = _gains(a, b)
    length = max(sum(map(len, ticks)) / N_BLOCKS, 1.0)
    parts = [np.array_split(each, max(1, round(len(each) / length))) for each in ticks if len(each)]
    pairs = [(each, long) for each, long in zip(ticks, times, strict=True) if len(each)]
    blocks = sum(len(each) / long for each, long in pairs)
    wide = max(1.0, *(2.0 * long / length for _, long in pairs))
    return np.array([part.sum() for each in parts for part in each]), blocks, math.sqrt(wide)


def _ratios(first: Score, second: Score) -> tuple[float, float]:
    """Ratios of the rms of two models: the largest of a channel, at least 2, and of all data."""
    small, large = (np.fmax(by_channel(s.residuals), 1.0) for s in (first, second))
    total = max(second.rms, 1.0) / max(first.rms, 1.0)
    return max(2.0, float(np.max(large / small))), total


def _noise(scores: Sequence[Score]) -> tuple[np.ndarray, np.ndarray]:
    """Scale (C,) and correlation time (R, C) of the residual of the best model in each channel."""
    power = np.array([_power(s.residuals) for s in scores])
    scale = np.min([s.scale for s in scores], axis=0)
    best = power == power.min(0)  # (models, C)
    tau = np.max([s.tau * is_best for s, is_best in zip(scores, best, strict=True)], axis=0)
    return scale, tau


def _allowance(a: Score, b: Score) -> np.ndarray:
    """Correlation time of noise plus a tolerated error as slow as the difference, (R, C)."""
    times = [
        [correlation_time((x - y)[:, c]) for c in range(x.shape[1])]
        for x, y in zip(a.residuals, b.residuals, strict=True)
    ]
    return 1.0 + TOLERANCE**2 * (np.array(times) - 1.0)


def _power(records: Sequence[np.ndarray]) -> np.ndarray:
    """Sum of squares of each channel, (C,)."""
    return np.sum([np.nansum(np.square(r), axis=0) for r in records], axis=0)


def _count(records: Sequence[np.ndarray], tau: np.ndarray) -> float:
    """Effective number of independent values in all records."""
    return sum(float((np.isfinite(r).sum(0) / t).sum()) for r, t in zip(records, tau, strict=True))


def _gains(a: Score, b: Score) -> tuple[list[np.ndarray], list[float]]:
    """Gain of `a` over `b` in each measured row [nat], (T,) per record, and correlation times."""
    scale, tau = _noise((a, b))
    valid = [np.isfinite(r).any(1) for r in a.residuals]
    total = sum(int(rows.sum()) for rows in valid)
    counts = np.array([np.isfinite(r).sum(0) for r in a.residuals])  # (R, C)
    max_width = np.maximum(counts.sum(0) / MIN_VALUES, 1.0)
    wide = np.minimum(np.maximum(tau, _allowance(a, b)), max_width)
    pairs = zip(_ticks(a.residuals, scale, wide), _ticks(b.residuals, scale, wide), strict=True)
    ticks = [(x - y)[rows] for (x, y), rows in zip(pairs, valid, strict=True)]
    mean = sum(float(x.sum()) for x in ticks) / max(total, 1)
    times = []
    for each, taus, count in zip(ticks, tau, counts, strict=True):
        rows = taus * len(each) / np.maximum(count, 1)
        times.append(max(correlation_time(each - mean), float(np.median(rows))))
    return ticks, times


def _ticks(records: Sequence[np.ndarray], scale: np.ndarray, tau: np.ndarray) -> list[np.ndarray]:
    """Log density of each sample divided by its tau, summed over channels, (T,) per record."""
    constant = gammaln((NU + 1) / 2) - gammaln(NU / 2) - 0.5 * math.log(NU * math.pi)
    out = []
    for r, each in zip(records, tau, strict=True):
        logs = constant - np.log(scale) - (NU + 1) / 2 * np.log1p((r / scale) ** 2 / NU)
        out.append(np.nansum(logs / each, axis=1))
    return out


def _scale(r: np.ndarray) -> np.ndarray:
    """Scale of the Student-t law that fits each channel best, (C,), at least 1."""
    square = np.square(r)
    counts = np.maximum(np.isfinite(r).sum(0), 1)
    s2 = np.maximum(np.nansum(square, axis=0) / counts, 1.0)
    for _ in range(30):  # expectation-maximisation
        weight, before = (NU + 1) / (NU + square / s2), s2
        s2 = np.maximum(np.nansum(weight * square, axis=0) / counts, 1.0)
        if np.array_equal(s2, before):
            break
    return np.sqrt(s2)
