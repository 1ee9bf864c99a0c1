# SPDX-License-Identifier: Apache-2.0
"""Assignment of legs (front or hind, left or right) by joint and link names, or by position."""

from __future__ import annotations

import numpy as np

from loco_control.names import LEGS

from .body import Body
from .posture import Posture
from .supports import Support, side_of

JOINTS = ("haa", "hfe", "kfe")
QUADRANTS = dict(zip(LEGS, ((1, 1), (1, -1), (-1, 1), (-1, -1)), strict=True))


def facing(body: Body, supports: list[Support], place: np.ndarray) -> np.ndarray | None:
    """Rotation about z that turns limbs named front to +x; None if not needed or not named.

    Args:
        body: The robot.
        supports: Supports of the robot.
        place: Origins of the bodies in the base frame [m], (n + 1, 3).
    """
    sides = [_quadrant_of(body, support)[0] for support in supports]
    hips = [place[s.chain[0]][:2] for s in supports]
    front = [p for side, p in zip(sides, hips, strict=True) if side > 0]
    hind = [p for side, p in zip(sides, hips, strict=True) if side < 0]
    if not front or not hind:
        return None
    x, y = np.mean(front, axis=0) - np.mean(hind, axis=0)
    if x >= abs(y):
        return None
    turn = np.pi if -x >= abs(y) else -np.sign(y) * 0.5 * np.pi
    c, s = np.round(np.cos(turn)), np.round(np.sin(turn))
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _quadrant_of(body: Body, support: Support) -> tuple[int, int]:
    """Position of a limb by its joint and link names, as in `side_of`."""
    names = [body.joints[j] for j in support.chain]
    names += [link for j in support.chain for link in body.links[j]]
    sides = [side_of(name) for name in names]
    return (
        next((front for front, _ in sides if front), 0),
        next((left for _, left in sides if left), 0),
    )


def section(body: Body, found: list[Support], posture: Posture) -> dict[str, dict[str, str]]:
    """The section ``legs`` of a quadruped with three hinges per leg; empty for other robots."""
    if len(found) != 4 or any(len(s.chain) != 3 or s.wheel for s in found):
        return {}
    if any(body.slides[j] for s in found for j in s.chain):
        return {}
    feet = posture.feet[:, :2] - posture.feet[:, :2].mean(axis=0)
    entries = {}
    for leg, (front, left) in QUADRANTS.items():
        fits = [
            s for s, foot in zip(found, feet, strict=True) if foot[0] * front > 0 < foot[1] * left
        ]
        if len(fits) != 1:
            return {}
        chain = [body.joints[j] for j in fits[0].chain]
        entries[leg] = {**dict(zip(JOINTS, chain, strict=True)), "foot": fits[0].link}
    return entries
