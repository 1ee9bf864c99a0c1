# SPDX-License-Identifier: Apache-2.0
"""Which hypotheses can explain the residual at all: one or a few simulations of each.

The response to a strength is taken at a size whose response is about as large as the
residual (secant), so that friction of a hydraulic leg and of a bench need no separate priors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .case import Case
from .hypotheses import Hypothesis

TRIES = 3  # sizes per start
DEAD = 1e-3  # response over residual below which an effect cannot be seen
GROW, SHRINK = 30.0, 0.02  # most that a size changes from one try to the next


@dataclass(frozen=True)
class Screened:
    """What a hypothesis may explain.

    Attributes:
        hypothesis: Which.
        share: Of the residual's energy, as simulated, at most 1; below 0 it does harm.
        x: Coordinates at which that was.
        dead: It changes nothing that was measured.
        wrong_sign: It would explain something with a sign that physics forbids.
        cost: Simulations.
    """

    hypothesis: Hypothesis
    share: float
    x: tuple[float, ...]
    dead: bool = False
    wrong_sign: float = 0.0
    cost: int = 0


def screen(
    case: Case,
    hypothesis: Hypothesis,
    base: Sequence[Mapping],
    overrides: Mapping[str, Any],
    only: Sequence[int],
    residual: np.ndarray,
    tangent: np.ndarray | None = None,
    known: Sequence[float] | None = None,
) -> Screened:
    """Try a hypothesis on top of a model.

    Args:
        case: Model and data.
        hypothesis: What to add.
        base: Effects that the model has already.
        overrides: Its nominal values.
        only: Records to look at.
        residual: Of that model there, (N,).
        tangent: Orthonormal columns that the model's own parameters span, (N, k); what they
            explain is not counted.
        known: The only coordinates to start from, if it was screened before.
    """
    best, cost, wrong, alive = (-np.inf, ()), 0, 0.0, False
    energy = float(residual @ residual)
    for start in [list(known)] if known else hypothesis.starts():
        x, tried = list(start), []
        for _ in range(TRIES):
            columns, used = _responses(case, hypothesis, x, base, overrides, only, residual)
            cost += used
            size = np.linalg.norm(columns, axis=0)
            if size.max() < DEAD * np.sqrt(energy):
                scale = min(GROW, 0.3 * np.sqrt(energy) / max(size.max(), 1e-12))
                moved = _scaled(hypothesis, x, [scale] * columns.shape[1])
                if scale < 1.5 or moved == x:
                    break
                x = moved
                continue
            alive = True
            factors = _solve(project(columns, tangent), project(residual, tangent))
            share, factors, forbidden = _judged(hypothesis, x, columns, residual, factors, tangent)
            wrong = max(wrong, forbidden)
            if columns.shape[1] == 1:
                actual = 1.0 - _energy(residual + columns[:, 0], tangent) / _energy(
                    residual, tangent
                )
                tried.append((actual, tuple(x)))
            moved = _scaled(hypothesis, x, factors)
            if share <= 0.0 or np.allclose(factors, 1.0, atol=0.3) or moved == x:
                if share > 0.0 and columns.shape[1] > 1:
                    tried.append((share, tuple(moved)))
                break
            x = moved
            if columns.shape[1] > 1:
                tried.append((0.9 * share, tuple(x)))
            else:
                tried.append((0.5 * share, tuple(x)))
        if tried:
            best = max(best, max(tried))
    if not best[1]:
        start = tuple(hypothesis.starts()[0])
        return Screened(hypothesis, 0.0, start, not alive, wrong, cost)
    return Screened(hypothesis, float(best[0]), best[1], not alive, wrong, cost)


def project(values: np.ndarray, tangent: np.ndarray | None) -> np.ndarray:
    """Values without what orthonormal columns explain."""
    return values if tangent is None else values - tangent @ (tangent.T @ values)


def _energy(values: np.ndarray, tangent: np.ndarray | None) -> float:
    left = project(values, tangent)
    return max(float(left @ left), 1e-300)


def _responses(
    case: Case,
    hypothesis: Hypothesis,
    x: Sequence[float],
    base: Sequence[Mapping],
    overrides: Mapping[str, Any],
    only: Sequence[int],
    residual: np.ndarray,
) -> tuple[np.ndarray, int]:
    """Change of the residual by each strength alone at its present size, (N, s)."""
    columns = []
    for strength in hypothesis.strengths:
        at = [0.0 if c.strength else v for c, v in zip(hypothesis.coordinates, x, strict=True)]
        at[strength] = x[strength]
        specs = [*base, hypothesis.term(at).spec]
        columns.append(case.vector(specs, overrides, only) - residual)
    return np.stack(columns, axis=1), len(columns)


def _solve(columns: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Factors of the columns that lower the residual most, dead ones 0."""
    norms = np.linalg.norm(columns, axis=0)
    live = norms > 1e-6 * norms.max()
    factors = np.zeros(columns.shape[1])
    if live.any():
        scaled = columns[:, live] / norms[live]
        factors[live] = -np.linalg.lstsq(scaled, residual, rcond=1e-3)[0] / norms[live]
    return factors


def _judged(
    hypothesis: Hypothesis,
    x: Sequence[float],
    columns: np.ndarray,
    residual: np.ndarray,
    factors: np.ndarray,
    tangent: np.ndarray | None,
) -> tuple[float, np.ndarray, float]:
    """Share explained by a linear step, its factors, and the share that a sign forbids."""
    whole = _energy(residual, tangent)
    share = 1.0 - _energy(residual + columns @ factors, tangent) / whole
    forbidden = [
        f < 0.0 and hypothesis.coordinates[i].one_sided
        for f, i in zip(factors, hypothesis.strengths, strict=True)
    ]
    if not any(forbidden):
        return share, factors, 0.0
    factors = np.where(forbidden, 0.0, factors)
    allowed = 1.0 - _energy(residual + columns @ factors, tangent) / whole
    return (allowed if np.any(factors) else 0.0), factors, share


def _scaled(hypothesis: Hypothesis, x: Sequence[float], factors: Sequence[float]) -> list[float]:
    """Coordinates with the strengths multiplied, within reason and bounds."""
    x = list(x)
    for strength, factor in zip(hypothesis.strengths, factors, strict=True):
        size = min(max(abs(factor), SHRINK), GROW) if factor else 0.0
        x[strength] = hypothesis.coordinates[strength].clipped(
            x[strength] * size * (1.0 if factor >= 0.0 else -1.0)
        )
    return x
