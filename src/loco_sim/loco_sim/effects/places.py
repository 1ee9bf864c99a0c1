# SPDX-License-Identifier: Apache-2.0
"""Possible locations of an effect on a robot: joints, groups of corresponding joints, links."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import defaultdict
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ..robot.description import Description

if TYPE_CHECKING:
    from ..robot.robot import Robot


AMONG = {  # classes of joints that an effect may act on
    "all": "joint",
    "driven": "joint with a drive",
    "limited": "joint with a drive and a torque limit",
    "turning": "joint that turns",
    "sprung": "joint with a spring in robot.yaml",
    "followed": "joint with one other joint next to it outwards",
}


def eligible(robot: Robot, among: str) -> np.ndarray:
    """Indices of the joints of a class in `AMONG`, (k,)."""
    if among == "all":
        return np.arange(len(robot.joints))
    if among == "turning":
        return turning(robot)
    if among == "followed":
        return np.flatnonzero(outward(robot) >= 0)
    if among == "sprung":
        return np.flatnonzero([joint in robot.springs for joint in robot.joints])
    driven = np.asarray(robot.driven, dtype=np.int64)
    return driven if among == "driven" else driven[np.isfinite(robot.effort[driven])]


def outward(robot: Robot) -> np.ndarray:
    """Index of the next joint outwards of each joint, (n,); -1 if there is none or several."""
    return np.array(_outward(robot.urdf, robot.joints))


def turning(robot: Robot) -> np.ndarray:
    """Indices of the revolute joints, (k,)."""
    return np.array(_turning(robot.urdf, robot.joints), dtype=np.int64)


@lru_cache(maxsize=64)
def _outward(urdf: str, joints: tuple[str, ...]) -> tuple[int, ...]:
    text, outer = Description(urdf), [-1] * len(joints)
    below = [set(text.below(text.child(joint))) for joint in joints]
    for i, tree in enumerate(below):
        after = [j for j, joint in enumerate(joints) if j != i and text.child(joint) in tree]
        links = {j: text.child(joints[j]) for j in after}
        firsts = [j for j in after if sum(links[j] in below[k] for k in after) == 1]
        if len(firsts) == 1:
            outer[i] = firsts[0]
    return tuple(outer)


@lru_cache(maxsize=64)
def _turning(urdf: str, joints: tuple[str, ...]) -> tuple[int, ...]:
    joint_types = Description(urdf).joint_types()
    return tuple(j for j, joint in enumerate(joints) if joint_types[joint] != "prismatic")


def chains(robot: Robot) -> list[list[str]]:
    """Joints of each branch that leaves the base, from the base outwards."""
    text = Description(robot.urdf)
    children = {joint: text.below(text.child(joint)) for joint in robot.joints}
    depth = {
        joint: sum(text.child(joint) in below for below in children.values())
        for joint in robot.joints
    }
    first = [joint for joint in robot.joints if depth[joint] == 1]
    return [[j for j in robot.joints if text.child(j) in children[root]] for root in first]


def groups(robot: Robot) -> list[list[str]]:
    """Groups of corresponding joints of all branches: all hips, all knees."""
    by_depth = defaultdict(list)
    for chain in chains(robot):
        for depth, joint in enumerate(chain):
            by_depth[depth].append(joint)
    return list(by_depth.values())


def common(names: list[str], all_names: tuple[str, ...]) -> str:
    """Pattern that matches exactly the given names: their common ending, e.g. "*_kfe_joint"."""
    if set(names) == set(all_names):
        return "*"
    parts = [name.split("_") for name in names]
    tail = []
    for tokens in zip(*(reversed(p) for p in parts), strict=False):
        if len(set(tokens)) > 1:
            break
        tail.insert(0, tokens[0])
    end = "_".join(tail)
    matching = [name for name in all_names if name.endswith(f"_{end}")]
    return f"*_{end}" if end and sorted(matching) == sorted(names) else ""


def joint_places(robot: Robot, among: str) -> list[str]:
    """Single joints that an effect applies to, and patterns of groups of them."""
    fitting = [robot.joints[j] for j in eligible(robot, among)]
    grouped = [[j for j in group if j in fitting] for group in groups(robot)]
    patterns = [common(group, robot.joints) for group in grouped if len(group) > 1]
    return [*fitting, *filter(None, patterns)]


def members(robot: Robot, place: str) -> list[str]:
    """Joints at a location (name or pattern); all joints for ""."""
    return [joint for joint in robot.joints if fnmatchcase(joint, place or "*")]


def links(robot: Robot) -> list[tuple[str, tuple[float, ...]]]:
    """Links with mass that can move, with their centre of mass in the frame of the link [m]."""
    text = Description(robot.urdf)
    moving = set()
    for joint in robot.joints:
        moving |= set(text.below(text.child(joint)))
    rows = []
    for name in text.links():
        if (name in moving or not robot.fixed_base) and text.mass_of(name) > 0.0:
            rows.append((name, centre(robot, name)))
    return rows


def bodies(robot: Robot) -> list[str]:
    """Heaviest link of each moving rigid body, which includes all links fixed to each other."""
    text, able = Description(robot.urdf), {name for name, _ in links(robot)}
    firsts = [text.root_link(), *(text.child(joint) for joint in robot.joints)]
    groups = ([name for name in text.fixed_to(first) if name in able] for first in firsts)
    return [max(group, key=text.mass_of) for group in groups if group]


def centre(robot: Robot, link: str) -> tuple[float, ...]:
    """Centre of mass of a link in its frame [m]."""
    for element in ElementTree.fromstring(robot.urdf).iter("link"):
        if element.get("name") == link:
            origin = element.find("inertial/origin")
            text = "0 0 0" if origin is None else origin.get("xyz", "0 0 0")
            return tuple(float(v) for v in text.split())
    return (0.0, 0.0, 0.0)
