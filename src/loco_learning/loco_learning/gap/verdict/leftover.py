# SPDX-License-Identifier: Apache-2.0
"""Whether what a model leaves of a gap is little enough to say that it explains the data."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..statistics import evidence

if TYPE_CHECKING:
    from .decide import Limits

SAME = 0.05  # relative change of an rms that is none


def adequate(
    before: Sequence[np.ndarray],
    after: Sequence[np.ndarray],
    limits: Limits,
    enough: np.ndarray | None = None,
) -> bool:
    """In every channel of every record the model is near the floor or most of the gap closed.

    What was left alone is another matter: a small part of the whole gap may be there.

    Args:
        before: Whitened residuals of the model as it came, (T, C) per record.
        after: Whitened residuals of the selected model, (T, C) per record.
        limits: Conditions that say what is near, most and a small part.
        enough: Rms over all records [floors] up to which a channel counts as explained, (C,).
    """
    total = [evidence.rms([r[:, [c]] for r in after]) for c in range(after[0].shape[1])]
    left = [c for c, rms in enumerate(total) if enough is None or rms > enough[c]]
    aside = 0.0
    for old, new in zip(before, after, strict=True):
        for column in left:
            rms = [evidence.rms([r[:, [column]]]) for r in (old, new)]
            if rms[1] > limits.adequate_rms and evidence.closed(*rms) < limits.adequate_closed:
                if abs(rms[1] - rms[0]) > SAME * rms[0]:
                    return False
                aside += evidence.excess([new[:, [column]]])
    whole = sum(evidence.excess([r]) for r in before)
    return aside <= limits.aside * whole
