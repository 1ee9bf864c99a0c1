# SPDX-License-Identifier: Apache-2.0
"""Rendering of the visual shapes of a robot's URDF without an engine.

A `Figure` holds the shapes as triangles, moves them with the joints and draws them by a compiled
z-buffer. Shapes with unreadable meshes are omitted; a robot without shapes is drawn as sticks
between its joints and balls at its masses.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from math import ceil, floor
from pathlib import Path

import numpy as np
from numba import njit

from ..geometry import Triple, rotation_matrix
from ..mesh_files import mesh_path
from ..meshes import solids
from ..meshes.read import read_mesh
from ..robot.frames import link_frames, origin_of
from ..robot.robot import Robot
from ..robot.urdf_check import mass_of

GREY = (0.72, 0.74, 0.77)  # of shapes without a colour
AMBIENT, DIFFUSE = 0.62, 0.45  # intensities of ambient and directional light
THIN = 1e-3  # smallest radius and length of a drawn stick [m]
WATER = 1000.0  # density of the balls that represent masses [kg/m³]
NEAR_PLANE = 1e-3  # near plane: triangles with a corner behind it are not drawn


class Figure:
    """Visual shapes of a robot at a pose, which can be drawn.

    Args:
        robot: The robot; links without visual shapes show their collision shapes, and a robot
            without shapes is drawn by its joints and masses.
    """

    def __init__(self, robot: Robot):
        self._robot = robot
        root = ET.fromstring(robot.urdf)
        colours = {m.get("name"): m for m in root.findall("material")}
        self._links = [link.get("name", "") for link in root.findall("link")]
        drawn = [
            (index, _triangles(shape, robot.folder), _colour(shape, colours))
            for index, link in enumerate(root.findall("link"))
            for shape in link.findall("visual") or link.findall("collision")
        ]
        if not any(len(triangles) for _, triangles, _ in drawn):
            drawn = [(self._links.index(link), each, GREY) for link, each in _sticks(root)]
        corners, paints, owners = [], [], []
        for index, triangles, colour in drawn:
            corners.append(triangles)
            paints.append(np.tile(colour, (len(triangles), 1)))
            owners.append(np.full(len(triangles), index))
        self._corners = np.concatenate([np.zeros((0, 3, 3)), *corners])  # in the frame of the link
        self._paint = np.concatenate([np.zeros((0, 3)), *paints])
        self._owner = np.concatenate([np.zeros(0, dtype=int), *owners])
        self.pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), robot.standing)

    def shapes(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Triangles in the frame of the link [m], (t, 3, 3), and their colours, (t, 3), by link."""
        rows = {name: self._owner == i for i, name in enumerate(self._links)}
        return {n: (self._corners[r], self._paint[r]) for n, r in rows.items() if r.any()}

    def pose(self, position: Triple, orientation: Sequence[float], q: Sequence[float]) -> None:
        """Set the pose of the robot.

        Args:
            position: Origin of the base in the world [m].
            orientation: Base to world, x y z w.
            q: Joint positions [rad], (n,).
        """
        frames = link_frames(self._robot, np.asarray(q, dtype=float)[None])
        base = np.array(rotation_matrix(orientation)).reshape(3, 3)
        turns = np.array([base @ frames[link][0][0] for link in self._links])
        origins = np.array([base @ frames[link][1][0] + position for link in self._links])
        self._world = np.einsum("tij,tkj->tki", turns[self._owner], self._corners)
        self._world += origins[self._owner][:, None]

    def corners(self, margin: float = 0.08) -> np.ndarray:
        """Corners of bounding boxes of the shapes, world frame [m], (8 n, 3).

        Args:
            margin: Distance added on all sides [m].
        """
        points = self._world.reshape(-1, 3)
        if not len(points):
            return np.zeros((0, 3))
        sides = np.array([points.min(axis=0) - margin, points.max(axis=0) + margin])
        pick = np.indices((2, 2, 2)).reshape(3, 8)
        return sides[pick, np.arange(3)[:, None]].T

    def picture(
        self, view: np.ndarray, projection: np.ndarray, size: tuple[int, int], light: Triple
    ) -> tuple[np.ndarray, np.ndarray]:
        """Image of the robot alone, rendered in software.

        Args:
            view: World to camera, OpenGL convention, (4, 4).
            projection: Camera to clip space, (4, 4).
            size: Width and height [pixel].
            light: Direction towards the light, world frame.

        Returns:
            Colours (height, width, 3) in [0, 1] and mask of the robot (height, width) bool.
        """
        edges = self._world[:, 1:] - self._world[:, :1]
        normal = np.cross(edges[:, 0], edges[:, 1])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-30)
        sun = np.abs(normal @ np.asarray(light))  # both sides of a shape are lit
        paint = np.minimum(self._paint * (AMBIENT + DIFFUSE * sun)[:, None], 1.0)
        clip = np.concatenate([self._world, np.ones((len(self._world), 3, 1))], axis=2)
        clip = clip @ (projection @ view).T
        return rasterise(clip, paint, size[0], size[1])


