# SPDX-License-Identifier: Apache-2.0
"""Guessed effort and velocity limits of joints without usable ones, and feasible swing motions."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection

import numpy as np

from ..robot.equipment import GRAVITY
from .body import Body

RESERVE = 5.0  # effort limit / largest static torque
SPEEDS_UP = 10.0  # acceleration that the effort must allow [rad/s² or m/s²]
TURNS_AT = 1.0  # speed that the effort must allow against the damping [rad/s or m/s]
PLACEHOLDER = 0.3  # effort limit / effort that the joint needs: no limit of a drive is less
CREEPS = 0.1  # acceleration that any effort limit must allow [rad/s² or m/s²]
POSES = 60  # number of random poses for the largest static torque
PACE = 8.0  # joint velocity times sqrt(size / g) [-]
SLIDES = 2.0  # velocity of a prismatic joint / sqrt(g size) [-]
GRIP = 0.5  # traction of all wheels / weight [-]
NO_FEET = np.zeros((0, 3))
HOLDS = 0.6  # share of its effort limit that a swing may require of a joint
N_POSITIONS = 9  # number of positions tried over the range of a joint
TURNS = 12  # largest number of joints moved, in sequence
SMALLEST = 8.0  # largest divisor of a swing


def guess(
    root: ET.Element,
    body: Body,
    loads: np.ndarray,
    wheels: dict[int, float],
    size: float,
    rng: np.random.Generator,
    only: Collection[str] | None = None,
) -> tuple[list[tuple[str, str]], list[str]]:
    """Set guessed limits of joints without limits; 0 counts as no limit.

    An effort limit far below what the weight or a slow motion needs, as of a CAD export that
    writes 1 at each joint, is a placeholder and is replaced.

    Args:
        root: Element of the robot, changed in place.
        body: Tree of the robot.
        loads: Static torque of each joint in the standing posture [N·m], (n,).
        wheels: Radius of each wheel [m], by joint.
        size: Longest side of the robot [m].
        rng: Random generator of poses.
        only: Joints whose limits are set; None for all.

    Returns:
        Joint and kind (effort or velocity) of each guessed limit; sentences on replaced limits.
    """
    effort, velocity = np.abs(loads), np.full(len(body.joints), PACE * np.sqrt(GRAVITY / size))
    velocity[body.slides] = SLIDES * np.sqrt(GRAVITY * size)
    low = np.where(np.isfinite(body.low), body.low, -np.pi)
    high = np.where(np.isfinite(body.high), body.high, np.pi)
    for _ in range(POSES):
        q = low + (high - low) * rng.random(len(low))
        effort = np.maximum(effort, np.abs(body.weight_torque(q, [], NO_FEET)))
    held = np.diag(body.inertia(body.nominal(), bolted=True))
    weight, creep = effort, CREEPS * held
    effort = RESERVE * np.maximum(effort, 0.02 * effort.max(initial=0.0))
    effort = np.maximum(effort, SPEEDS_UP * held + RESERVE * TURNS_AT * body.damping)
    effort += RESERVE * body.friction
    for joint, radius in wheels.items():
        effort[joint] = GRIP * body.mass.sum() * GRAVITY * radius / len(wheels)
        velocity[joint] = 4.0 * np.sqrt(GRAVITY * size) / radius
    effort = np.maximum(effort, 1e-3)
    guessed, elements = [], {j.get("name"): j for j in root.findall("joint")}
    selected = [k for k, name in enumerate(body.joints) if only is None or name in only]
    for k in selected:
        if elements[body.joints[k]].find("limit") is None:
            ET.SubElement(elements[body.joints[k]], "limit")
    limits = {k: elements[body.joints[k]].find("limit") for k in selected}
    efforts = {k: float(limit.get("effort", 0.0)) for k, limit in limits.items() if k not in wheels}
    notes = []
    for k in _placeholders(efforts, np.maximum(weight, creep)):
        unit, pace = ("N", "m/s²") if body.slides[k] else ("N·m", "rad/s²")
        heavy = weight[k] >= creep[k]
        load_case = "its weight alone" if heavy else f"an acceleration of {CREEPS:g} {pace}"
        notes.append(
            f"{body.joints[k]}: effort limit {efforts[k]:g} {unit}, {load_case} needs "
            f"{max(weight[k], creep[k]):.3g} {unit}: the limit is not used (guessed "
            f"{effort[k]:.3g} {unit}); correct <limit effort>"
        )
        limits[k].set("effort", "0")
    for k, limit in limits.items():
        for key, value in (("effort", effort[k]), ("velocity", velocity[k])):
            if not float(limit.get(key, 0.0)) > 0.0:
                limit.set(key, f"{value:.3g}")
                guessed.append((body.joints[k], key))
    return guessed, notes


def _placeholders(efforts: dict[int, float], needed: np.ndarray) -> list[int]:
    """Joints whose effort limit is far below what they need, or equal to such a one and below.

    Args:
        efforts: Effort limit of joints [N·m or N], by index; 0 for none.
        needed: Effort that each joint needs at least [N·m or N], (n,).
    """
    short = {k: value for k, value in efforts.items() if 0.0 < value < needed[k]}
    false = {value for k, value in short.items() if value < PLACEHOLDER * needed[k]}
    return [k for k, value in short.items() if value in false]


def demand(body: Body, q: np.ndarray, amplitude: np.ndarray, pace: float) -> np.ndarray:
    """Largest torque of each joint for a swing of all joints at once [N·m or N], (n,).

    Args:
        body: Tree of the robot.
        q: Centre of the swing [rad or m], (n,).
        amplitude: Swing of each joint [rad or m], (n,).
        pace: Angular frequency of the swing [rad/s].
    """
    weight = [body.weight_torque(q + s * amplitude, [], NO_FEET) for s in (-1.0, 0.0, 1.0)]
    moved = np.abs(body.inertia(q, True) @ amplitude) * pace**2 + body.damping * amplitude * pace
    return np.abs(weight).max(axis=0) + moved + body.friction


def held(
    body: Body, q: np.ndarray, amplitude: np.ndarray, effort: np.ndarray, pace: float
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """A swing within the effort limits, equal to the given one if that is feasible.

    The centre is moved joint by joint to where the effort limits are exceeded least: an arm that
    cannot hold itself horizontally hangs down. A swing that is still infeasible is halved.

    Args:
        body: Tree of the robot.
        q: Centre of the swing [rad or m], (n,).
        amplitude: Swing of each joint [rad or m], (n,).
        effort: Effort limits [N·m or N], (n,).
        pace: Angular frequency of the swing [rad/s].

    Returns:
        Centre of the swing, (n,); its amplitude, (n,); sentences about the changes.
    """

    def excess(at: np.ndarray) -> float:
        share = demand(body, at, amplitude, pace) / effort
        return float(np.square(np.maximum(share - HOLDS, 0.0)).sum())

    first, at = demand(body, q, amplitude, pace) / effort, q
    if (first <= HOLDS).all():
        return q, amplitude, []
    low = np.maximum(body.low, -np.pi) + np.abs(amplitude)  # a full turn more is the same posture
    high = np.minimum(body.high, np.pi) - np.abs(amplitude)
    for _ in range(TURNS):
        if excess(at) == 0.0:
            break
        candidates = [at]
        for joint in range(len(q)):
            for value in np.linspace(low[joint], high[joint], N_POSITIONS):
                candidates.append(np.where(np.arange(len(q)) == joint, value, at))
        best = min(candidates, key=excess)
        if best is at:
            break
        at = best
    part = 1.0
    while part < SMALLEST and (demand(body, at, amplitude / part, pace) > HOLDS * effort).any():
        part *= 2.0
    i_max = int(np.argmax(first))
    moved = [name for name, a, b in zip(body.joints, q, at, strict=True) if a != b]
    text = (
        f"to swing about its middle, {body.joints[i_max]!r} would need {first[i_max]:.0%} of its "
        f"effort limit of {effort[i_max]:.3g}"
    )
    text += f": it swings about another posture ({', '.join(moved)} moved)" if moved else ""
    text += f"{' and' if moved else ': it swings'} by 1/{part:.0f} as far" if part > 1.0 else ""
    return at, amplitude / part, [text]
