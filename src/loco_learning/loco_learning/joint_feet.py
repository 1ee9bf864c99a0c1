# SPDX-License-Identifier: Apache-2.0
"""Where the feet of any robot are, from its URDF and joint angles."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import Any

import numpy as np

Frames = tuple[np.ndarray, np.ndarray]  # rotation (T, 3, 3) and origin (T, 3), in the base frame


def feet_in_base(robot: Any, q: np.ndarray) -> np.ndarray:
    """Origins of the feet in the base frame [m], (T, f, 3).

    Args:
        robot: With `urdf`, `joints` and `feet`.
        q: Joint positions [rad, m], (T, n).
    """
    root = ElementTree.fromstring(robot.urdf)
    parent = {joint.find("child").get("link"): joint for joint in root.findall("joint")}
    columns = {name: q[:, i] for i, name in enumerate(robot.joints)}
    known: dict[str, Frames] = {}
    places = [_frame(foot, parent, columns, len(q), known)[1] for foot in robot.feet]
    return np.stack(places, axis=1) if places else np.zeros((len(q), 0, 3))


def _frame(link: str, parent: dict, columns: dict, ticks: int, known: dict[str, Frames]) -> Frames:
    """Frame of a link: that of its parent, moved by the joint between them."""
    if link in known:
        return known[link]
    if link not in parent:
        frame = np.broadcast_to(np.eye(3), (ticks, 3, 3)), np.zeros((ticks, 3))
    else:
        joint = parent[link]
        before = _frame(joint.find("parent").get("link"), parent, columns, ticks, known)
        frame = _moved(before, joint, columns.get(joint.get("name"), np.zeros(ticks)))
    known[link] = frame
    return frame


def _moved(before: Frames, joint: ElementTree.Element, value: np.ndarray) -> Frames:
    rotation, origin = before
    place = joint.find("origin")
    xyz, rpy = (_numbers(place, key, "0 0 0") for key in ("xyz", "rpy"))
    axis = _numbers(joint.find("axis"), "xyz", "1 0 0")
    origin = origin + rotation @ xyz
    rotation = rotation @ _fixed_axes(rpy)
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


def _fixed_axes(rpy: np.ndarray) -> np.ndarray:
    """Rotation of roll, pitch and yaw about fixed axes, (3, 3)."""
    x, y, z = (turns(axis, rpy[i : i + 1])[0] for i, axis in enumerate(np.eye(3)))
    return z @ y @ x


def _numbers(element: ElementTree.Element | None, key: str, default: str) -> np.ndarray:
    text = default if element is None else element.get(key, default)
    return np.array([float(v) for v in text.split()])
