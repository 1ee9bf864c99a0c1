# SPDX-License-Identifier: Apache-2.0
"""Whether what a model leaves of a gap is little enough to say that it explains the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import ndtri

from ..statistics import evidence

if TYPE_CHECKING:
    from .decide import Limits

KURTOSIS = 4.0  # variance of a squared noise value; 2 if it is normal
RARE = 0.01  # chance that noise alone is taken for more in any of the channels (taste)
SAME = 0.05  # relative change of an rms that is none


def explained(residuals: Sequence[np.ndarray], limits: Limits) -> np.ndarray:
    """Channels in which nothing is left but noise and what chance may add to it, (C,) bool.

    Args:
        residuals: Whitened residuals of a model, (T, C) per record; NaN where not measured.
        limits: Limits, of which `explained` is used.
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
    """In every channel of every record the model is near the floor or most of the rms closed.

    What was left alone is another matter: a small part of the whole gap may be there, if it is
    not loud by itself.

    Args:
        before: Whitened residuals of the model as it came, (T, C) per record.
        after: Whitened residuals of the selected model, (T, C) per record.
        limits: Conditions that say what is near, most and a small part.
        enough: Rms over all records [floors] up to which a channel counts as explained, (C,).
    """
    total = evidence.by_channel(after)
    left = [c for c, rms in enumerate(total) if enough is None or rms > enough[c]]
    aside = 0.0
    for old, new in zip(before, after, strict=True):
        noise = explained([new], limits)
        for column in left:
            rms = [evidence.rms([r[:, [column]]]) for r in (old, new)]
            if not noise[column] and evidence.closed(*rms) < limits.most:
                if abs(rms[1] - rms[0]) > SAME * rms[0] or total[column] > limits.alone:
                    return False
                aside += evidence.excess([new[:, [column]]])
    whole = sum(evidence.excess([r]) for r in before)
    return aside <= limits.aside * whole
