# SPDX-License-Identifier: Apache-2.0
"""Last steps of a fit: effects and values of the robot together, by simulation.

Fits follow values of the robot along straight lines. Where an effect and these values nearly
cancel, as a payload and the mass of its link do, the curvature of these lines moves the size of the
effect by many of its standard errors. Gauss-Newton steps with derivatives at the fit undo this.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..fitting.fit import Fitted, specs_of
from ..prediction.case import Case
from ..statistics import evidence, identify
from ..statistics.solve import MIN_GAIN
from .sensitivity import columns, is_smooth

STEPS = 8  # most steps, each with derivatives of its own (taste)
SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # tried shares of a step


def gauss_newton(case: Case, model: Fitted) -> Fitted:
    """The model at a lower cost of the fitted rows; itself if no step leads lower.

    Args:
        case: Model and data.
        model: Fitted model.
    """
    if model.overrides or not (model.parts and model.loose and case.bends):
        return model
    if not is_smooth(case, model):
        return model
    case = case.corrected(model.specs, model.overrides).relined(model.specs)
    used = [np.isfinite(r) for r in case.masked(model.whole, range(len(model.whole)), held=False)]
    weight = np.where(identify.pack(used), identify.weights(model.score), 0.0)

    def cost(candidate: Fitted) -> float:
        return 0.5 * float(weight @ np.square(residual(candidate))) + candidate.pull

    def residual(candidate: Fitted) -> np.ndarray:
        return np.nan_to_num(identify.pack(candidate.whole))

    best = None
    for _ in range(STEPS):
        effects, (values, at) = columns(case, best or model)
        both = np.nan_to_num(np.hstack([effects, values]))
        z = np.r_[_coordinates(best or model), at]
        prior = np.r_[np.zeros(len(z) - len(at)), np.ones(len(at))]
        best = best or _moved(case, model, z)  # as simulated, not as a straight line promises
        covariance = identify.inverse(both.T @ (weight[:, None] * both) + np.diag(prior))
        slope = both.T @ (weight * residual(best)) + prior * z
        step = -covariance @ slope
        if -0.5 * slope @ step < MIN_GAIN:
            return best
        for share in SHARES:
            ahead = z + share * step
            one = _moved(case, model, ahead)
            curved = residual(one) - residual(best) - both @ (share * step)
            other = _moved(case, model, ahead - covariance @ (both.T @ (weight * curved)))
            lower = min(one, other, key=cost)
            if cost(lower) < cost(best) - 0.5 * MIN_GAIN:
                break
        else:
            return best
        best = lower
    return best


def _coordinates(model: Fitted) -> np.ndarray:
    """Coordinates of all effects, (P,)."""
    return np.concatenate([x for _, x in model.parts])


def _moved(case: Case, model: Fitted, z: np.ndarray) -> Fitted:
    """The model at coordinates, then deviations of values of the robot, simulated."""
    left, parts = iter(z), []
    for hypothesis, _ in model.parts:
        moved = [c.clipped(float(next(left))) for c in hypothesis.coordinates]
        parts.append((hypothesis, tuple(moved)))
    at = np.clip([*left], *case.loose.reach)
    residuals, values, pull, starts = case.simulated(specs_of(parts), model.overrides, at)
    rms = evidence.rms(case.masked(residuals, range(len(residuals)), held=False))
    return replace(
        model, parts=tuple(parts), fit_rms=rms, held=case.judged(residuals), whole=tuple(residuals),
        loose=values, pull=pull, starts=starts,
    )  # fmt: skip
