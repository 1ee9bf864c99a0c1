# SPDX-License-Identifier: Apache-2.0
"""Sensitivities of a fitted model to its parameters, and the resulting intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case
from ..statistics import identify, profile, robust
from . import doubt
from .estimates import Estimate

STRENGTH_STEP, LOG_STEP = (
    0.05,
    0.1,
)  # finite difference of a strength, and of the logarithm of a shape or nominal value
LINEAR_SHARE = 0.3  # half interval over the size above which derivatives are checked (taste)
NORMAL = 1.96  # standard errors of a 95 % interval
MIN_PROBABILITY = 1e-3  # probability below which parts of the data disagree on a value


def sensitivities(
    case: Case, model: Fitted, wider: bool = False
) -> tuple[dict[str, tuple[Estimate, ...]], identify.Identifiability | None]:
    """Parameters of a model with intervals, and their identifiability.

    Args:
        case: Model and data.
        model: Fitted model.
        wider: Whether intervals include the uncertainty of masses, inertias and drives.

    Returns:
        Estimates by key of the hypothesis, and the analysis of all coordinates; None if
        nothing was fitted.
    """
    names, moves = _moves(model)
    if not moves:
        return {}, None
    base_case, refitted = case.kept(), model.settled
    reference = base_case.whitened(model.specs, refitted)
    moves = [(specs, {**refitted, **overrides}, step) for specs, overrides, step in moves]
    matrix = np.stack([_column(base_case, reference, *move) for move in moves], axis=1)
    weight = identify.weights(model.score)
    analysis = identify.analyse(matrix, names, list(model.overrides), weight)
    uncertain = doubt.columns(case, model) if wider else doubt.none(len(matrix))
    groups = robust.clusters(model.whole, case.forward.begun())
    widths, deviation = _half_widths(matrix, model, weight, uncertain, groups)
    sizes, with_shapes = ~_shapes(model, len(names)), np.full(len(names), np.nan)
    with_shapes[sizes], _ = _half_widths(matrix[:, sizes], model, weight, uncertain, groups)
    result, start = {}, 0
    for i, (hypothesis, x) in enumerate(model.parts):
        rows = slice(start, start + len(x))
        each = widths[rows], deviation[rows], with_shapes[rows]
        single = analysis.errors_alone[rows]
        limits = _profiled(base_case, model, i, reference, widths[rows], single) if wider else {}
        result[hypothesis.key] = estimates(hypothesis, x, *each, limits)
        start += len(x)
    return result, analysis


def _half_widths(
    matrix: np.ndarray,
    model: Fitted,
    weight: np.ndarray,
    uncertain_columns: tuple[np.ndarray, np.ndarray],
    groups: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Half of each parameter's 95 % interval, and its spread between parts of the data."""
    left = identify.pack(model.whole)
    steady = identify.stability(matrix, left, halves(model.whole), weight)
    errors = identify.standard_errors(matrix, weight)
    errors = np.sqrt(errors**2 + steady.spread**2 / len(steady.shifts))
    columns, at = uncertain_columns
    widths = robust.half_widths(matrix, columns, left, groups, weight, at)
    deviation = np.where(steady.probability < MIN_PROBABILITY, steady.spread, 0.0)
    return np.maximum(widths, NORMAL * errors), deviation


def estimates(
    hypothesis: Hypothesis,
    x: Sequence[float],
    widths: np.ndarray,
    scatter: np.ndarray,
    with_shapes: np.ndarray,
    bounds: Mapping[int, tuple[float, float]] | None = None,
) -> tuple[Estimate, ...]:
    """Parameters of one effect with 95 % intervals, in their units.

    Args:
        hypothesis: Fitted hypothesis.
        x: Coordinates of the hypothesis.
        widths: Half of their 95 % intervals.
        scatter: Their deviation between parts of the data.
        with_shapes: Half of the intervals with all shapes fixed.
        bounds: Both ends of the intervals of those coordinates that were profiled.
    """
    passive = EFFECTS[hypothesis.effect].identity.passive
    result = []
    columns = hypothesis.coordinates, x, widths, scatter, with_shapes
    for j, (c, at, half_width, wide, deviation) in enumerate(zip(*columns, strict=True)):
        both = (bounds or {}).get(j, (at - half_width, at + half_width))
        if both[0] > 0.0 or both[1] < 0.0:  # a profile that excludes 0 overrides derivatives
            deviation = min(deviation, abs(at) - 1e-12) if j in (bounds or {}) else deviation
        both = sorted(c.unbounded(end) if np.isfinite(end) else end for end in both)
        sign = 1 if passive and c.strength and c.one_sided else 0
        size = (c.origin, sign, *abs(c.size * np.r_[wide, deviation])) if c.strength else (None,)
        result.append(Estimate(c.label, c.value(at), *both, c.unit, c.low, c.high, *size))
    return tuple(result)


