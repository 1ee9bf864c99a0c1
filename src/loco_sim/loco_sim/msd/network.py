# SPDX-License-Identifier: Apache-2.0
"""Mass-spring-damper networks: nodes joined by links, and chains of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import ParameterError

from .params import MsdParams


@dataclass(frozen=True, eq=False)
class Network:
    """Validated network of nodes and links, sorted by their end nodes, the lower one first.

    Args:
        positions: Initial positions of the nodes [m], (nodes, 2) as x, z or (nodes, 3) as x, y, z.
        links: The two nodes of each link, (links, 2).
        masses: Masses of the nodes [kg], (nodes,) or one for all.
        stiffness: Stiffness of the springs [N/m], (links,) or one for all.
        damping: Coefficients of the dampers [N·s/m], (links,) or one for all.
        rest: Rest lengths of the springs [m], (links,); None for the initial distances.

    Raises:
        ParameterError: Shapes do not fit, the network is not connected, a link joins a node to
            itself, has zero length or is duplicated, a mass is not positive, or a
            stiffness or damping is negative.
    """

    positions: np.ndarray
    links: np.ndarray
    masses: np.ndarray | float = 1.0
    stiffness: np.ndarray | float = 100.0
    damping: np.ndarray | float = 10.0
    rest: np.ndarray | None = None

    def __post_init__(self) -> None:
        positions = _finite("positions", np.array(self.positions, float))
        if positions.ndim != 2 or positions.shape[1] not in (2, 3) or len(positions) < 2:
            raise ParameterError(
                f"positions must be (nodes, 2) or (nodes, 3), 2 nodes at least, "
                f"got {positions.shape}"
            )
        links, order = _sorted_links(self.links, len(positions))
        length = np.linalg.norm(positions[links[:, 1]] - positions[links[:, 0]], axis=1)
        _require("link", length <= 1e-9, length, "has no length [m]; its nodes must differ", links)
        rest_lengths = length if self.rest is None else _each("rest", self.rest, len(links))[order]
        _require(
            "rest length of link", rest_lengths <= 0.0, rest_lengths, "must be positive [m]", links
        )
        masses = _each("masses", self.masses, len(positions))
        _require("mass of node", masses <= 0.0, masses, "must be positive [kg]")
        stiffness = _each("stiffness", self.stiffness, len(links))[order]
        _require("stiffness of link", stiffness < 0.0, stiffness, "must be 0 or more [N/m]", links)
        damping = _each("damping", self.damping, len(links))[order]
        _require("damping of link", damping < 0.0, damping, "must be 0 or more [N·s/m]", links)
        _check_connected(links, len(positions))
        checked = {
            "positions": positions,
            "links": links,
            "masses": masses,
            "stiffness": stiffness,
            "damping": damping,
            "rest": rest_lengths,
        }
        for name, values in checked.items():
            object.__setattr__(self, name, values)

    def centre_of_mass(self, position: np.ndarray) -> np.ndarray:
        """Centre of mass of the nodes at positions (…, nodes, axes) [m], (…, axes)."""
        return np.sum(self.masses[:, None] * position, axis=-2) / self.masses.sum()

    @property
    def nodes(self) -> int:
        """Number of nodes, I."""
        return len(self.positions)

    @property
    def count(self) -> int:
        """Number of links, J."""
        return len(self.links)

    @property
    def dimension(self) -> int:
        """Number of axes, 2 or 3; the last axis points up."""
        return self.positions.shape[1]


def chain(params: MsdParams | None = None) -> Network:
    """Network of section 4.1.1: nodes in a row, each joined to its nearest neighbours.

    Nodes 0, 2, 4 … lie on an arch, the others on the ground; in three dimensions they are
    also spread sideways, alternating left, middle, right.
    """
    p = params or MsdParams()
    i = np.arange(p.nodes)
    x = (i - p.nodes / 2 + 0.5) * p.spacing
    z = (i % 2 == 0) * p.height * (1.0 - (2.0 * x / (p.nodes * p.spacing)) ** 2)
    y = (i % 3 - 1.0) * p.width
    axes = (x, z) if p.dimension == 2 else (x, y, z)
    pairs = [(a, b) for a in i for b in range(a + 1, min(a + p.connections // 2, p.nodes - 1) + 1)]
    mass = p.total_mass / p.nodes if p.total_mass else p.mass
    return Network(np.stack(axes, axis=1), np.array(pairs), mass, p.stiffness, p.damping)


def _finite(name: str, values: np.ndarray) -> np.ndarray:
    if not np.all(np.isfinite(values)):
        raise ParameterError(f"{name} must be finite numbers")
    return values


def _each(name: str, values: np.ndarray | float, count: int) -> np.ndarray:
    """Array with one value per node or link, (count,)."""
    values = _finite(name, np.array(values, float))
    if values.ndim == 0:
        return np.full(count, float(values))
    if values.shape != (count,):
        raise ParameterError(f"{name} must have {count} values, got shape {values.shape}")
    return values


def _require(
    what: str, invalid: np.ndarray, values: np.ndarray, text: str, links: np.ndarray | None = None
) -> None:
    if invalid.any():
        i = int(np.argmax(invalid))
        name = f"{i}" if links is None else f"{i} (nodes {links[i, 0]} and {links[i, 1]})"
        raise ParameterError(f"{what} {name} {text}, got {values[i]:g}")


def _sorted_links(links: Sequence, nodes: int) -> tuple[np.ndarray, np.ndarray]:
    """Links sorted by their ends, and the order that sorts them."""
    links = np.array(links)
    if links.ndim != 2 or links.shape[1] != 2 or not np.issubdtype(links.dtype, np.integer):
        raise ParameterError(
            f"links must be pairs of node numbers, (links, 2), got shape {links.shape}"
        )
    links = np.sort(links, axis=1)
    for i, (a, b) in enumerate(links):
        if a < 0 or b >= nodes:
            raise ParameterError(f"link {i} joins nodes {a} and {b}; there are 0 to {nodes - 1}")
        if a == b:
            raise ParameterError(f"link {i} joins node {a} to itself")
    order = np.lexsort((links[:, 1], links[:, 0]))
    links = links[order]
    duplicate = np.all(links[1:] == links[:-1], axis=1)
    if duplicate.any():
        a, b = links[int(np.argmax(duplicate))]
        raise ParameterError(f"nodes {a} and {b} are linked twice")
    return links, order


def _check_connected(links: np.ndarray, nodes: int) -> None:
    """Refuse a graph that is not connected, naming an unreachable node."""
    group = np.arange(nodes)
    for _ in range(nodes):
        low = np.minimum(group[links[:, 0]], group[links[:, 1]])
        before = group.copy()
        np.minimum.at(group, links[:, 0], low)
        np.minimum.at(group, links[:, 1], low)
        if np.array_equal(group, before):
            break
    if group.any():
        lost = int(np.argmax(group != 0))
        raise ParameterError(
            f"the network is not connected: no links lead from node 0 to node {lost}; "
            f"it has {len(np.unique(group))} parts"
        )
