# SPDX-License-Identifier: Apache-2.0
"""Distance of a bolted robot from the ground over all poses, and a base height that keeps one."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..mesh_files import mesh_path
from ..meshes.read import mesh_points
from .description import Description
from .frames import numbers, origin_of

SLIDES = "prismatic"
MOVES = ("revolute", "continuous", SLIDES)
SPACE = 0.1  # distance to the ground below all poses of a bolted robot without a stated height [m]


def base_height(description: Description, folder: Path) -> float | None:
    """Height of the base at which no pose touches the ground [m]; None if a shape is unknown."""
    lowest = clearance(description, 0.0, folder)
    return height_above(lowest) if lowest > -math.inf else None


def height_above(lowest: float, space: float = SPACE) -> float:
    """Base height [m], in tenths, with `space` below the lowest point relative to the base [m]."""
    return float(np.ceil(10.0 * (space - min(0.0, lowest))) / 10.0)


def clearance(description: Description, height: float, folder: Path) -> float:
    """Lower bound of the distance between moving links and the ground, over all poses [m].

    Outwards of a revolute joint, all lengths are assumed to point down.

    Args:
        description: The robot, with fixed base.
        height: Height of the base [m].
        folder: Folder of relative mesh files.
    """
    children: dict[str, list[Any]] = {}
    for joint in description.elements("joint"):
        children.setdefault(joint.find("parent").get("link"), []).append(joint)
    shapes = {e.get("name"): e.findall("collision") for e in description.elements("link")}

    def lowest(link: str, at: float, down: np.ndarray, swung: bool, moves: bool) -> float:
        """Height of the lowest point of a link and its descendants; `down` is the world's z."""
        heights = min(
            [at - _extent(s, folder) for s in shapes[link]] if moves else [], default=math.inf
        )
        for joint in children.get(link, ()):
            rotation, offset = origin_of(joint)
            kind, facing = joint.get("type"), down @ rotation
            drop = float(np.linalg.norm(offset)) if swung else -float(down @ offset)
            if kind == SLIDES:
                axis = numbers(joint.find("axis"), "xyz", "1 0 0")
                travel = max(map(abs, description.limits(joint.get("name"))))
                part = 1.0 if swung else abs(float(facing @ axis)) / float(np.linalg.norm(axis))
                drop += travel * part if part > 1e-9 else 0.0
            swings = swung or kind in ("revolute", "continuous")
            child = joint.find("child").get("link")
            heights = min(heights, lowest(child, at - drop, facing, swings, moves or kind in MOVES))
        return heights

    return lowest(description.root_link(), height, np.array([0.0, 0.0, 1.0]), False, False)


def _extent(collision: Any, folder: Path) -> float:
    """Largest distance of a shape from the origin of its link [m]; infinite if unknown."""
    _, offset = origin_of(collision)
    shape = next(iter(collision.find("geometry")))
    if shape.tag == "sphere":
        size = float(shape.get("radius"))
    elif shape.tag == "box":
        size = 0.5 * float(np.linalg.norm(numbers(shape, "size", "")))
    elif shape.tag == "cylinder":
        size = math.hypot(float(shape.get("radius")), 0.5 * float(shape.get("length")))
    elif shape.tag == "capsule":
        size = float(shape.get("radius")) + 0.5 * float(shape.get("length"))
    else:
        path = mesh_path(shape.get("filename", ""), folder)
        points = np.zeros((0, 3)) if path is None else mesh_points(path)
        if not len(points):
            return math.inf
        size = float(np.linalg.norm(points * numbers(shape, "scale", "1 1 1"), axis=1).max())
    return float(np.linalg.norm(offset)) + size