def _profiled(
    case: Case,
    model: Fitted,
    index: int,
    ref: Sequence[np.ndarray],
    widths: np.ndarray,
    single_errors: np.ndarray,
) -> dict[int, tuple[float, float]]:
    """Profiled intervals of an effect's strengths for which derivatives may be inaccurate.

    Args:
        case: Model and data, with values of the robot fixed.
        model: Fitted model.
        index: Index of the effect.
        ref: Residuals of the model, (T, C) each.
        widths: Half of the intervals from derivatives.
        single_errors: Standard errors if all other parameters were known.
    """
    hypothesis, x = model.parts[index]
    smooth = EFFECTS[hypothesis.effect].identity.smooth
    weight, left = identify.weights(model.score), np.nan_to_num(identify.pack(ref))
    result = {}
    for j in hypothesis.strengths:
        at, half_width = x[j], float(widths[j])
        usable = np.isfinite([half_width, single_errors[j]]).all() and at != 0.0
        if not usable or (smooth and half_width <= LINEAR_SHARE * abs(at)):
            continue

        def cost(value: float, j: int = j) -> float:
            specs = model.moved(index, [value if k == j else v for k, v in enumerate(x)])
            residual = np.nan_to_num(identify.pack(case.whitened(specs, model.settled)))
            return 0.5 * float(weight @ (np.square(residual) - np.square(left)))

        c = hypothesis.coordinates[j]
        predicted = 0.5 * (half_width / float(single_errors[j])) ** 2
        result[j] = profile.interval(cost, at, half_width, predicted, c.one_sided)
    return result


def halves(residuals: Sequence[np.ndarray]) -> np.ndarray:
    """Index of the half of a record to which each value of `identify.flat` belongs, (N,)."""
    groups = [
        np.repeat(2 * i + (np.arange(len(r)) >= len(r) // 2), r.shape[1])
        for i, r in enumerate(residuals)
    ]
    return np.concatenate(groups)


def _shapes(model: Fitted, count: int) -> np.ndarray:
    """Flags of those of `count` coordinates of `_moves` that are shapes of an effect, (P,)."""
    flags = [not c.strength for hypothesis, _ in model.parts for c in hypothesis.coordinates]
    return np.array(flags + [False] * (count - len(flags)))


def _moves(model: Fitted) -> tuple[list[str], list[tuple[list, dict, float]]]:
    """Perturbation of each coordinate: names, and (effects, nominal values, step) of each."""
    names, moves = [], []
    for i, (hypothesis, x) in enumerate(model.parts):
        for j, c in enumerate(hypothesis.coordinates):
            step = LOG_STEP if c.logarithmic else STRENGTH_STEP * (abs(x[j]) or 1.0)
            if c.clipped(x[j] + step) != x[j] + step:
                step = -step
            specs = model.moved(i, [v + step * (k == j) for k, v in enumerate(x)])
            names.append(f"{hypothesis.effect}.{c.label} {hypothesis.place}".strip())
            moves.append((specs, model.overrides, step))
    for name, value in model.overrides.items():
        names.append(name)
        moves.append((model.specs, {**model.overrides, name: value * np.exp(LOG_STEP)}, LOG_STEP))
    return names, moves


def _column(
    case: Case, ref: Sequence[np.ndarray], specs: list, overrides: dict, step: float
) -> np.ndarray:
    """Change of all residuals per unit of a coordinate, (N,)."""
    moved = case.whitened(specs, overrides)
    change = identify.pack([a - b for a, b in zip(moved, ref, strict=True)])
    return np.clip(change, -case.cap, case.cap) / step
