# SPDX-License-Identifier: Apache-2.0
"""Robust least squares for residuals that cost a simulation each.

Levenberg-Marquardt with Broyden updates of the Jacobian, so that a fit of one parameter takes
about eight simulations. Finite differences are large, a tenth of the parameter: friction, play and
delays are not smooth on a small scale.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

LONGEST_STEP = 1.5  # largest step of a coordinate, in its units
SMALL = 1e-4  # relative decrease of the cost that is not worth a simulation
FEW = 0.5  # absolute decrease of the cost [nat] that is not worth a simulation
FIRST = 24  # simulations with a given Jacobian alone (taste)


@dataclass
class Solution:
    """Result of a fit.

    Attributes:
        z: Coordinates, (P,).
        cost: Half the sum of squares after the robust transform.
        jacobian: Latest Jacobian of the transformed residual, (N, P).
        evaluations: Number of simulations.
    """

    z: np.ndarray
    cost: float
    jacobian: np.ndarray
    evaluations: int


def soft(residual: np.ndarray, scale: float) -> np.ndarray:
    """Residual whose square is twice the soft-L1 loss: small values stay, large ones shrink."""
    magnitude = scale * np.sqrt(2.0 * (np.sqrt(1.0 + np.square(residual / scale)) - 1.0))
    return np.sign(residual) * magnitude


def minimise(
    fun: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    step: float,
    budget: int,
    jacobian: np.ndarray | None = None,
) -> Solution:
    """Bounded least squares from initial coordinates.

    Args:
        fun: Residual (N,) at coordinates (P,).
        z: Initial coordinates, (P,).
        bounds: Smallest and largest coordinates, (P,) each.
        step: Finite difference for the Jacobian, in units of the coordinates.
        budget: Largest number of simulations.
        jacobian: Approximate Jacobian at the start, (N, P); by default finite differences.
    """
    search = _Search(fun, bounds, step)
    return search.run(np.clip(z, *bounds), budget, jacobian)


def guided(
    fun: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    step: float,
    budgets: tuple[int, int],
    slopes: np.ndarray,
    promised: float,
) -> Solution:
    """Least squares with an approximate Jacobian; by finite differences if it does not suffice.

    Args:
        fun: Residual (N,) at coordinates (P,).
        z: Initial coordinates, (P,).
        bounds: Smallest and largest coordinates, (P,) each.
        step: Finite difference for the Jacobian, in units of the coordinates.
        budgets: Largest numbers of simulations with `slopes`, and by differences.
        slopes: Approximate Jacobian at the start, (N, P).
        promised: Cost at which the first part is accepted.
    """
    found = minimise(fun, z, bounds, step, budgets[0], slopes)
    return found if found.cost <= promised else minimise(fun, found.z, bounds, step, budgets[1])


def differences(
    fun: Callable[[np.ndarray], np.ndarray],
    z: np.ndarray,
    r: np.ndarray,
    step: float,
    highest: np.ndarray,
) -> np.ndarray:
    """Jacobian, (N, P), by finite differences towards the inside of the bounds.

    Args:
        fun: Residual (N,) at coordinates (P,).
        z: Coordinates, (P,).
        r: Residual at `z`, (N,).
        step: Difference, in units of the coordinates.
        highest: Largest coordinates, (P,).
    """
    columns = []
    for p in range(len(z)):
        h = step if z[p] + step <= highest[p] else -step
        moved = z.copy()
        moved[p] += h
        columns.append((fun(moved) - r) / h)
    return np.stack(columns, axis=1)


class _Search:
    """Levenberg-Marquardt iteration and its count of simulations."""

    def __init__(self, fun: Callable, bounds: tuple, step: float):
        self.fun, self.bounds, self.step, self.count = fun, bounds, step, 0

    def at(self, z: np.ndarray) -> np.ndarray:
        self.count += 1
        return self.fun(z)

    def run(self, z: np.ndarray, budget: int, jacobian: np.ndarray | None = None) -> Solution:
        r = self.at(z)
        given = jacobian is not None
        cost, damping, fresh = 0.5 * float(r @ r), 1e-3, not given
        if not given:
            jacobian = differences(self.at, z, r, self.step, self.bounds[1])
        while self.count < budget:
            dz = self.move(z, jacobian, r, damping)
            model = r + jacobian @ dz
            gain = cost - 0.5 * float(model @ model)
            if gain < max(SMALL * cost, FEW) and fresh:
                break
            tried = self.at(z + dz)
            new = 0.5 * float(tried @ tried)
            length = float(dz @ dz)
            if length > 0.0 and (new < cost or not fresh):  # too far for an update otherwise
                jacobian = jacobian + np.outer(tried - model, dz) / length
            if new < cost:
                small = cost - new < max(10.0 * SMALL * cost, FEW)
                z, r, cost, damping = z + dz, tried, new, max(damping / 5.0, 1e-6)
                if not small:
                    fresh = False
                    continue
                if fresh:
                    break
            else:
                damping *= 10.0
                if damping > 1e4:
                    break
                if fresh or given:
                    continue
            if self.count + len(z) >= budget:
                break
            self.step = max(0.3 * self.step, 0.03)
            jacobian = differences(self.at, z, r, self.step, self.bounds[1])
            fresh = True
        return Solution(z, cost, jacobian, self.count)

    def move(
        self, z: np.ndarray, jacobian: np.ndarray, r: np.ndarray, damping: float
    ) -> np.ndarray:
        """Damped step inside the bounds; coordinates on a bound that it would cross are fixed."""
        free = np.ones(len(z), dtype=bool)
        dz = np.zeros(len(z))
        whole, slope = jacobian.T @ jacobian, jacobian.T @ r
        for _ in range(len(z)):
            if not free.any():
                break
            hessian = whole[np.ix_(free, free)]
            scale = np.diag(hessian) + 1e-9 * max(float(np.trace(hessian)), 1e-300)
            dz[:] = 0.0
            dz[free] = -np.linalg.solve(hessian + np.diag(damping * scale + 1e-12), slope[free])
            out = free & (((z <= self.bounds[0]) & (dz < 0)) | ((z >= self.bounds[1]) & (dz > 0)))
            if not out.any():
                break
            free &= ~out
        dz = np.clip(dz, -LONGEST_STEP, LONGEST_STEP)
        return np.clip(z + dz, *self.bounds) - z
