# SPDX-License-Identifier: Apache-2.0
"""Memory layout of the data of a network or a population in the kernels' lanes."""

from __future__ import annotations

import numpy as np

from .lanes import WIDTH
from .network import Network


class Single:
    """Layout of one network: lanes are neighbouring nodes, and links between neighbours.

    Nodes are padded so that `WIDTH` of them can be read from any index.
    """

    def __init__(self, network: Network):
        self.nodes, self.axes = network.nodes, network.dimension
        self.blocks = -(-(network.nodes + WIDTH - 1) // WIDTH)
        runs = _runs(network.links)
        self.tail = np.array([run[0][0] for run in runs], np.int64)
        self.head = np.array([run[0][1] for run in runs], np.int64)
        numbers = {tuple(link): i for i, link in enumerate(network.links)}
        self.slots = np.full((len(runs), WIDTH), -1)
        for row, run in zip(self.slots, runs, strict=True):
            row[: len(run)] = [numbers[link] for link in run]

    def shape(self, values: np.ndarray) -> np.ndarray:
        """Rows of links, (parts * runs, WIDTH), from (parts, links); missing links get 0."""
        return self.links(values)

    def masses(self, masses: np.ndarray) -> np.ndarray:
        """Masses and their inverses; both are 0 for padding nodes, which therefore never move."""
        padded = np.zeros((2, self.blocks * WIDTH))
        padded[0, : self.nodes], padded[1, : self.nodes] = masses, 1.0 / masses
        return padded.reshape(-1, WIDTH)

    def links(self, values: np.ndarray) -> np.ndarray:
        """As `shape`, for values that are individual for each network."""
        rows = np.where(self.slots < 0, values.dtype.type(0), values[..., self.slots])
        return np.ascontiguousarray(rows.reshape(-1, WIDTH))

    def numbers(self, values: np.ndarray) -> np.ndarray:
        """Numbers of the network, unchanged, (n,)."""
        return np.array(values)

    def nodes_in(self, values: np.ndarray) -> np.ndarray:
        """Rows of nodes, (axes * blocks, WIDTH), from (nodes, axes)."""
        padded = np.zeros((self.axes, self.blocks * WIDTH))
        padded[:, : self.nodes] = values.T
        return padded.reshape(-1, WIDTH)

    def nodes_out(self, rows: np.ndarray) -> np.ndarray:
        """Inverse of `nodes_in`; leading axes are retained."""
        values = rows.reshape(*rows.shape[:-2], self.axes, self.blocks * WIDTH)
        return np.moveaxis(values[..., : self.nodes], -2, -1).copy()


class Blocks:
    """Layout of a population: lanes are networks; the last network is repeated to fill a block."""

    def __init__(self, network: Network, size: int):
        self.nodes, self.axes, self.size = network.nodes, network.dimension, size
        links = network.links
        self.tail = np.searchsorted(links[:, 0], np.arange(network.nodes + 1)).astype(np.int64)
        self.head = np.array(links[:, 1], np.int64)
        self.count = -(-size // WIDTH)
        self.who = np.minimum(np.arange(self.count * WIDTH), size - 1)

    def shape(self, values: np.ndarray) -> np.ndarray:
        """Numbers of the links, equal for all networks, (parts * links,)."""
        return values.reshape(-1).copy()

    def masses(self, masses: np.ndarray) -> np.ndarray:
        """Masses and their inverses, (2 * nodes,)."""
        return np.concatenate([masses, 1.0 / masses])

    def links(self, values: np.ndarray) -> np.ndarray:
        """Rows of links, (blocks, parts * links, WIDTH), from (networks, parts, links)."""
        return self.numbers(values.reshape(self.size, -1))

    def numbers(self, values: np.ndarray) -> np.ndarray:
        """Rows of numbers, (blocks, n, WIDTH), from (networks, n)."""
        lanes = values[self.who].reshape(self.count, WIDTH, -1)
        return np.ascontiguousarray(np.swapaxes(lanes, 1, 2))

    def nodes_in(self, values: np.ndarray) -> np.ndarray:
        """Rows of nodes, (blocks, axes * nodes, WIDTH), from (networks, nodes, axes)."""
        return self.numbers(np.swapaxes(values, 1, 2).reshape(self.size, -1))

    def nodes_out(self, rows: np.ndarray) -> np.ndarray:
        """Inverse of `nodes_in`; axes between blocks and rows are retained."""
        first = np.moveaxis(rows, -1, 1)  # (blocks, WIDTH, …, axes * nodes)
        values = first.reshape(-1, *first.shape[2:-1], self.axes, self.nodes)[: self.size]
        return np.swapaxes(values, -2, -1).copy()


def _runs(links: np.ndarray) -> list[list[tuple[int, int]]]:
    """Links grouped in runs (i, j), (i + 1, j + 1), … of at most `WIDTH`, sorted by j - i and i."""
    order = np.lexsort((links[:, 0], links[:, 1] - links[:, 0]))
    runs: list[list[tuple[int, int]]] = []
    for a, b in links[order]:
        last = runs[-1] if runs else []
        if last and len(last) < WIDTH and last[-1] == (a - 1, b - 1):
            last.append((int(a), int(b)))
        else:
            runs.append([(int(a), int(b))])
    return runs
