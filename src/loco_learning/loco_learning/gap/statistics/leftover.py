# SPDX-License-Identifier: Apache-2.0
"""Criteria for a residual that is small enough for the model to explain the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from loco_control.params import Params, parameter

from . import evidence

KURTOSIS = 4.0  # variance of a squared noise value; 2 for a normal law


@dataclass(frozen=True)
class Limits(Params):
    """When a model explains the data: the same numbers decide everywhere.

    They decide whether there is a gap, whether a search starts and ends, which effects are visible,
    and whether more is missing.
    """

    # Battery: residual of a true model from noise, jitter of stamps and the other integrator.
    explained: float = parameter(
        1.25, "rms of a channel [floors], beyond chance, up to which a model explains it", low=1.0
    )
    # Shares of the gap are those of the rms above noise (`evidence.closed_by`). No model of real
    # hardware reduces a large gap to noise (taste).
    most: float = parameter(
        0.9, "share of a channel's gap in a record whose closing is as good as explaining it",
        high=1.0,
    )  # fmt: skip
    least: float = parameter(
        0.163, "share of the gap below which a model closes almost nothing: 30 % of its energy "
        "(taste)", low=0.0, high=1.0
    )  # fmt: skip
    rare: float = parameter(
        0.01, "probability of a false alarm by noise in any of the channels (taste)", low=0.0,
        high=0.5,
    )  # fmt: skip


LIMITS = Limits()


def explained(residuals: Sequence[np.ndarray]) -> np.ndarray:
    """Channels whose residual is noise, with an allowance for chance, (C,) bool.

    Args:
        residuals: Whitened residuals of a model, (T, C) per record; NaN where not measured.
    """
    power = np.sum([np.nansum(np.square(r), axis=0) for r in residuals], axis=0)
    count = np.sum([np.isfinite(r).sum(0) for r in residuals], axis=0)
    return is_noise(power, count)


def is_noise(power: np.ndarray, count: np.ndarray) -> np.ndarray:
    """As `explained`, from the sum of squares [floors²] and number of values of channels, (C,)."""
    count, z = np.maximum(count, 1), ndtri(1.0 - LIMITS.rare / len(power))
    return power / count <= LIMITS.explained**2 * (1.0 + z * np.sqrt(KURTOSIS / count))


def has_gap(residuals: Sequence[np.ndarray]) -> bool:
    """True if some channel's whitened residual, (T, C) per record, exceeds its floor and chance."""
    return not explained(residuals).all()


def adequate(
    before: Sequence[np.ndarray],
    after: Sequence[np.ndarray],
    levels: np.ndarray | None = None,
) -> bool:
    """True if each channel of each record is near the floor, or most of its gap is closed.

    Args:
        before: Whitened residuals of the initial model, (T, C) per record.
        after: Whitened residuals of the selected model, (T, C) per record.
        levels: Rms over all records [floors] up to which a channel counts as explained, (C,).
    """
    total = evidence.by_channel(after)
    left = [c for c, rms in enumerate(total) if levels is None or rms > levels[c]]
    for old, new in zip(before, after, strict=True):
        noise = explained([new])
        for column in left:
            rms = [evidence.rms([r[:, [column]]]) for r in (old, new)]
            if not noise[column] and evidence.closed(*rms) < LIMITS.most:
                return False
    return True
