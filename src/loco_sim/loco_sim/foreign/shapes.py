# SPDX-License-Identifier: Apache-2.0
"""Points on the surface of URDF shapes, in the frame of their link."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from ..mesh_files import mesh_path
from ..meshes.read import mesh_points
from ..robot.frames import numbers, origin_of

ROUND = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)


def link_points(link: ET.Element, folder: Path, kind: str = "collision") -> np.ndarray:
    """Points on the hull of all shapes of a link [m], (k, 3); none for unreadable shapes.

    Args:
        link: Element of the link.
        folder: Folder of relative mesh files.
        kind: ``collision`` or ``visual``.
    """
    parts = [np.zeros((0, 3))]
    for shape in link.findall(kind):
        rotation, offset = origin_of(shape)
        body = next(iter(shape.find("geometry")))
        parts.append(offset + _points(body, folder) @ rotation.T)
    return np.concatenate(parts)


def _points(body: ET.Element, folder: Path) -> np.ndarray:
    if body.tag == "box":
        signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        return 0.5 * signs * numbers(body, "size", "")
    if body.tag == "sphere":
        return float(body.get("radius")) * np.vstack([np.eye(3), -np.eye(3)])
    if body.tag in ("cylinder", "capsule"):
        radius, half_length = float(body.get("radius")), 0.5 * float(body.get("length"))
        half_length += radius if body.tag == "capsule" else 0.0
        rim = np.column_stack([radius * np.cos(ROUND), radius * np.sin(ROUND), 0.0 * ROUND])
        return np.vstack([rim + [0.0, 0.0, half_length], rim - [0.0, 0.0, half_length]])
    path = mesh_path(body.get("filename", ""), folder)
    return mesh_points(path) * numbers(body, "scale", "1 1 1") if path else np.zeros((0, 3))


def solid_inertia(mass: float, points: np.ndarray) -> np.ndarray:
    """Moments of inertia of a solid box that encloses points [kg·m²], (3,).

    Args:
        mass: Mass of the box [kg].
        points: Enclosed points [m], (k, 3); a cube of 5 cm if there are none.
    """
    sides = np.ptp(points, axis=0) if len(points) else np.full(3, 0.05)
    squares = np.maximum(sides, 0.005) ** 2
    return mass / 12.0 * (squares.sum() - squares)
