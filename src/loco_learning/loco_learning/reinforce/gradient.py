# SPDX-License-Identifier: Apache-2.0
r"""Policy gradient of the readout: thesis section 3.4.3, eqs. (3.18) to (3.24).

The thesis defines the policy as a probability of actions, seeks the parameters theta that maximise
the value V (3.18, 3.19), explores by a random choice of actions (3.22), and moves an estimate by a
learning rate towards the experience (3.24). It leaves open how to do this in continuous
time and space, where a table of Q-values is impossible, and proposes the step for future work
(3.5.3). Here the parameters theta are those of the readout itself:

.. math::
    q_k &= (W + B\,\xi)^T u_k, \qquad \xi \sim N(0, \sigma^2)
        && \text{the policy, in place of (3.22)} \\
    R &= \frac{\sum_i \gamma^{i-1} r_{k+i}}{\sum_i \gamma^{i-1}}
        && \text{the value of an episode, (3.18)} \\
    \nabla_\theta E[R] &= E[(R - b)\, e], \qquad
        e = \nabla_\theta \ln p(\xi) = \xi / \sigma^2 && \text{towards the maximum of (3.19)} \\
    g &\leftarrow m\, g + \overline{(R - b)\, e} / s, \qquad
        W \leftarrow W + \eta\, \sigma^2\, B\, g && \text{in the manner of (3.24)}

with the eligibility e of a perturbation, the baseline b and the rms s of R - b in an update.

Departures: the random part is drawn once per episode and not at each tick, so that joints do not
shake at the control rate; every draw is also tested with the opposite sign, and the mean return of
the two is their baseline; gradients of earlier updates decay with m; the columns of B are the
leading directions of the hidden activity, scaled so that each moves a joint by 1 rad rms
while the readout walks, so that the step is one of the natural gradient; only positions are
explored, the readout's velocities stay as trained. No Q-value is stored and the Bellman
equation (3.20, 3.21) is not used: its model of the next state is unknown, as the thesis says.

Source: Williams, Machine Learning 8, 1992 (eligibility and baseline); Sehnke et al., Neural
Networks 23, 2010 (perturbed parameters, mirrored).
"""

from __future__ import annotations

import numpy as np

from loco_control.exceptions import ParameterError

from .params import ReinforceParams


class PolicyGradient:
    """Readout that is perturbed, evaluated and moved, update after update.

    Args:
        weights: Initial readout, (N, 2k): positions, then velocities of k joints.
        basis: Explored directions, (N, d), from `directions`.
        params: Size of a perturbation, learning rate, momentum, batch and seed.

    Attributes:
        weights: Current readout, (N, 2k).
        updates: Number of updates so far.
    """

    def __init__(self, weights: np.ndarray, basis: np.ndarray, params: ReinforceParams):
        self.weights, self.basis, self._params = np.array(weights, dtype=float), basis, params
        self.joints = self.weights.shape[1] // 2
        self._course = np.zeros((basis.shape[1], self.joints))  # gradient g
        self.updates = 0

    def perturbations(self) -> np.ndarray:
        """Draws xi of this update over sigma, (batch, d, k); the second half mirrors the first."""
        rng = np.random.default_rng([self._params.seed, self.updates, 0x2E1F])
        draws = rng.standard_normal((self._params.batch // 2, self.basis.shape[1], self.joints))
        return np.concatenate((draws, -draws))

    def perturbed(self) -> list[np.ndarray]:
        """Readouts to evaluate in this update, (N, 2k) each."""
        return [self._moved(self._params.exploration * xi) for xi in self.perturbations()]

    def learn(self, returns: np.ndarray) -> None:
        """Move the readout according to the returns of the readouts of `perturbed`, (batch,).

        Raises:
            ParameterError: The number of returns is not that of the perturbations.
        """
        p, returns = self._params, np.asarray(returns, dtype=float)
        if returns.shape != (p.batch,):
            raise ParameterError(f"returns must have shape ({p.batch},), got {returns.shape}")
        pairs = returns.reshape(2, -1)
        advantage = (pairs - pairs.mean(axis=0)).ravel()  # over the mean of a draw and its mirror
        scale = float(np.sqrt(np.mean(advantage**2)))
        eligibility = self.perturbations() / p.exploration  # xi / sigma², xi = sigma draw
        gradient = np.tensordot(advantage, eligibility, axes=1) / p.batch
        if scale > 0.0:  # otherwise this batch is not informative
            self._course = p.momentum * self._course + gradient / scale
        self.weights = self._moved(p.step * p.exploration**2 * self._course)
        self.updates += 1

    def _moved(self, change: np.ndarray) -> np.ndarray:
        """Readout after a change of its positions (d, k) [rad]."""
        weights = self.weights.copy()
        weights[:, : self.joints] += self.basis @ change
        return weights


def directions(activity: np.ndarray, count: int) -> np.ndarray:
    """Directions of the largest variance of the hidden activity, each of unit effect.

    Args:
        activity: Hidden activity of many ticks, (T, N).
        count: Number of directions, d.

    Returns:
        B of shape (N, d) with mean((B_iᵀ u)²) = 1/d for every column i, so that independent unit
        weights on all columns move an output by 1 rms; fewer columns if the activity has no more.

    Raises:
        ParameterError: The activity is zero throughout.
    """
    values, vectors = np.linalg.eigh(activity.T @ activity / max(len(activity), 1))
    values, vectors = values[::-1][:count], vectors[:, ::-1][:, :count]
    significant = values > 1e-9 * max(float(values[0]), 1e-300)
    if not significant.any() or values[0] <= 0.0:
        raise ParameterError("the hidden layer is silent, so there is nothing to explore")
    # The sign of an eigenvector is arbitrary; it is fixed for equal results on all machines.
    vectors = vectors * np.where(vectors[np.abs(vectors).argmax(axis=0), range(len(values))] < 0,
                                 -1.0, 1.0)  # fmt: skip
    return vectors[:, significant] / np.sqrt(values[significant] * np.count_nonzero(significant))
