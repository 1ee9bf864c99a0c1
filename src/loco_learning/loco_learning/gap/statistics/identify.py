# SPDX-License-Identifier: Apache-2.0
"""Identifiability: limits of the information in the data about the fitted parameters.

All from the sensitivities: columns of the derivative of the whitened prediction with
respect to each parameter in units of its typical size. Parameters that are refitted with
every candidate (nuisance) are included: what they can imitate is not evidence.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import chdtrc

from .evidence import Score

SAME_DIRECTION = 0.95  # cosine above which two effects cannot be distinguished in these data
DEAD = 1e-3  # length of a column [standard deviations per typical size] that counts as zero


@dataclass(frozen=True)
class Identifiability:
    """Precision of the parameters, in units of their typical sizes.

    Attributes:
        names: Parameters, in the order of the columns.
        errors: Standard error with all others free, (P,); inf where not determined.
        errors_alone: Standard error if all others were known, (P,).
        dead: Names of parameters that do not change the prediction.
        weak: Names whose standard error is above 1: the data are less informative than the prior.
        alike: Pairs with the cosine of their columns, above `SAME_DIRECTION` after projecting out
            the nuisance columns.
        cosines: All of these cosines, (F, F) over the parameters that are no nuisance.
        worst: Direction in parameter space that the data determine least, in words.
        worst_error: Standard error along it.
        condition: Ratio of the largest to the smallest standard error of any direction.
        imitated: Cosine of each non-nuisance column with its projection on all nuisance
            columns, by name.
    """

    names: tuple[str, ...]
    errors: np.ndarray
    errors_alone: np.ndarray
    dead: tuple[str, ...]
    weak: tuple[str, ...]
    alike: tuple[tuple[str, str, float], ...]
    cosines: np.ndarray
    worst: str
    worst_error: float
    condition: float
    imitated: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Stability:
    """Agreement of the parts of the data on the parameters.

    Attributes:
        shifts: Change of the joint fit that each part alone would give, (G, P); nan if
            undetermined.
        errors: Standard errors of these, (G, P).
        spread: Deviation of the parameter between parts that errors do not explain, (P,).
        probability: Probability of such shifts if all parts have the same parameter, (P,).
    """

    shifts: np.ndarray
    errors: np.ndarray
    spread: np.ndarray
    probability: np.ndarray


def pack(residuals: Sequence[np.ndarray]) -> np.ndarray:
    """Residuals, or sensitivities to one parameter, of all records as a vector, (N,)."""
    return np.concatenate([np.ravel(r) for r in residuals])


def weights(score: Score) -> np.ndarray:
    """Information of each value of `pack` [1/floor²]: 1 / (tau scale²), 0 where not measured."""
    rows = []
    for r, tau in zip(score.residuals, score.tau, strict=True):
        rows.append(np.where(np.isfinite(r), 1.0 / (tau * score.scale**2), 0.0).ravel())
    return np.concatenate(rows)


def analyse(
    columns: np.ndarray,
    names: Sequence[str],
    nuisance: Sequence[str] = (),
    weight: np.ndarray | float = 1.0,
) -> Identifiability:
    """Identifiability from the Fisher information of sensitivities.

    Args:
        columns: (N, P) [floors per typical size]; rows with NaN are left out.
        names: One per column.
        nuisance: Names of the parameters that are refitted with every candidate.
        weight: Information per row (`weights`), (N,) or one for all.
    """
    j = _weighted(columns, weight)
    lengths = np.linalg.norm(j, axis=0)
    nonzero = lengths > DEAD
    errors, errors_alone = standard_errors(columns, weight), np.full(len(names), np.inf)
    errors_alone[nonzero] = 1.0 / lengths[nonzero]
    selected = [name for name, lives in zip(names, nonzero, strict=True) if lives]
    direction, worst_error, condition = _least_determined(j[:, nonzero], selected)
    free = [i for i, name in enumerate(names) if name not in set(nuisance)]
    nuisance_indices = [i for i in range(len(names)) if i not in free]
    cosines = _cosines(j, free, nuisance_indices)
    return Identifiability(
        tuple(names),
        errors,
        errors_alone,
        tuple(name for name, lives in zip(names, nonzero, strict=True) if not lives),
        tuple(n for n, e, lives in zip(names, errors, nonzero, strict=True) if lives and e > 1.0),
        _pairs(cosines, [names[i] for i in free]),
        cosines,
        direction,
        worst_error,
        condition,
        {names[i]: cosine(j[:, i], j[:, nuisance_indices]) for i in free},
    )


def standard_errors(columns: np.ndarray, weight: np.ndarray | float = 1.0) -> np.ndarray:
    """Standard error of each parameter with all others free, (P,); inf where not determined.

    Args:
        columns: (N, P) [floors per typical size]; rows with NaN are left out.
        weight: Information per row (`weights`), (N,) or one for all.
    """
    j = _weighted(columns, weight)
    nonzero, errors = np.linalg.norm(j, axis=0) > DEAD, np.full(j.shape[1], np.inf)
    if nonzero.any():
        errors[nonzero] = np.sqrt(np.diag(_covariance(j[:, nonzero])))
    return errors


def stability(
    columns: np.ndarray,
    residual: np.ndarray,
    groups: np.ndarray,
    weight: np.ndarray | float = 1.0,
) -> Stability:
    """Compute how each part of the data, e.g. each record, would change the joint fit.

    One Gauss-Newton step per part with all columns free. A true effect has the same
    parameters everywhere; an effect that merely imitates another one has not.

    Args:
        columns: (N, P) [floors per typical size], at the joint fit.
        residual: (N,) predicted minus measured [floors].
        groups: (N,) index of the part to which each row belongs.
        weight: Information per row (`weights`), (N,) or one for all.
    """
    complete = np.isfinite(columns).all(1) & np.isfinite(residual)
    root = np.sqrt(np.broadcast_to(weight, complete.shape))[complete]
    j, r, groups = columns[complete] * root[:, None], residual[complete] * root, groups[complete]
    keys = np.unique(groups)
    shifts, errors = np.full((2, len(keys), columns.shape[1]), np.nan)
    for g, key in enumerate(keys):
        rows = groups == key
        nonzero = np.linalg.norm(j[rows], axis=0) > DEAD
        if not nonzero.any():
            continue
        covariance = _covariance(j[rows][:, nonzero])
        shifts[g, nonzero] = -covariance @ (j[rows][:, nonzero].T @ r[rows])
        errors[g, nonzero] = np.sqrt(np.diag(covariance))
    scatter, probability = np.zeros(columns.shape[1]), np.ones(columns.shape[1])
    for p in range(columns.shape[1]):
        scatter[p], probability[p] = _heterogeneity(shifts[:, p], errors[:, p])
    return Stability(shifts, errors, scatter, probability)


def _weighted(columns: np.ndarray, weight: np.ndarray | float) -> np.ndarray:
    """Columns times the root of the weight, without incomplete rows."""
    complete = np.isfinite(columns).all(1)
    return columns[complete] * np.sqrt(np.broadcast_to(weight, complete.shape))[complete, None]


def _covariance(j: np.ndarray) -> np.ndarray:
    """Inverse Fisher matrix; directions without information get a huge variance."""
    _, s, vt = np.linalg.svd(j, full_matrices=False)
    s = np.maximum(s, 1e-9 * max(s.max(initial=0.0), DEAD))
    return (vt.T / s**2) @ vt


def inverse(gram: np.ndarray) -> np.ndarray:
    """Inverse of a Gram matrix whose columns may differ by orders of magnitude; 0 for dead ones."""
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0.0, size, 1.0)
    return np.linalg.pinv(gram / np.outer(size, size), rcond=1e-12, hermitian=True) / np.outer(
        size, size
    )


def _least_determined(j: np.ndarray, names: Sequence[str]) -> tuple[str, float, float]:
    """Least determined direction in words, its standard error, and the condition number."""
    if not names:
        return "no parameter changes the prediction", math.inf, math.inf
    _, s, vt = np.linalg.svd(j, full_matrices=False)
    s = np.maximum(s, 1e-9 * s[0])
    direction = vt[-1] * np.sign(vt[-1][np.abs(vt[-1]).argmax()])
    order = np.argsort(-np.abs(direction), kind="stable")
    leading = [i for i in order if abs(direction[i]) >= 0.3 * abs(direction[order[0]])][:4]
    phrases = [f"{_readable(names[i])} {'up' if direction[i] > 0 else 'down'}" for i in leading]
    text = " with ".join([phrases[0], " and ".join(phrases[1:])] if phrases[1:] else phrases)
    return text, float(1.0 / s[-1]), float(s[0] / s[-1])


def _readable(name: str) -> str:
    return name.replace("_", " ").replace(".", " ")


def _cosines(j: np.ndarray, free: Sequence[int], nuisance: Sequence[int]) -> np.ndarray:
    """Cosines of columns after projecting out the nuisance ones; 0 for columns of zero length."""
    columns = j[:, list(free)]
    if nuisance and len(j):
        u, s, _ = np.linalg.svd(j[:, list(nuisance)], full_matrices=False)
        u = u[:, s > 1e-9 * max(s.max(initial=0.0), DEAD)]
        columns = columns - u @ (u.T @ columns)
    lengths = np.linalg.norm(columns, axis=0)
    unit = np.where(lengths > DEAD, columns / np.maximum(lengths, DEAD), 0.0)
    return unit.T @ unit


def cosine(column: np.ndarray, nuisance: np.ndarray) -> float:
    """Cosine of a column with its projection on others."""
    length = float(np.linalg.norm(column))
    if not nuisance.size or length <= DEAD:
        return 0.0
    projection = nuisance @ np.linalg.lstsq(nuisance, column, rcond=1e-9)[0]
    return float(np.linalg.norm(projection)) / length


def _pairs(cosines: np.ndarray, names: Sequence[str]) -> tuple[tuple[str, str, float], ...]:
    pairs = []
    for a in range(len(names)):
        for b in range(a + 1, len(names)):
            if abs(cosines[a, b]) > SAME_DIRECTION:
                pairs.append((names[a], names[b], float(cosines[a, b])))
    return tuple(pairs)


def _heterogeneity(shifts: np.ndarray, errors: np.ndarray) -> tuple[float, float]:
    """Spread of estimates beyond their errors, and the probability of such a spread by chance."""
    valid = np.isfinite(shifts) & np.isfinite(errors) & (errors < 1e6)
    if valid.sum() < 2:
        return 0.0, 1.0
    x, w = shifts[valid], 1.0 / errors[valid] ** 2
    mean = (w * x).sum() / w.sum()
    q = float((w * (x - mean) ** 2).sum())
    freedom = len(x) - 1
    scale = w.sum() - (w**2).sum() / w.sum()
    return math.sqrt(max(q - freedom, 0.0) / scale), float(chdtrc(freedom, q))
