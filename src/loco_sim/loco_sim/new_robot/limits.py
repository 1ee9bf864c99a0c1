# SPDX-License-Identifier: Apache-2.0
"""Effort and velocity limits of joints that name none, guessed from weight and size."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from ..robot.equipment import GRAVITY
from .body import Body

RESERVE = 5.0  # times the largest torque that holds the robot at rest
SPEEDS_UP = 10.0  # acceleration that an effort is enough for [rad/s² or m/s²]
POSES = 60  # drawn to find it
PACE = 8.0  # joint velocity times sqrt(size / g) [-]
SLIDES = 2.0  # velocity of a slide over sqrt(g size) [-]
GRIP = 0.5  # of wheels: pull of all of them over the weight [-]


def guess(
    root: ET.Element,
    body: Body,
    loads: np.ndarray,
    wheels: dict[int, float],
    size: float,
    rng: np.random.Generator,
) -> list[str]:
    """Write limits into the joints that have none; 0 counts as none.

    Args:
        root: Element of the robot, changed in place.
        body: Tree of the robot.
        loads: Torque of each joint in the standing posture [N·m], (n,).
        wheels: Radius of each wheel [m], by joint.
        size: Longest side of the robot [m].
        rng: Draws poses.

    Returns:
        Names of the joints with a guessed limit.
    """
    effort, velocity = np.abs(loads), np.full(len(body.joints), PACE * np.sqrt(GRAVITY / size))
    velocity[body.slides] = SLIDES * np.sqrt(GRAVITY * size)
    low = np.where(np.isfinite(body.low), body.low, -np.pi)
    high = np.where(np.isfinite(body.high), body.high, np.pi)
    for _ in range(POSES):
        q = low + (high - low) * rng.random(len(low))
        effort = np.maximum(effort, np.abs(body.weight_torque(q, [], np.zeros((0, 3)))))
    effort = RESERVE * np.maximum(effort, 0.02 * effort.max(initial=0.0))
    held = np.diag(body.inertia(body.nominal(), bolted=True))
    effort = np.maximum(effort, SPEEDS_UP * held)
    for joint, radius in wheels.items():
        effort[joint] = GRIP * body.mass.sum() * GRAVITY * radius / len(wheels)
        velocity[joint] = 4.0 * np.sqrt(GRAVITY * size) / radius
    effort = np.maximum(effort, 1e-3)
    guessed, elements = [], {j.get("name"): j for j in root.findall("joint")}
    for name, torque, speed in zip(body.joints, effort, velocity, strict=True):
        limit = elements[name].find("limit")
        limit = ET.SubElement(elements[name], "limit") if limit is None else limit
        for key, value in (("effort", torque), ("velocity", speed)):
            if not float(limit.get(key, 0.0)) > 0.0:
                limit.set(key, f"{value:.3g}")
                guessed.append(name)
    return list(dict.fromkeys(guessed))
