# SPDX-License-Identifier: Apache-2.0
"""Sensitivities of a fitted model to its parameters, and the resulting intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from loco_sim.effects.base import EFFECTS

from ..fitting.fit import Fitted
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case, are_smooth
from ..statistics import identify, profile, robust
from . import doubt
from .estimates import Estimate

STRENGTH_STEP, LOG_STEP = (
    0.05,
    0.1,
)  # finite difference of a strength, and of the logarithm of a shape or nominal value
# Factor on these, and on deviations of values of the robot, where residuals have derivatives: what
# an effect and these values do may nearly cancel, and errors of the columns would hide it (theory).
NARROW = 0.01
JUMPS = 2.0  # ratio of the lengths of both columns above which there is no derivative (taste)
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
    names = _moves(model)[0]
    if not names:
        return {}, None
    base_case = case.kept()
    reference = base_case.whitened(model.specs, model.settled)
    matrix, uncertain = columns(case, model, wider)
    weight = identify.weights(model.score)
    analysis = identify.analyse(matrix, names, list(model.overrides), weight)
    used = case.masked(model.whole, range(len(model.whole)), held=False)
    weight = np.where(np.isfinite(identify.pack(used)), weight, 0.0)  # what was fitted, no more
    groups = robust.clusters(used, case.forward.begun())
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


def columns(
    case: Case, model: Fitted, wider: bool = True
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Change of all residuals per unit of each coordinate, (N, P), and `doubt.columns`.

    Where values of the robot are in doubt, a column is the derivative, if residuals have one.
    Those of effects with thresholds and dry friction, which act in jumps, have none.

    Args:
        case: Model and data.
        model: Fitted model.
        wider: Whether values of the robot are in doubt; otherwise they have no columns.
    """

    def by(share: float) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
        coarse = share < 1.0 and case.quickly(model.specs)
        reference = fixed.whitened(model.specs, model.settled, coarse=coarse)
        moves = _moves(model, share)[1]
        matrix = np.stack([_column(fixed, reference, *move, coarse) for move in moves], axis=1)
        if not wider:
            return matrix, doubt.none(len(matrix))
        return matrix, doubt.columns(case, model, share, coarse or share == 1.0)

    fixed = case.kept()
    effects, (values, at) = by(1.0)
    if not (wider and is_smooth(case, model)):
        return effects, (values, at)
    narrow = by(NARROW)
    return _smooth(narrow[0], effects), (_smooth(narrow[1][0], values), at)


def is_smooth(case: Case, model: Fitted) -> bool:
    """True if no contact, rounded encoder or effect of the model acts in jumps."""
    return are_smooth(model.names) and not case.ground and not case.rounds


def _smooth(narrow: np.ndarray, wide: np.ndarray) -> np.ndarray:
    """Columns by narrow differences, (N, P), and those by wide ones where these differ by jumps."""
    lengths = [np.linalg.norm(np.nan_to_num(each), axis=0) for each in (narrow, wide)]
    return np.where(np.max(lengths, axis=0) <= JUMPS * np.min(lengths, axis=0), narrow, wide)


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


def _moves(model: Fitted, share: float = 1.0) -> tuple[list[str], list[tuple[list, dict, float]]]:
    """Perturbation of each coordinate: names, and (effects, values of the robot, step) of each.

    Args:
        model: Fitted model.
        share: Factor on the usual steps.
    """
    names, moves = [], []
    for i, (hypothesis, x) in enumerate(model.parts):
        for j, c in enumerate(hypothesis.coordinates):
            step = share * (LOG_STEP if c.logarithmic else STRENGTH_STEP * (abs(x[j]) or 1.0))
            if c.clipped(x[j] + step) != x[j] + step:
                step = -step
            specs = model.moved(i, [v + step * (k == j) for k, v in enumerate(x)])
            names.append(f"{hypothesis.effect}.{c.label} {hypothesis.place}".strip())
            moves.append((specs, model.settled, step))
    for name, value in model.overrides.items():
        names.append(name)
        moved = {**model.settled, name: value * np.exp(share * LOG_STEP)}
        moves.append((model.specs, moved, share * LOG_STEP))
    return names, moves


def _column(
    case: Case, ref: Sequence[np.ndarray], specs: list, overrides: dict, step: float, coarse: bool
) -> np.ndarray:
    """Change of all residuals per unit of a coordinate, (N,)."""
    moved = case.whitened(specs, overrides, coarse=coarse)
    change = identify.pack([a - b for a, b in zip(moved, ref, strict=True)])
    return np.clip(change, -case.cap, case.cap) / step
