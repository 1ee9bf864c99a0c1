# SPDX-License-Identifier: Apache-2.0
"""The moving links of a fixed-base robot as arrays, for `dynamics`.

Links with fixed joints are merged into their parents. A joint's frame is that of its child
link at position 0; all vectors of a link are in that frame.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from loco_control.exceptions import ParameterError

from ..robot.clearance import MOVES, SLIDES
from ..robot.description import TENSOR, Description, add_point_mass
from ..robot.frames import numbers, origin_of
from ..robot.urdf_check import inertia_matrix

# Columns of `Tree.body`: vectors have three, matrices nine, by rows. Numbers of NumPy, as numba
# compiles a kernel for each literal that it is called with.
PLACE, TURN = np.array([0, 3])  # origin [m], rotation of the joint's frame in that of the parent
AXIS, MASS, COM, INERTIA = np.array([12, 15, 16, 19])  # unit axis; [kg]; [m]; [kg·m²]
DAMPING, LOW, HIGH = 28, 29, 30  # viscous [N·m·s/rad]; smallest and largest position [rad or m]
ARMATURE = 31  # inertia of rotor and gear about the joint [kg·m²]
IMPLICIT = 32  # damping that is taken from the speed after a step [N·m·s/rad]

# Joints between the world and a free base, from the world outwards: three slide along the world
# axes, three turn about the axes of the base. The pose is stored in the frames of the first and
# the fourth, so that these joints are at 0 at every step.
FREE = tuple(f"loco_base_{direction}" for direction in ("x", "y", "z", "roll", "pitch", "yaw"))


class Tree(NamedTuple):
    """Joints from the base outwards, each with the link it moves; n joints.

    In few arrays, since each array argument of a compiled function costs time.
    """

    kin: np.ndarray  # index of the parent joint, -1 for the base; 1 if the joint slides, (n, 2)
    body: np.ndarray  # columns `PLACE` to `IMPLICIT`, (n, 33)
    fastest: float  # limit of joint velocities, as in the engine [rad/s or m/s]


class Frame(NamedTuple):
    """Location of a link of the description in the tree."""

    body: int  # joint of the body that contains the link, -1 for the base
    place: np.ndarray  # origin of the link in the frame of that body [m], (3,)
    turn: np.ndarray  # rotation from the link frame to the body frame, (3, 3)


def build(
    description: Description, joints: tuple[str, ...], free: bool = False
) -> tuple[Tree, np.ndarray, dict[str, Frame]]:
    """Tree of all moving joints of a robot.

    Args:
        description: The robot.
        joints: Names of its moving joints.
        free: Whether the base is free; the joints `FREE` then come first.

    Returns:
        The tree; for each of its joints the index in `joints` followed by `FREE`, (n,); and the
        frames of all links.

    Raises:
        ParameterError: The inertia of a moving link is physically impossible, or `joints` is not
            the set of moving joints.
    """
    walk = _Walk(description, free)
    joints = (*joints, *FREE) if free else joints
    if sorted(walk.names) != sorted(joints):
        invalid = sorted(set(walk.names) ^ set(joints))
        raise ParameterError(f"joints must list all that move, and no others: {', '.join(invalid)}")
    order = np.array([joints.index(name) for name in walk.names], dtype=np.int64)
    for name, mass, inertia in zip(walk.names, walk.mass, walk.inertia, strict=True):
        moments = np.linalg.eigvalsh(inertia)
        if name in FREE[:-1]:  # only the last of these joints has a link with mass
            continue
        if not mass > 0.0 or moments[0] <= 0.0 or moments[2] > moments[0] + moments[1] + 1e-9:
            raise ParameterError(f"what joint {name} moves has no inertia that a body can have")
    body = [
        walk.place,
        np.reshape(walk.turn, (-1, 9)),
        walk.axis,
        np.reshape(walk.mass, (-1, 1)),
        walk.com,
        np.reshape(walk.inertia, (-1, 9)),
        [_rubbing(description, name) for name in walk.names],
        np.zeros((len(walk.names), 2)),
    ]
    kin = np.array([walk.parent, walk.slides], dtype=np.int64).T
    tree = Tree(np.ascontiguousarray(kin), np.hstack(body), description.fastest())
    return tree, order, walk.frames


def geared(
    tree: Tree, order: np.ndarray, joints: Sequence[str], armature: Mapping[str, float]
) -> Tree:
    """The tree of a fixed-base robot, with rotor inertia added to some joints.

    Args:
        tree: Tree of the robot.
        order: Index of each of its joints in `joints`, (n,).
        joints: Names of the robot's joints.
        armature: Rotor inertia at the joint [kg·m²], by name.
    """
    body = tree.body.copy()
    body[:, ARMATURE] = [armature.get(joints[i], 0.0) for i in order]
    return tree._replace(body=body)


def damped(tree: Tree) -> Tree:
    """The tree with damping of its joints that is taken from the speed after a step."""
    body = tree.body.copy()
    body[:, IMPLICIT] = body[:, DAMPING]
    return tree._replace(body=body)


def _rubbing(description: Description, joint: str) -> tuple[float, float, float]:
    """Viscous damping of a joint, and its lower and upper limit."""
    if joint in FREE:
        return 0.0, -math.inf, math.inf
    return description.damping(joint), *description.limits(joint)


class _Walk:
    """Traversal of a description from the root outwards."""

    def __init__(self, description: Description, free: bool):
        self._links = {e.get("name"): e for e in description.elements("link")}
        self._children: dict[str, list[Any]] = {}
        for joint in description.elements("joint"):
            self._children.setdefault(joint.find("parent").get("link"), []).append(joint)
        self.names, self.parent, self.slides = [], [], []
        self.place, self.turn, self.axis = [], [], []
        self.mass, self.com, self.inertia = [], [], []
        self.frames: dict[str, Frame] = {}
        for k, name in enumerate(FREE if free else ()):
            self._join(name, k - 1, k < 3, (np.zeros(3), np.eye(3)), np.eye(3)[k % 3])
        self._visit(description.root_link(), len(self.names) - 1, np.zeros(3), np.eye(3))

    def _join(self, name: str, parent: int, slides: bool, frame: tuple, axis: np.ndarray) -> None:
        """Append a joint whose body has no mass yet."""
        self.names.append(name)
        self.parent.append(parent)
        self.slides.append(slides)
        self.place.append(frame[0])
        self.turn.append(frame[1])
        self.axis.append(axis)
        self.mass.append(0.0)
        self.com.append(np.zeros(3))
        self.inertia.append(np.zeros((3, 3)))

    def _visit(self, link: str, carrier: int, place: np.ndarray, turn: np.ndarray) -> None:
        """Add a link fixed to the body of joint `carrier` at a pose, and its descendants."""
        self.frames[link] = Frame(carrier, place, turn)
        if carrier >= 0:
            self._add(self._links[link], carrier, place, turn)
        for joint in self._children.get(link, ()):
            rotation, offset = origin_of(joint)
            at, facing = place + turn @ offset, turn @ rotation
            child = joint.find("child").get("link")
            if joint.get("type") not in MOVES:
                self._visit(child, carrier, at, facing)
                continue
            along = numbers(joint.find("axis"), "xyz", "1 0 0")
            slides, axis = joint.get("type") == SLIDES, along / np.linalg.norm(along)
            self._join(joint.get("name"), carrier, slides, (at, facing), axis)
            self._visit(child, len(self.names) - 1, np.zeros(3), np.eye(3))

    def _add(self, link: Any, to: int, place: np.ndarray, turn: np.ndarray) -> None:
        """Merge mass and inertia of a link into the body of a joint."""
        inertial = link.find("inertial")
        if inertial is None:
            return
        mass = float(inertial.find("mass").get("value", 0.0))
        rotation, offset = origin_of(inertial)
        attributes = inertial.find("inertia")
        tensor = inertia_matrix([float(attributes.get(key, 0.0)) for key in TENSOR])
        facing, at = turn @ rotation, place + turn @ offset
        if mass <= 0.0:
            return
        added = self.mass[to], self.com[to], self.inertia[to]
        total, com, inertia = add_point_mass(*added, mass, at) if added[0] else (mass, at, 0.0)
        self.mass[to], self.com[to] = total, com
        self.inertia[to] = inertia + facing @ tensor @ facing.T
