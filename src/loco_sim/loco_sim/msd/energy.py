# SPDX-License-Identifier: Apache-2.0
"""Energy, momentum and driving power of a network."""

from __future__ import annotations

import numpy as np

from .network import Network
from .params import MsdParams


def kinetic_energy(network: Network, velocity: np.ndarray) -> np.ndarray:
    """Sum of m v² / 2 [J] of velocities (…, nodes, axes) [m/s]."""
    return 0.5 * np.sum(network.masses[:, None] * velocity**2, axis=(-2, -1))


def potential_energy(
    network: Network, params: MsdParams, position: np.ndarray, factor: np.ndarray | float = 1.0
) -> np.ndarray:
    """Potential energy of gravity and springs [J] at positions (…, nodes, axes) [m].

    A spring of eq. (4.3) holds k (e²/2 + beta e⁴ / (4 l_ref²)), e its stretch.

    Args:
        network: Nodes and links.
        params: Gravity and nonlinearity.
        position: Positions of the nodes [m].
        factor: Driven length / rest length of the links, (…, links).
    """
    height = position[..., -1] @ network.masses
    i, j = network.links.T
    length = np.linalg.norm(position[..., j, :] - position[..., i, :], axis=-1)
    stretch = length - network.rest * factor
    hardening = params.nonlinearity * stretch**4 / (4.0 * network.rest**2)
    return params.gravity * height + np.sum(
        network.stiffness * (0.5 * stretch**2 + hardening), axis=-1
    )


def momentum(network: Network, velocity: np.ndarray) -> np.ndarray:
    """Sum of m v [N·s], (…, axes)."""
    return np.sum(network.masses[:, None] * velocity, axis=-2)


def centre_of_mass(network: Network, position: np.ndarray) -> np.ndarray:
    """Centre of mass of the nodes [m], (…, axes)."""
    return np.sum(network.masses[:, None] * position, axis=-2) / network.masses.sum()
