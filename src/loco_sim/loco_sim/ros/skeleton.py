# SPDX-License-Identifier: Apache-2.0
"""Transforms of the links of a robot relative to their parents, for viewers."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np

from ..robot.frames import numbers

HINGES, SLIDES = ("revolute", "continuous"), ("prismatic",)


class Skeleton:
    """Transforms between the links of a URDF, computed for all joints at once.

    Args:
        robot: Robot with `urdf` and `joints`.

    Attributes:
        links: Parent and child link of each of the j joints of the URDF, in its order.
        base: Name of the root link.
    """

    def __init__(self, robot: Any):
        root = ElementTree.fromstring(robot.urdf)
        joints = root.findall("joint")
        self.links = [(j.find("parent").get("link"), j.find("child").get("link")) for j in joints]
        children = {child for _, child in self.links}
        names = [link.get("name") for link in root.findall("link")]
        self.base = next(name for name in names if name not in children)
        column = {name: i for i, name in enumerate(robot.joints)}
        self._origin = np.array([numbers(j.find("origin"), "xyz", "0 0 0") for j in joints])
        self._origin = self._origin.reshape(len(joints), 3)
        self._turn = _fixed_axes(
            np.array([numbers(j.find("origin"), "rpy", "0 0 0") for j in joints]).reshape(-1, 3)
        )
        axes = np.array([numbers(j.find("axis"), "xyz", "1 0 0") for j in joints]).reshape(-1, 3)
        axes = axes / np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-12)
        moving = [
            (row, column[j.get("name")], j.get("type"))
            for row, j in enumerate(joints) if j.get("name") in column
        ]  # fmt: skip
        self._hinges, self._hinge_columns = _pick(moving, HINGES)
        self._slides, self._slide_columns = _pick(moving, SLIDES)
        self._hinge_axes = axes[self._hinges]
        self._paths = _rotate(self._turn[self._slides], axes[self._slides])

    def pose(self, q: np.ndarray) -> np.ndarray:
        """Position x y z [m] and orientation x y z w of each child link in its parent, (j, 7).

        Args:
            q: Joint positions in the robot's order [rad, m], (n,).
        """
        out = np.concatenate((self._origin, self._turn), axis=1)
        half_angle = 0.5 * np.asarray(q)[self._hinge_columns, None]
        rotations = np.concatenate(
            (self._hinge_axes * np.sin(half_angle), np.cos(half_angle)), axis=1
        )
        out[self._hinges, 3:] = _product(self._turn[self._hinges], rotations)
        out[self._slides, :3] += self._paths * np.asarray(q)[self._slide_columns, None]
        return out


def _pick(moving: list, types: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Rows of the joints of some types, and their columns in the robot's order."""
    rows = [(row, column) for row, column, kind in moving if kind in types]
    return tuple(np.array(rows, dtype=int).reshape(-1, 2).T)


def _product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternion products of rows, (n, 4), x y z w: rotation by b, then by a."""
    av, aw, bv, bw = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.concatenate((vector, aw * bw - np.sum(av * bv, axis=1, keepdims=True)), axis=1)


def _fixed_axes(rpy: np.ndarray) -> np.ndarray:
    """Quaternions of roll, pitch and yaw about fixed axes, (n, 3) to (n, 4)."""
    half_angles = 0.5 * rpy[:, :, None]
    roll, pitch, yaw = (
        np.concatenate((axis * np.sin(half_angles[:, i]), np.cos(half_angles[:, i])), axis=1)
        for i, axis in enumerate(np.eye(3))
    )
    return _product(yaw, _product(pitch, roll))


def _rotate(turn: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors (n, 3) rotated by quaternions (n, 4)."""
    pure = np.concatenate((v, np.zeros((len(v), 1))), axis=1)
    back = turn * np.array([-1.0, -1.0, -1.0, 1.0])
    return _product(_product(turn, pure), back)[:, :3]