def _sticks(root: ET.Element) -> Iterator[tuple[str, np.ndarray]]:
    """Link names, with triangles in the link frame [m], (t, 3, 3): sticks to joints and mass.

    A mass is drawn as a ball of water of that mass.
    """
    for joint in root.findall("joint"):
        end = origin_of(joint)[1]
        if np.linalg.norm(end) > THIN:
            yield joint.find("parent").get("link", ""), _stick(end)
    for link in root.findall("link"):
        if (mass := mass_of(link)) > 0.0:
            centre = origin_of(link.find("inertial"))[1]
            radius = (3.0 * mass / (4.0 * np.pi * WATER)) ** (1 / 3)
            yield link.get("name", ""), solids.capsule(radius) + centre
            if np.linalg.norm(centre) > THIN:
                yield link.get("name", ""), _stick(centre)


def _stick(end: np.ndarray) -> np.ndarray:
    """Triangles of a thin cylinder from the origin to a point [m], (t, 3, 3)."""
    length = float(np.linalg.norm(end))
    across = np.linalg.svd(end[None])[2][1:]  # two unit vectors that are orthogonal to it
    stick = solids.cylinder(max(0.04 * length, THIN), length, sections=12)
    return stick @ np.array([*across, end / length]) + 0.5 * end


def _triangles(shape: ET.Element, folder: Path) -> np.ndarray:
    """Corners of the triangles of a visual or collision element, frame of the link, (t, 3, 3)."""
    kind = next(iter(shape.find("geometry")), None)
    mesh = None if kind is None else _mesh(kind, folder)
    if mesh is None:
        return np.zeros((0, 3, 3))
    rotation, origin = origin_of(shape)
    return mesh @ rotation.T + origin


def _mesh(kind: ET.Element, folder: Path) -> np.ndarray | None:
    """Triangles of a box, sphere, cylinder, capsule or mesh file, (t, 3, 3)."""

    def number(key: str) -> float:
        return float(kind.get(key, "0"))

    if kind.tag == "box":
        return solids.box([float(v) for v in kind.get("size", "0 0 0").split()])
    if kind.tag == "sphere" and number("radius") == 0.0:  # a point, used as a toe
        return None
    if kind.tag == "sphere":
        return solids.capsule(number("radius"))
    if kind.tag == "cylinder":
        return solids.cylinder(number("radius"), number("length"))
    if kind.tag == "capsule":
        return solids.capsule(number("radius"), number("length"))
    if kind.tag != "mesh":
        return None
    name = kind.get("filename", "")
    file = mesh_path(name, folder) or folder / name
    mesh = read_mesh(file)
    if mesh is None:
        return None
    return np.asarray(mesh.triangles) * [float(v) for v in kind.get("scale", "1 1 1").split()]


def _colour(shape: ET.Element, named: dict) -> tuple[float, ...]:
    """Colour of a shape, (3,), from its own material or the robot's material of that name."""
    material = shape.find("material")
    if material is not None and material.find("color") is None:
        material = named.get(material.get("name"))
    colour = None if material is None else material.find("color")
    if colour is None:
        return GREY
    return tuple(float(v) for v in colour.get("rgba", "0.7 0.7 0.7 1").split()[:3])


@njit(cache=True)
def rasterise(clip, paint, width, height):
    """Draw triangles by a z-buffer.

    Args:
        clip: Corners in clip space, (t, 3, 4).
        paint: Colour of each triangle, (t, 3).
        width: Width [pixel].
        height: Height [pixel].

    Returns:
        Colours (height, width, 3) and mask of the triangles, (height, width) bool.
    """
    image = np.zeros((height, width, 3))
    depth = np.full((height, width), np.inf)
    x, y, z = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(clip)):
        clipped = False
        for k in range(3):
            w = clip[i, k, 3]
            if w < NEAR_PLANE:
                clipped = True
                break
            x[k] = (0.5 + 0.5 * clip[i, k, 0] / w) * width - 0.5
            y[k] = (0.5 - 0.5 * clip[i, k, 1] / w) * height - 0.5
            z[k] = clip[i, k, 2] / w
        if clipped:
            continue
        area = (x[1] - x[0]) * (y[2] - y[0]) - (x[2] - x[0]) * (y[1] - y[0])
        if area == 0.0:
            continue
        left, right = max(ceil(min(x[0], x[1], x[2])), 0), floor(max(x[0], x[1], x[2]))
        top, bottom = max(ceil(min(y[0], y[1], y[2])), 0), floor(max(y[0], y[1], y[2]))
        per = 1.0 / area
        for row in range(top, min(bottom + 1, height)):
            for column in range(left, min(right + 1, width)):
                a = per * ((x[1] - column) * (y[2] - row) - (x[2] - column) * (y[1] - row))
                if a < 0.0:
                    continue
                b = per * ((x[2] - column) * (y[0] - row) - (x[0] - column) * (y[2] - row))
                c = 1.0 - a - b
                if b < 0.0 or c < 0.0:
                    continue
                deep = a * z[0] + b * z[1] + c * z[2]
                if deep < depth[row, column]:
                    depth[row, column] = deep
                    for k in range(3):
                        image[row, column, k] = paint[i, k]
    return image, depth < np.inf
