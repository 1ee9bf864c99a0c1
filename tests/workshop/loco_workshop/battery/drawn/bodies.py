# SPDX-License-Identifier: Apache-2.0
"""Random kinematic trees on a bench, written as URDF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass

import numpy as np

MOST = 12  # joints
LENGTH = (0.08, 0.5)  # of the first link [m]
DENSITY, POWER = 30.0, 2.2  # mass of a link: DENSITY length ** POWER [kg], as of arms and legs
WIDTH = (0.12, 0.4)  # of a link, share of its length
CENTRE = (0.25, 0.6)  # place of the centre of mass, share of the length
SLIDES = 0.15  # share of prismatic joints
BRANCHES = 0.3  # share of robots that branch
TURN = {0: (0.15, 0.9), 1: (0.1, 0.5)}  # amplitude of the motion [rad], or [lengths] of a slide
ROOM = 3.0  # distance of the limits from the pose [amplitudes]


@dataclass(frozen=True)
class Body:
    """A drawn tree of n joints.

    Attributes:
        joints: Names of the joints.
        start: Standing pose [rad or m], (n,).
        span: Amplitude of the motion of each joint [rad or m], (n,).
        slides: Whether each joint is prismatic, (n,).
        parent: Index of the joint before each joint, -1 for the bench, (n,).
        lengths: Lengths of the links [m], (n,).
    """

    joints: tuple[str, ...]
    start: np.ndarray
    span: np.ndarray
    slides: np.ndarray
    parent: np.ndarray
    lengths: np.ndarray


def draw(rng: np.random.Generator, joints: int = MOST) -> tuple[Body, ET.Element]:
    """A tree of at most `joints` joints, and its URDF without efforts: see `finished`."""
    n = min(joints, int(np.exp(rng.uniform(0.0, np.log(joints + 1)))))
    branches = n > 2 and rng.random() < BRANCHES
    parent = np.arange(n) - 1
    for i in range(2, n) if branches else ():
        if rng.random() < 0.5:  # a limb from a joint on the way to the last one (depth first)
            parent[i] = rng.choice(_way(parent, i - 1))
    leaf = [i not in parent for i in range(n)]
    first = np.exp(rng.uniform(*np.log(LENGTH)))
    slides = rng.random(n) < SLIDES
    root, tips = ET.Element("robot", name="drawn"), [np.zeros(3)]
    ET.SubElement(root, "link", name="bench")
    lengths, start, span = np.zeros(n), np.zeros(n), np.zeros(n)
    depth = np.zeros(n, dtype=int)
    for i in range(n):
        depth[i] = 0 if parent[i] < 0 else depth[parent[i]] + 1
        lengths[i] = first * 0.92 ** depth[i] * rng.uniform(0.6, 1.3)
        along = np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
        _link(root, i, lengths[i], along, 0.85 ** depth[i], rng)
        low, high = TURN[int(slides[i])]
        span[i] = rng.uniform(low, high) * (lengths[i] if slides[i] else 1.0)
        start[i] = rng.uniform(-0.8, 0.8) * (0.2 * lengths[i] if slides[i] else 1.0)
        joint = ET.SubElement(
            root, "joint", name=f"joint_{i + 1}", type="prismatic" if slides[i] else "revolute"
        )
        ET.SubElement(joint, "parent", link=f"link_{parent[i] + 1}" if parent[i] >= 0 else "bench")
        ET.SubElement(joint, "child", link=f"link_{i + 1}")
        ET.SubElement(joint, "origin", xyz=_text(tips[parent[i] + 1]), rpy=_text(_mount(rng)))
        ET.SubElement(joint, "axis", xyz=_text(_axis(along, leaf[i], rng)))
        limits = start[i] + np.array([-1.0, 1.0]) * ROOM * span[i]
        ET.SubElement(joint, "limit", lower=f"{limits[0]:.6g}", upper=f"{limits[1]:.6g}")
        tips.append(along * lengths[i])
    names = tuple(f"joint_{i + 1}" for i in range(n))
    return Body(names, np.round(start, 4), np.round(span, 4), slides, parent, lengths), root


def finished(root: ET.Element, effort: np.ndarray, damping: np.ndarray, fast: np.ndarray) -> str:
    """Text of a URDF with torque limits [N·m], damping [N·m·s/rad] and speed limits [rad/s]."""
    for joint, most, viscous, speed in zip(root.iter("joint"), effort, damping, fast, strict=True):
        joint.find("limit").attrib.update(effort=f"{most:.6g}", velocity=f"{3.0 * speed:.6g}")
        if viscous > 0.0:
            for old in joint.findall("dynamics"):
                joint.remove(old)
            ET.SubElement(joint, "dynamics", damping=f"{viscous:.6g}", friction="0")
    return ET.tostring(root, encoding="unicode")


def _way(parent: np.ndarray, i: int) -> list[int]:
    """Joints before joint i, on its way to the bench."""
    found = []
    while (i := int(parent[i])) >= 0:
        found.append(i)
    return found


def _link(
    root: ET.Element, i: int, length: float, along: np.ndarray, lighter: float,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """A box along an axis of its frame, whose centre of mass is a little beside it."""
    mass = DENSITY * length**POWER * lighter * np.exp(0.3 * rng.standard_normal())
    sides = np.where(along != 0.0, 1.0, rng.uniform(*WIDTH, 3)) * length
    squares = np.square(sides)
    diagonal = mass / 12.0 * (np.sum(squares) - squares)
    centre = along * length * rng.uniform(*CENTRE) + 0.08 * length * rng.uniform(-1.0, 1.0, 3)
    turn = rng.uniform(-0.4, 0.4, 3) if rng.random() < 0.5 else np.zeros(3)
    link = ET.SubElement(root, "link", name=f"link_{i + 1}")
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_text(centre), rpy=_text(turn))
    ET.SubElement(inertial, "mass", value=f"{mass:.6g}")
    zero = {"ixy": "0", "ixz": "0", "iyz": "0"}
    values = {f"i{k}{k}": f"{value:.6g}" for k, value in zip("xyz", diagonal, strict=True)}
    ET.SubElement(inertial, "inertia", values | zero)


def _mount(rng: np.random.Generator) -> np.ndarray:
    """Roll, pitch and yaw of a joint: straight, by right angles, or tilted."""
    kind = rng.choice(3, p=[0.45, 0.3, 0.25])
    if kind == 0:
        return np.zeros(3)
    if kind == 1:
        return 0.5 * np.pi * rng.integers(-1, 3, 3)
    return rng.uniform(-0.6, 0.6, 3)


def _axis(along: np.ndarray, leaf: bool, rng: np.random.Generator) -> np.ndarray:
    """Axis of a joint: mostly across its link, now and then along it or tilted."""
    across = [axis for axis in np.eye(3) if not axis @ along]
    axis = across[rng.integers(2)] * rng.choice([-1.0, 1.0])
    if not leaf and rng.random() < 0.2:
        axis = along
    if rng.random() < 0.15:
        axis = axis + rng.uniform(-0.4, 0.4, 3)
    return axis / np.linalg.norm(axis)


def _text(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values)
