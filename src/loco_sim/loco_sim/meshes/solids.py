# SPDX-License-Identifier: Apache-2.0
"""Triangles of simple solids around the origin, for pictures: surfaces of revolution about z."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

SECTIONS = 24  # of a full turn, of round solids


def revolved(
    radii: np.ndarray, heights: np.ndarray, sections: int = SECTIONS, start: float = 0.0
) -> np.ndarray:
    """Triangles, (t, 3, 3), of a profile turned about z: radii and heights [m], (n,).

    Args:
        radii: Radius of the solid at each corner of the profile [m], (n,).
        heights: Height of each corner [m], (n,).
        sections: Number of sides.
        start: Angle of the first edge [rad].
    """
    angles = start + np.linspace(0.0, 2.0 * math.pi, sections + 1)[:, None]
    rings = [radii * np.cos(angles), radii * np.sin(angles), heights + 0.0 * angles]
    corners = np.stack(rings, axis=-1)  # (sections + 1, n, 3)
    one, other = corners[:-1], corners[1:]
    sides = [one[:, :-1], other[:, :-1], other[:, 1:], one[:, :-1], other[:, 1:], one[:, 1:]]
    triangles = np.stack(sides, axis=-2).reshape(-1, 3, 3)
    edges = triangles[:, 1:] - triangles[:, :1]
    return triangles[np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) > 0.0]


def cylinder(radius: float, length: float, sections: int = SECTIONS) -> np.ndarray:
    """Triangles of a closed cylinder along z, (t, 3, 3); radius and length [m]."""
    top = 0.5 * length
    radii, heights = np.array([0.0, radius, radius, 0.0]), np.array([-top, -top, top, top])
    return revolved(radii, heights, sections)


def box(size: Sequence[float]) -> np.ndarray:
    """Triangles of a box, (t, 3, 3); `size` along x, y and z [m]."""
    radii, heights = np.array([0.0, 1.0, 1.0, 0.0]), np.array([-0.5, -0.5, 0.5, 0.5])
    square = revolved(math.sqrt(0.5) * radii, heights, 4, 0.25 * math.pi)
    return square * np.asarray(size)


def capsule(radius: float, length: float = 0.0) -> np.ndarray:
    """Triangles of a sphere [m], (t, 3, 3), or of one pulled apart along z by `length`."""
    slope = np.linspace(-0.5 * math.pi, 0.5 * math.pi, SECTIONS // 2)  # an even number
    radii, heights = np.cos(slope), radius * np.sin(slope) + 0.5 * length * np.sign(slope)
    radii[[0, -1]] = 0.0  # not 6e-17
    return revolved(radius * radii, heights)
