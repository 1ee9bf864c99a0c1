# SPDX-License-Identifier: Apache-2.0
"""Effort and velocity limits of joints that name none, and swings that the efforts can hold."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from ..robot.equipment import GRAVITY
from .body import Body

RESERVE = 5.0  # times the largest torque that holds the robot at rest
SPEEDS_UP = 10.0  # acceleration that an effort is enough for [rad/s² or m/s²]
TURNS_AT = 1.0  # speed against its damping that an effort is enough for [rad/s or m/s]
POSES = 60  # drawn to find it
PACE = 8.0  # joint velocity times sqrt(size / g) [-]
SLIDES = 2.0  # velocity of a slide over sqrt(g size) [-]
GRIP = 0.5  # of wheels: pull of all of them over the weight [-]
NO_FEET = np.zeros((0, 3))
HOLDS = 0.6  # share of its effort that a swing may ask of a joint
PLACES = 9  # over its range that a joint is tried at
TURNS = 12  # joints that are moved at most, one after another
SMALLEST = 8.0  # by which a swing is divided at most


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
        effort = np.maximum(effort, np.abs(body.weight_torque(q, [], NO_FEET)))
    effort = RESERVE * np.maximum(effort, 0.02 * effort.max(initial=0.0))
    held = np.diag(body.inertia(body.nominal(), bolted=True))
    effort = np.maximum(effort, SPEEDS_UP * held + RESERVE * TURNS_AT * body.damping)
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


def asked(body: Body, q: np.ndarray, amplitude: np.ndarray, pace: float) -> np.ndarray:
    """Largest torque that a swing of all joints at once takes [N·m or N], (n,).

    Args:
        body: Tree of the robot.
        q: Middle of the swing, (n,).
        amplitude: Swing of each joint [rad or m], (n,).
        pace: Angular frequency of the swing [rad/s].
    """
    weight = [body.weight_torque(q + s * amplitude, [], NO_FEET) for s in (-1.0, 0.0, 1.0)]
    moved = np.abs(body.inertia(q, True) @ amplitude) * pace**2 + body.damping * amplitude * pace
    return np.abs(weight).max(axis=0) + moved


def held(
    body: Body, q: np.ndarray, amplitude: np.ndarray, effort: np.ndarray, pace: float
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """A swing that the efforts hold, the one that was given where they do.

    Joints are moved one by one, to where efforts are exceeded least: an arm that cannot hold itself
    out hangs. A swing that is still too much is halved.

    Args:
        body: Tree of the robot.
        q: Middle of the swing, (n,).
        amplitude: Swing of each joint [rad or m], (n,).
        effort: Effort limits [N·m or N], (n,).
        pace: Angular frequency of the swing [rad/s].

    Returns:
        Middle of the swing, (n,); its amplitude, (n,); sentences about what could not stay.
    """

    def excess(at: np.ndarray) -> float:
        share = asked(body, at, amplitude, pace) / effort
        return float(np.square(np.maximum(share - HOLDS, 0.0)).sum())

    first, at = asked(body, q, amplitude, pace) / effort, q
    if (first <= HOLDS).all():
        return q, amplitude, []
    low = np.maximum(body.low, -np.pi) + np.abs(amplitude)  # a turn more is the same posture
    high = np.minimum(body.high, np.pi) - np.abs(amplitude)
    for _ in range(TURNS):
        if excess(at) == 0.0:
            break
        tried = [at]
        for joint in range(len(q)):
            for value in np.linspace(low[joint], high[joint], PLACES):
                tried.append(np.where(np.arange(len(q)) == joint, value, at))
        best = min(tried, key=excess)
        if best is at:
            break
        at = best
    part = 1.0
    while part < SMALLEST and (asked(body, at, amplitude / part, pace) > HOLDS * effort).any():
        part *= 2.0
    worst = int(np.argmax(first))
    moved = [name for name, a, b in zip(body.joints, q, at, strict=True) if a != b]
    text = (
        f"to swing about its middle, {body.joints[worst]!r} would need {first[worst]:.0%} of its "
        f"effort limit of {effort[worst]:.3g}"
    )
    text += f": it swings about another posture ({', '.join(moved)} moved)" if moved else ""
    text += f"{' and' if moved else ': it swings'} by 1/{part:.0f} as far" if part > 1.0 else ""
    return at, amplitude / part, [text]
