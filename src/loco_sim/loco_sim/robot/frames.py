# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics: poses of the links and feet of any robot, from its URDF and joint angles."""

from __future__ import annotations

import functools
import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from typing import Any

import numpy as np

Frames = tuple[np.ndarray, np.ndarray]  # rotation (T, 3, 3) and origin (T, 3), in the base frame


def feet_in_base(robot: Any, q: np.ndarray) -> np.ndarray:
    """Origins of the feet in the base frame [m], (T, f, 3).

    Args:
        robot: Robot with `urdf`, `joints` and `feet`.
        q: Joint positions [rad, m], (T, n).
    """
    frames = link_frames(robot, q, robot.feet)
    origins = [frames[foot][1] for foot in robot.feet]
    return np.stack(origins, axis=1) if origins else np.zeros((len(q), 0, 3))


def link_frames(robot: Any, q: np.ndarray, links: Sequence[str] = ()) -> dict[str, Frames]:
    """Frames of links in the base frame, by name.

    Args:
        robot: Robot with `urdf` and `joints`.
        q: Joint positions [rad, m], (T, n).
        links: Names of the links; all links if empty.
    """
    parent, all_links = _tree(robot.urdf)
    columns = {name: q[:, i] for i, name in enumerate(robot.joints)}
    by_name: dict[str, Frames] = {}
    for link in links or all_links:
        _frame(link, parent, columns, len(q), by_name)
    return by_name


@functools.lru_cache(maxsize=8)  # called for the same robot once per frame of an animation
def _tree(urdf: str) -> tuple[dict[str, ElementTree.Element], list[str]]:
    """Joint above each link, and the names of all links; read-only."""
    root = ElementTree.fromstring(urdf)
    parent = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    return parent, [element.get("name") for element in root.findall("link")]


def origin_of(element: ElementTree.Element) -> Frames:
    """Rotation (3, 3) and translation [m], (3,), of the ``origin`` of a URDF element."""
    place = element.find("origin")
    xyz, rpy = (numbers(place, key, "0 0 0") for key in ("xyz", "rpy"))
    return fixed_axes(rpy), xyz


def zero_frames(description: Any) -> dict[str, Frames]:
    """Rotation (3, 3) and origin [m], (3,), of every link in the base frame at the zero pose.

    Args:
        description: A `Description`.
    """
    parent = {joint.find("child").get("link"): joint for joint in description.elements("joint")}
    by_name: dict[str, Frames] = {}
    for link in description.links():
        _frame(link, parent, {}, 1, by_name)
    return {link: (rotation[0], origin[0]) for link, (rotation, origin) in by_name.items()}


def inertia_along(description: Any, joint: str) -> float:
    """Inertia of all links behind a joint about its axis [kg·m²], or their mass [kg] if it slides.

    Args:
        description: A `Description`.
        joint: Name of the joint; joints behind it are at zero.
    """
    links = [x for x in description.below(description.child(joint)) if description.mass_of(x) > 0.0]
    if description.joint_types()[joint] == "prismatic":
        return float(sum(map(description.mass_of, links)))
    frames, total = zero_frames(description), 0.0
    rotation, origin = frames[description.child(joint)]
    axis = rotation @ description.axis(joint)
    axis /= np.linalg.norm(axis)
    for link in links:
        rotation, place = frames[link]
        inertia, centre = description.inertia_of(link), description.centre_of(link)
        arm = np.cross(axis, place + rotation @ centre - origin)
        total += axis @ rotation @ inertia @ rotation.T @ axis
        total += description.mass_of(link) * float(arm @ arm)
    return float(total)


def _frame(link: str, parent: dict, columns: dict, ticks: int, done: dict[str, Frames]) -> Frames:
    """Frame of a link, from that of its parent and the joint between them."""
    if link in done:
        return done[link]
    if link not in parent:
        frame = np.broadcast_to(np.eye(3), (ticks, 3, 3)), np.zeros((ticks, 3))
    else:
        joint = parent[link]
        before = _frame(joint.find("parent").get("link"), parent, columns, ticks, done)
        frame = _moved(before, joint, columns.get(joint.get("name"), np.zeros(ticks)))
    done[link] = frame
    return frame


def _moved(before: Frames, joint: ElementTree.Element, value: np.ndarray) -> Frames:
    rotation, origin = before
    turn, xyz = origin_of(joint)
    axis = numbers(joint.find("axis"), "xyz", "1 0 0")
    origin = origin + rotation @ xyz
    rotation = rotation @ turn
    if joint.get("type") == "prismatic":
        origin = origin + (rotation @ axis) * value[:, None]
    elif joint.get("type") in ("revolute", "continuous"):
        rotation = rotation @ turns(axis, value)
    return rotation, origin


def turns(axis: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Rotations by angles [rad], (T,), about one axis, (3,): Rodrigues' formula, (T, 3, 3)."""
    x, y, z = axis / np.linalg.norm(axis)
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * k + (1.0 - c) * (k @ k)


def fixed_axes(rpy: np.ndarray) -> np.ndarray:
    """Rotation of roll, pitch and yaw about fixed axes, (3, 3)."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a), math.sin(a)) for a in rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def numbers(element: ElementTree.Element | None, key: str, default: str) -> np.ndarray:
    """Numbers in an attribute of an element, or those of `default` if it is missing."""
    text = default if element is None else element.get(key, default)
    return np.array([float(v) for v in text.split()])


def set_pose(origin: ElementTree.Element, offset: np.ndarray, turn: np.ndarray) -> None:
    """Write a position [m], (3,), and a rotation, (3, 3), into an origin of a URDF."""
    pitch = math.asin(max(-1.0, min(1.0, -turn[2, 0])))
    if abs(turn[2, 0]) < 1.0 - 1e-12:
        roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    else:
        roll, yaw = math.atan2(-turn[1, 2], turn[1, 1]), 0.0
    origin.set("xyz", " ".join(f"{v:.12g}" for v in offset + 0.0))
    origin.set("rpy", " ".join(f"{v:.12g}" for v in (roll, pitch, yaw)))


def lock(joint: ElementTree.Element, position: float) -> None:
    """Fix a joint of a URDF at a position [rad or m]."""
    turn, offset = origin_of(joint)
    axis = numbers(joint.find("axis"), "xyz", "1 0 0")
    if position and len(axis) == 3 and np.linalg.norm(axis) > 0.0:
        if joint.get("type") == "prismatic":
            offset = offset + turn @ axis / np.linalg.norm(axis) * position
        else:
            turn = turn @ turns(axis, np.array([position]))[0]
        origin = joint.find("origin")
        origin = ElementTree.SubElement(joint, "origin") if origin is None else origin
        set_pose(origin, offset, turn)
    joint.set("type", "fixed")
    for extra in [*joint.findall("mimic"), *joint.findall("limit"), *joint.findall("axis")]:
        joint.remove(extra)
