# SPDX-License-Identifier: Apache-2.0
"""Linear readout trained online by recursive least squares (FORCE)."""

from __future__ import annotations

import numpy as np
from numba import njit


class Readout:
    r"""Linear map of hidden activity, trained by FORCE/RLS in place.

    .. math::
        e_k &= W_{k-1}^T u_k - r_k \\
        P_k &= P_{k-1} - \frac{P_{k-1} u_k u_k^T P_{k-1}}{1 + u_k^T P_{k-1} u_k} \\
        W_k &= W_{k-1} - P_k u_k e_k^T, \qquad q_k = W_k^T u_k

    with :math:`P_0 = I / \alpha`. Source: thesis eqs. (3.14) to (3.17).

    P is symmetric, so only its lower triangle is stored. The update of tick k
    is deferred as a vector c (P_k = P_{k-1} - c cᵀ) until tick k+1 reads P.
    One pass over half the matrix per tick is the least memory traffic possible.

    Args:
        neurons: Length of u, N.
        outputs: Length of q, 16 for the reflex network (eq. 7.1).
        regularisation: alpha; a larger value learns more slowly and generalises better.
        weights: Initial weights (neurons, outputs); zero by default.
    """

    def __init__(
        self,
        neurons: int,
        outputs: int,
        regularisation: float = 1e-3,
        weights: np.ndarray | None = None,
    ):
        self.neurons, self.outputs, self.regularisation = neurons, outputs, regularisation
        self._first = np.zeros((neurons, outputs)) if weights is None else np.array(weights, float)
        self.reset()

    def reset(self) -> None:
        """Restore the initial weights and P = I / alpha."""
        self.weights = self._first.copy()  # (N, outputs)
        self._p = np.eye(self.neurons) / self.regularisation  # only the lower triangle is used
        self._pending = np.zeros(self.neurons)  # c, not yet subtracted from P
        self._gain = np.zeros(self.neurons)  # work array: P u

    def predict(self, u: np.ndarray) -> np.ndarray:
        """Output for hidden activity u (N,), shape (outputs,). Eq. (3.17)."""
        output = np.empty(self.outputs)
        multiply(self.weights, u, output)
        return output

    def learn(self, u: np.ndarray, target: np.ndarray) -> np.ndarray:
        """One RLS update toward `target` (outputs,); returns q_k, shape (outputs,)."""
        output = np.empty(self.outputs)
        rls_step(self._p, self.weights, u, target, self._pending, self._gain, output)
        return output

    @property
    def covariance(self) -> np.ndarray:
        """P of eq. (3.15) as a full matrix, (N, N)."""
        lower = np.tril(self._p - np.outer(self._pending, self._pending))
        return lower + np.tril(lower, -1).T

    def state(self) -> dict[str, np.ndarray]:
        """Arrays to save."""
        return {"weights": self.weights, "p": self._p, "pending": self._pending}


@njit(cache=True)
def multiply(weights, u, output):
    """Write weightsᵀ u to `output`."""
    output[:] = 0.0
    for i in range(weights.shape[0]):
        x = u[i]
        for o in range(weights.shape[1]):
            output[o] += weights[i, o] * x


# Reordering of the sum `below` is permitted, since without it the loop is not vectorised and takes
# twice as long. The order is fixed at compilation, so results are still reproducible bit by bit.
@njit(cache=True, fastmath={"reassoc", "contract", "nsz"})
def symmetric_pass(p, u, pending, gain):
    """Subtract the pending c cᵀ from P and write P u to `gain`; returns uᵀ P u."""
    n = u.shape[0]
    for i in range(n):
        gain[i] = 0.0
    for i in range(n):
        below, ui, ci = 0.0, u[i], pending[i]
        for j in range(i):
            x = p[i, j] - ci * pending[j]
            p[i, j] = x
            gain[j] += x * ui  # the upper triangle, by symmetry
            below += x * u[j]
        p[i, i] -= ci * ci
        gain[i] += below + p[i, i] * ui
    total = 0.0
    for i in range(n):
        total += u[i] * gain[i]
    return total


@njit(cache=True)
def rls_step(p, weights, u, target, pending, gain, output):
    """Eqs. (3.14) to (3.17) in place; P_k u_k = P_{k-1} u_k / s with s = 1 + uᵀ P_{k-1} u."""
    n, outputs = weights.shape
    multiply(weights, u, output)
    s = 1.0 + symmetric_pass(p, u, pending, gain)
    root = np.sqrt(s)
    for i in range(n):
        pending[i] = gain[i] / root
    for i in range(n):
        step = gain[i] / s
        for o in range(outputs):
            weights[i, o] -= step * (output[o] - target[o])
    for o in range(outputs):  # q_k = W_kᵀ u_k without a second product
        output[o] -= (s - 1.0) / s * (output[o] - target[o])
