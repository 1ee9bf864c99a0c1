# SPDX-License-Identifier: Apache-2.0
"""Random uneven or soft ground, as grids that are the same for every engine."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

RELIEFS = ("uneven", "steps")
CELL = 0.05  # distance between heights [m]
AHEAD, REAR, SIDE = 30.0, 4.0, 4.0  # extent from the origin [m]
BLEND = 0.5  # distance over which roughness rises from zero at the flat start [m]


@dataclass(frozen=True)
class Terrain:
    """Random heights around zero, flat around the origin where the robot starts.

    Attributes:
        kind: ``uneven``, smooth hills, or ``steps``, flat tiles at different heights.
        roughness: Standard deviation of the height [m].
        length: Size of hills, their correlation length, or of tiles [m].
        pattern: Number of the random pattern.
        radius: Radius of the flat start [m].
    """

    kind: str
    roughness: float
    length: float
    pattern: int
    radius: float

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the grid x, y [m]."""
        return 0.5 * (AHEAD - REAR), 0.0

    @cached_property
    def heights(self) -> np.ndarray:
        """Heights [m], (points along y, points along x)."""
        x, y = _axes()
        rng = np.random.default_rng([self.pattern, RELIEFS.index(self.kind)])
        if self.kind == "steps":
            tiles = rng.uniform(-1.0, 1.0, (len(y), len(x)))
            row, column = (np.floor((v - v[0]) / self.length).astype(int) for v in (y, x))
            relief = np.sqrt(3.0) * tiles[np.ix_(row, column)]
        else:
            relief = _hills(rng, self.length)
            relief /= relief.std()
        return self.roughness * relief * np.clip(_outside(self.radius) / BLEND, 0.0, 1.0)


@dataclass(frozen=True)
class Patches:
    """Random soft patches of the ground, none around the origin where the robot starts.

    Attributes:
        share: Share of the ground that is soft, beyond the start.
        length: Size of patches, the correlation length of the underlying random field [m].
        pattern: Number of the random pattern.
        radius: Radius of the firm start [m].
    """

    share: float
    length: float
    pattern: int
    radius: float

    @cached_property
    def soft(self) -> np.ndarray:
        """Flags of the grid of `Terrain`, (points along y, points along x)."""
        level = _hills(np.random.default_rng([self.pattern, len(RELIEFS)]), self.length)
        return (level > np.quantile(level, 1.0 - self.share)) & (_outside(self.radius) > 0.0)

    def under(self, x: float, y: float) -> bool:
        """Whether the ground is soft at x, y [m]; outside of the grid as at its edge."""
        rows, columns = self.soft.shape
        row = min(max(round((y + SIDE) / CELL), 0), rows - 1)
        column = min(max(round((x + REAR) / CELL), 0), columns - 1)
        return bool(self.soft[row, column])


def _axes() -> tuple[np.ndarray, np.ndarray]:
    """Coordinates of the grid along x and y [m]."""
    x = np.arange(round((AHEAD + REAR) / CELL) + 1) * CELL - REAR
    return x, np.arange(round(2.0 * SIDE / CELL) + 1) * CELL - SIDE


def _outside(radius: float) -> np.ndarray:
    """Distance of each grid point from a circle around the origin [m], negative inside."""
    return np.hypot(*np.meshgrid(*_axes())) - radius


def _hills(rng: np.random.Generator, length: float) -> np.ndarray:
    """Random heights on the grid, with autocorrelation exp(-(d / length)²) at distance d."""
    x, y = _axes()
    noise, cells = rng.standard_normal((len(y), len(x))), length / CELL
    frequencies = np.meshgrid(*(np.fft.fftfreq(n) for n in noise.shape), indexing="ij")
    square = sum(f**2 for f in frequencies)
    return np.fft.ifft2(np.fft.fft2(noise) * np.exp(-0.5 * (np.pi * cells) ** 2 * square)).real
