# SPDX-License-Identifier: Apache-2.0
"""Largest stable integration step of a network."""

from __future__ import annotations

import numpy as np

from loco_control.exceptions import ParameterError

from .network import Network
from .params import MsdParams


def check_step(network: Network, params: MsdParams, stiffness: np.ndarray | None = None) -> None:
    """Refuse a step that is too large for the stiffest, most damped motion of a network.

    Raises:
        ParameterError: The step is above `largest_step`; the message states the limit.
    """
    limit = largest_step(network, params, stiffness)
    if params.step > limit:
        raise ParameterError(
            f"step {params.step:g} s is too large for this network: it is stable up to "
            f"{limit:.3g} s; take a smaller step, less stiffness or damping, or more mass"
        )


def largest_step(network: Network, params: MsdParams, stiffness: np.ndarray | None = None) -> float:
    """Conservative estimate of the largest stable step of the linearised network [s].

    The fastest modes of springs and dampers are bounded by those of links that are all parallel
    (the largest eigenvalue of the weighted graph Laplacian over the masses). The bound is exact
    for a straight chain of links.

    Args:
        network: Nodes and links.
        params: Drag and integrator.
        stiffness: k of the links [N/m] in place of the network's, e.g. the maximum over a
            population.
    """
    k = network.stiffness if stiffness is None else stiffness
    fast = _largest_eigenvalue(network, k)
    decay_rate = _largest_eigenvalue(network, network.damping) + params.drag / network.masses.min()
    author = params.integrator == "author"
    pairs = [(fast, decay_rate), (fast, 0.0), (0.0, decay_rate)]
    return min(_limit(square, damping, author) for square, damping in pairs)


def _largest_eigenvalue(network: Network, weights: np.ndarray) -> float:
    """Largest eigenvalue of the weighted graph Laplacian over the masses, by power iterations."""
    i, j = network.links.T
    scale = 1.0 / np.sqrt(network.masses)
    x = np.cos(2.5 * np.arange(network.nodes)) + 0.01 * np.arange(network.nodes)
    value = 0.0
    for _ in range(200):
        x = x / np.linalg.norm(x)
        flow = weights * (scale[i] * x[i] - scale[j] * x[j])
        x = scale * (np.bincount(i, flow, network.nodes) - np.bincount(j, flow, network.nodes))
        before, value = value, float(np.linalg.norm(x))
        if value == 0.0 or abs(value - before) < 1e-4 * value:
            break
    return 1.01 * value


def _limit(square: float, damping: float, author: bool) -> float:
    """Largest stable h of x'' = -square x - damping x' [s], by bisection."""
    if square == 0.0 and damping == 0.0:
        return np.inf
    low, high = 0.0, 4.0 / max(np.sqrt(square), damping, 1e-12)
    for _ in range(40):
        h = 0.5 * (low + high)
        low, high = (h, high) if _radius(h, square, damping, author) <= 1.0 + 1e-9 else (low, h)
    return low


def _radius(h: float, square: float, damping: float, author: bool) -> float:
    """Largest modulus of an eigenvalue of one step on (x, v, a)."""
    x = np.array([1.0, h, 0.5 * h * h])
    u = np.array([0.0, 1.0, 0.0 if author else h])
    a = -square * x - damping * u
    v = np.array([0.0, 1.0, 0.5 * h]) + 0.5 * h * a
    return float(np.abs(np.linalg.eigvals(np.stack([x, v, a]))).max())
