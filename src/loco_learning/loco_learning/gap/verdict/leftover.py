# SPDX-License-Identifier: Apache-2.0
"""Criteria for a residual that is small enough for the model to explain the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from ..statistics import evidence

if TYPE_CHECKING:
    from .decide import Limits

KURTOSIS = 4.0  # variance of a squared noise value; 2 for a normal law
RARE = 0.01  # probability of a false alarm by noise in any of the channels (taste)
SAME = 0.05  # relative change of an rms that is negligible


def explained(residuals: Sequence[np.ndarray], limits: Limits) -> np.ndarray:
    """Channels whose residual is noise, with an allowance for chance, (C,) bool.

    Args:
        residuals: Whitened residuals of a model, (T, C) per record; NaN where not measured.
        limits: Conditions, of which `explained` is used.
    """
    power = np.sum([np.nansum(np.square(r), axis=0) for r in residuals], axis=0)
    count = np.maximum(np.sum([np.isfinite(r).sum(0) for r in residuals], axis=0), 1)
    z = ndtri(1.0 - RARE / residuals[0].shape[1])
    return power / count <= limits.explained**2 * (1.0 + z * np.sqrt(KURTOSIS / count))


def adequate(
    before: Sequence[np.ndarray],
    after: Sequence[np.ndarray],
    limits: Limits,
    enough: np.ndarray | None = None,
) -> bool:
    """True if each channel of each record is near the floor, or most of its gap is closed.

    Channels that the model does not change may hold a small part of the whole gap, if none of them
    has a large residual.

    Args:
        before: Whitened residuals of the initial model, (T, C) per record.
        after: Whitened residuals of the selected model, (T, C) per record.
        limits: Conditions for near, most and small.
        enough: Rms over all records [floors] up to which a channel counts as explained, (C,).
    """
    total = evidence.by_channel(after)
    left = [c for c, rms in enumerate(total) if enough is None or rms > enough[c]]
    unexplained = 0.0
    for old, new in zip(before, after, strict=True):
        noise = explained([new], limits)
        for column in left:
            rms = [evidence.rms([r[:, [column]]]) for r in (old, new)]
            if not noise[column] and evidence.closed(*rms) < limits.most:
                if abs(rms[1] - rms[0]) > SAME * rms[0] or total[column] > limits.alone:
                    return False
                unexplained += evidence.excess([new[:, [column]]])
    initial = sum(evidence.excess([r]) for r in before)
    return unexplained <= limits.aside * initial
