# SPDX-License-Identifier: Apache-2.0
"""Robust least squares for residuals that cost a simulation each.

Levenberg-Marquardt with Broyden updates of the Jacobian, so that a fit of one parameter takes
about eight simulations. Finite differences are large, a tenth of the parameter: friction, play and
delays are not smooth on a small scale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

LONGEST_STEP = 1.5  # largest step of a coordinate, in its units
SMALL = 1e-4  # relative decrease of the cost that is not worth a simulation
MIN_GAIN = 0.5  # absolute decrease of the cost [nat] that is not worth a simulation
# Change of the residual by a difference, over its size, that is sought at first, and after fresh
# differences led nowhere; factor on it from which on a difference is narrowed, and tries (taste).
WIDE, NARROW, LOUD, TRIES = 0.3, 0.1, 3.0, 3
MAX_DAMPING = 10.0  # damping at which differences are taken, or narrower ones (taste)
STEADY = 0.5  # share of the change that a narrower difference leaves; above, the residual jumps
PROMISING = 10.0  # predicted decrease, over a small one, at which a small one is no end (taste)
FIRST = 24  # simulations with a given Jacobian alone (taste)

Residual = Callable[[np.ndarray], np.ndarray]


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
    fun: Residual,
    z: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    step: float,
    budget: int,
    jacobian: np.ndarray | None = None,
    coarse: Residual | None = None,
) -> Solution:
    """Bounded least squares from initial coordinates.

    Args:
        fun: Residual (N,) at coordinates (P,).
        z: Initial coordinates, (P,).
        bounds: Smallest and largest coordinates, (P,) each.
        step: Finite difference for the Jacobian, in units of the coordinates.
        budget: Largest number of simulations.
        jacobian: Approximate Jacobian at the start, (N, P); by default finite differences.
        coarse: Residual that is quicker to compute and has nearly the same Jacobian, for finite
            differences.
    """
    search = _Search(fun, bounds, step, coarse)
    return search.run(np.clip(z, *bounds), budget, jacobian)


def guided(
    fun: Residual,
    z: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    step: float,
    budgets: tuple[int, int],
    slopes: np.ndarray,
    accepted_cost: float,
    coarse: Residual | None = None,
) -> Solution:
    """Least squares with an approximate Jacobian; by finite differences if it does not suffice.

    Args:
        fun: Residual (N,) at coordinates (P,).
        z: Initial coordinates, (P,).
        bounds: Smallest and largest coordinates, (P,) each.
        step: Finite difference for the Jacobian, in units of the coordinates.
        budgets: Largest numbers of simulations with `slopes`, and by differences.
        slopes: Approximate Jacobian at the start, (N, P).
        accepted_cost: Cost at which the first part is accepted.
        coarse: Residual for finite differences that is quicker to compute.
    """
    solution = minimise(fun, z, bounds, step, budgets[0], slopes, coarse)
    if solution.cost <= accepted_cost:
        return solution
    return minimise(fun, solution.z, bounds, step, budgets[1], None, coarse)


def lowest(
    fun: Residual,
    z: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    step: float,
    strides: Sequence[tuple[int, float]],
    budgets: tuple[int, int],
    coarse: Residual | None = None,
) -> Solution:
    """Least squares to a minimum from which no stride along one coordinate leads lower.

    Args:
        fun: Residual (N,) at coordinates (P,).
        z: Initial coordinates, (P,).
        bounds: Smallest and largest coordinates, (P,) each.
        step: Finite difference for the Jacobian, in units of the coordinates.
        strides: Indices of coordinates and lengths of the strides, taken both ways.
        budgets: Largest numbers of simulations in all, and of each fit.
        coarse: Residual for finite differences that is quicker to compute.
    """
    count = 0
    while True:
        solution = minimise(fun, z, bounds, step, budgets[1], None, coarse)
        count, z, cost = count + solution.evaluations, solution.z, solution.cost
        for i, stride in strides if count < budgets[0] else ():
            for move in (stride, -stride):
                moved = solution.z + move * np.eye(len(z))[i]
                if bounds[0][i] <= moved[i] <= bounds[1][i]:
                    r, count = fun(moved), count + 1
                    if 0.5 * float(r @ r) < cost - MIN_GAIN:
                        z, cost = moved, 0.5 * float(r @ r)
        if z is solution.z:
            return Solution(solution.z, solution.cost, solution.jacobian, count)


def differences(
    fun: Residual,
    z: np.ndarray,
    r: np.ndarray,
    steps: np.ndarray,
    highest: np.ndarray,
    target: float = WIDE,
) -> np.ndarray:
    """Jacobian, (N, P), by finite differences towards the inside of the bounds.

    A difference that changes the residual by more than its size, `LOUD`, is replaced by a smaller
    one: an eighth of the place of a stop is millimetres, the noise of an encoder is micrometres.

    Args:
        fun: Residual (N,) at coordinates (P,).
        z: Coordinates, (P,).
        r: Residual at `z`, (N,).
        steps: Differences, in units of the coordinates, (P,); those that were used are put in.
        highest: Largest coordinates, (P,).
        target: Change of the residual by a difference that is narrowed, over its size.
    """
    columns, size = [], float(np.linalg.norm(r)) or 1.0
    for p, axis in enumerate(np.eye(len(z))):
        h, before = steps[p] if z[p] + steps[p] <= highest[p] else -steps[p], np.inf
        for _ in range(TRIES):
            change = fun(z + h * axis) - r
            loud = float(np.linalg.norm(change)) / size
            if not loud < STEADY * before:
                break  # a jump, which a narrower difference only divides by less
            column, steps[p], before = change / h, abs(h), loud
            if loud < LOUD * target:
                break
            h *= target / loud
        columns.append(column)
    return np.stack(columns, axis=1)


class _Search:
    """Levenberg-Marquardt iteration and its count of simulations."""

    def __init__(self, fun: Residual, bounds: tuple, step: float, coarse: Residual | None):
        self.fun, self.quick, self.bounds, self.count = fun, coarse, bounds, 0
        self.steps, self.target = np.full(len(bounds[0]), step), WIDE

    def at(self, z: np.ndarray) -> np.ndarray:
        self.count += 1
        return self.fun(z)

    def slopes(self, z: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Jacobian at `z`, where the residual is `r`, by finite differences."""
        fun = self.quick or self.at
        if self.quick:
            r, self.count = fun(z), self.count + 1 + len(z)
        return differences(fun, z, r, self.steps, self.bounds[1], self.target)

    def run(self, z: np.ndarray, budget: int, jacobian: np.ndarray | None = None) -> Solution:
        r = self.at(z)
        has_jacobian = jacobian is not None
        cost, damping, is_exact = 0.5 * float(r @ r), 1e-3, not has_jacobian
        if not has_jacobian:
            jacobian = self.slopes(z, r)
        while self.count < budget:
            dz = self.move(z, jacobian, r, damping)
            model = r + jacobian @ dz
            gain = cost - 0.5 * float(model @ model)
            if gain < max(SMALL * cost, MIN_GAIN) and is_exact:
                break
            trial = self.at(z + dz)
            new = 0.5 * float(trial @ trial)
            length = float(dz @ dz)
            if length > 0.0 and (new < cost or not is_exact):  # too far for an update otherwise
                jacobian = jacobian + np.outer(trial - model, dz) / length
            if new < cost:
                threshold = max(10.0 * SMALL * cost, MIN_GAIN)
                small = cost - new < threshold
                z, r, cost, damping = z + dz, trial, new, max(damping / 5.0, 1e-6)
                if not small:
                    is_exact = False
                    continue
                if is_exact and gain < PROMISING * threshold:
                    break
            else:
                damping *= 10.0
                failing = damping > MAX_DAMPING
                if failing and is_exact and self.target > NARROW:
                    self.target, damping = NARROW, 1e-3
                elif failing and has_jacobian and not is_exact and self.count + 2 * len(z) < budget:
                    damping = 1e-3
                elif damping > 1e4:
                    break
                elif is_exact or has_jacobian:
                    continue
            if self.count + len(z) >= budget:
                break
            self.steps = np.maximum(0.3 * self.steps, np.minimum(self.steps, 0.03))
            jacobian = self.slopes(z, r)
            is_exact = True
        return Solution(z, cost, jacobian, self.count)

    def move(
        self, z: np.ndarray, jacobian: np.ndarray, r: np.ndarray, damping: float
    ) -> np.ndarray:
        """Damped step inside the bounds; coordinates on a bound that it would cross are fixed."""
        free = np.ones(len(z), dtype=bool)
        dz = np.zeros(len(z))
        gram, slope = jacobian.T @ jacobian, jacobian.T @ r
        for _ in range(len(z)):
            if not free.any():
                break
            hessian = gram[np.ix_(free, free)]
            scale = np.diag(hessian) + 1e-9 * max(float(np.trace(hessian)), 1e-300)
            dz[:] = 0.0
            dz[free] = -np.linalg.solve(hessian + np.diag(damping * scale + 1e-12), slope[free])
            out = free & (((z <= self.bounds[0]) & (dz < 0)) | ((z >= self.bounds[1]) & (dz > 0)))
            if not out.any():
                break
            free &= ~out
        dz = np.clip(dz, -LONGEST_STEP, LONGEST_STEP)
        return np.clip(z + dz, *self.bounds) - z
