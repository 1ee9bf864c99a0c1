# SPDX-License-Identifier: Apache-2.0
"""Bodies and joints of a URDF as arrays, read with the standard library only.

Links behind fixed joints are merged with the link that carries them. The root is fixed to
the world, so that only moving bodies remain: body i is the child of joint i.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


@dataclass
class Tree:
    """Moving bodies and their joints, (n,); parents precede their children.

    Attributes:
        joints: Names of the joints.
        links: Names of the bodies, each the child of its joint.
        parent: Index of the parent body of each joint, -1 for the world, (n,).
        turn: Rotation from a body's frame at joint position 0 to its parent's frame, (n, 3, 3).
        place: Origin of the joint in the parent's frame [m], (n, 3).
        axis: Axis of the joint in the body's frame, (n, 3).
        slides: 1 for a prismatic joint, else 0, (n,).
        mass: Mass of each body [kg], (n,).
        com: Centre of mass in the body's frame [m], (n, 3).
        inertia: Inertia about the centre of mass in the body's frame [kg·m²], (n, 3, 3).
        armature: Rotor inertia at the joint [kg·m²], (n,).
        damping: Viscous damping of the joint [N·m·s/rad], (n,).
        effort: Torque limit [N·m], inf for none, (n,).
        lower: Lower position limits [rad], (n,); `upper` are the upper ones.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...]
    parent: np.ndarray
    turn: np.ndarray
    place: np.ndarray
    axis: np.ndarray
    slides: np.ndarray
    mass: np.ndarray
    com: np.ndarray
    inertia: np.ndarray
    damping: np.ndarray
    effort: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    armature: np.ndarray = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not len(self.armature):
            self.armature = np.zeros(len(self.joints))

    def add_point(self, link: str, mass: float, at: Sequence[float]) -> None:
        """Attach a point mass [kg] to a link at a position in the link's frame [m]."""
        i, at = self.links.index(link), np.asarray(at, float)
        _join(self, i, mass, at, np.zeros((3, 3)))

    def move_com(self, link: str, by: Sequence[float]) -> None:
        """Shift the centre of mass of a link [m]; mass and inertia about it are unchanged."""
        self.com[self.links.index(link)] += np.asarray(by, float)


def read(path: str | Path, joints: Sequence[str]) -> Tree:
    """Moving part of a URDF.

    Args:
        path: URDF file, or the text of one.
        joints: Movable joints in the order of the result. All others are fixed at 0 or, if they
            carry no movable joint, left out with all their links.
    """
    root = ET.fromstring(path) if str(path).startswith("<") else ET.parse(path).getroot()
    links = {link.get("name"): link for link in root.findall("link")}
    up = {j.find("child").get("link"): j for j in root.findall("joint")}
    order = _sorted(list(joints), up)
    moving = [next(j for j in up.values() if j.get("name") == name) for name in order]
    heads = [j.find("child").get("link") for j in moving]
    n = len(order)
    tree = Tree(
        tuple(order), tuple(heads), np.full(n, -1), np.zeros((n, 3, 3)), np.zeros((n, 3)),
        np.zeros((n, 3)), np.array([j.get("type") == "prismatic" for j in moving], float),
        np.zeros(n), np.zeros((n, 3)), np.zeros((n, 3, 3)), np.zeros(n), np.full(n, np.inf),
        np.full(n, -np.inf), np.full(n, np.inf),
    )  # fmt: skip
    for i, joint in enumerate(moving):
        head, turn, place = _carrier(joint.find("parent").get("link"), up, heads, *_pose(joint))
        tree.parent[i] = heads.index(head) if head else -1
        tree.turn[i], tree.place[i] = turn, place
        tree.axis[i] = _numbers(joint.find("axis"), "xyz", "1 0 0")
        _limits(tree, i, joint)
    for name, link in links.items():
        head, turn, place = _carrier(name, up, heads, np.eye(3), np.zeros(3))
        body = link.find("inertial")
        if head and body is not None:
            spin, at = _pose(body)
            _join(tree, heads.index(head), *_weight(body, turn @ spin, place + turn @ at))
    return tree


def _sorted(names: list[str], up: dict) -> list[str]:
    """The names unchanged, after a check that parents precede their children."""
    in_tree = [j.get("name") for j in up.values()]
    if strange := [name for name in names if name not in in_tree]:
        raise KeyError(f"no joint {strange[0]} in the URDF; it has {', '.join(in_tree)}")
    return names


def _carrier(link: str, up: dict, heads: list[str], turn: np.ndarray, place: np.ndarray) -> tuple:
    """Moving body that carries a link ("" is the world), and the link's pose in that body."""
    while link not in heads:
        if link not in up:
            return "", turn, place
        joint = up[link]
        if joint.get("type") != "fixed":
            # A joint that is not requested: its links are not part of the machine.
            return "", turn, place
        spin, at = _pose(joint)
        turn, place, link = spin @ turn, at + spin @ place, joint.find("parent").get("link")
    return link, turn, place


def _weight(body: ET.Element, turn: np.ndarray, at: np.ndarray) -> tuple:
    mass = float(body.find("mass").get("value"))
    i = {k: float(v) for k, v in body.find("inertia").attrib.items()}
    tensor = np.array(
        [
            [i["ixx"], i["ixy"], i["ixz"]],
            [i["ixy"], i["iyy"], i["iyz"]],
            [i["ixz"], i["iyz"], i["izz"]],
        ]
    )
    return mass, at, turn @ tensor @ turn.T


def _join(tree: Tree, i: int, mass: float, at: np.ndarray, inertia: np.ndarray) -> None:
    """Add a rigid mass to body i."""
    total = tree.mass[i] + mass
    if total <= 0.0:
        return
    centre = (tree.mass[i] * tree.com[i] + mass * at) / total
    both = tree.inertia[i] + inertia
    for m, c in ((tree.mass[i], tree.com[i]), (mass, at)):
        d = c - centre
        both = both + m * (d @ d * np.eye(3) - np.outer(d, d))
    tree.mass[i], tree.com[i], tree.inertia[i] = total, centre, both


def _limits(tree: Tree, i: int, joint: ET.Element) -> None:
    limit, dynamics = joint.find("limit"), joint.find("dynamics")
    if dynamics is not None:
        tree.damping[i] = float(dynamics.get("damping", 0.0))
    if limit is not None:
        tree.effort[i] = float(limit.get("effort", np.inf)) or np.inf
        if joint.get("type") != "continuous":
            tree.lower[i] = float(limit.get("lower", -np.inf))
            tree.upper[i] = float(limit.get("upper", np.inf))


def _numbers(element: ET.Element | None, key: str, default: str) -> np.ndarray:
    text = default if element is None else element.get(key, default)
    return np.array([float(x) for x in text.split()])


def _pose(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of an element's origin; rpy are rotations about fixed axes x, y, z."""
    origin = element.find("origin")
    r, p, y = _numbers(origin, "rpy", "0 0 0")
    cr, sr, cp, sp, cy, sy = np.cos(r), np.sin(r), np.cos(p), np.sin(p), np.cos(y), np.sin(y)
    about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x, _numbers(origin, "xyz", "0 0 0")
