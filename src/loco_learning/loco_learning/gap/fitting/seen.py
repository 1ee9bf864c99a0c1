# SPDX-License-Identifier: Apache-2.0
"""Number of parameters of a fitted model that influence the data: only these are penalised.

The offset of a centre of mass along the axis of its hinge moves nothing. An effect with such a
parameter is no more flexible than one without it, and is penalised no more.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..prediction.case import Case
from ..statistics import identify
from .fit import Fitted, Setting, refine

MOVED = 0.05  # simulated part of a typical change; the response is scaled up linearly
# Response to a typical change of a parameter, in standard deviations of the noise. Theory: below
# it, the data constrain the parameter less than its prior does.
NOTICED = 1.0


def finalize(case: Case, model: Fitted, setting: Setting, close: bool = True) -> Fitted:
    """Polish a model that is `close` to the best and count the parameters that the data can see."""
    refined = refine(case, model, setting) if close else model
    return replace(refined, seen=observable_count(case, refined))


def observable_count(case: Case, model: Fitted) -> int:
    """Number of parameters that each alone change the measured signals noticeably.

    Args:
        case: Model and data.
        model: Fitted model.
    """
    case = case.kept()  # compensation by values of the robot is not considered here
    reference = identify.pack(case.whitened(model.specs, model.settled, coarse=True))
    weight = np.sqrt(identify.weights(model.score))
    count = 0
    for i, (hypothesis, x) in enumerate(model.parts):
        for j, c in enumerate(hypothesis.coordinates):
            typical = 1.0 if c.logarithmic else max(1.0, abs(x[j]))
            step = MOVED * typical
            step = step if c.clipped(x[j] + step) == x[j] + step else -step
            specs = model.moved(i, [v + step * (k == j) for k, v in enumerate(x)])
            shifted = identify.pack(case.whitened(specs, model.settled, coarse=True))
            change = np.clip(np.nan_to_num(shifted - reference), -case.cap, case.cap) * weight
            count += float(np.linalg.norm(change)) / MOVED >= NOTICED
    return count
