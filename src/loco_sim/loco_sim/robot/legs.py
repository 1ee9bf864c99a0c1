# SPDX-License-Identifier: Apache-2.0
"""Leg geometry of a quadruped, read from its URDF.

``legs:`` of ``robot.yaml`` names for each of lf rf lh rh the joints `haa`, `hfe`, `kfe` and
the link `foot`. The geometry (hips, lengths, signs, angles of the URDF's zero pose) is computed
from the URDF's kinematics, as an array for `loco_control.legs.kinematics`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.legs.geometry import (
    COLUMNS,
    DOWN,
    EXTENDED,
    FLEXED,
    FRONT,
    HIP_X,
    HIP_Y,
    HIP_Z,
    KNEE,
    LEFT,
    SHANK,
    SIDE,
    SIGN,
    THIGH,
    ZERO,
)  # fmt: skip
from loco_control.names import JOINT_KINDS, LEGS

from ..geometry import added
from .description import Description
from .frames import zero_frames

TILT = 0.02  # largest angle between a joint axis and its base axis [rad]: allows for drawing errors
SHORTEST = 0.01  # smallest length of thigh and shank [m]
STRAIGHTEST = 0.1  # smallest commanded knee angle, 0 is straight [rad]
MOST_BENT = 2.9  # largest commanded knee angle without a limit in the URDF [rad]
DIGITS = 12  # decimal digits of lengths and angles, which removes rounding errors
KEYS = (*JOINT_KINDS, "foot")


def names(section: Any, description: Description, where: str) -> tuple[tuple, tuple]:
    """Joints (12) and feet (4) of the section ``legs``, in the order of `loco_control.names`.

    Raises:
        ParameterError: A leg or a part of it is missing.
        NameUnknownError: A key, joint or link does not exist.
    """
    if not isinstance(section, Mapping):
        raise ParameterError(f"{where}: legs must be a mapping of {', '.join(LEGS)}")
    _same_keys(section, LEGS, f"{where}: legs")
    joints, feet = [], []
    for leg in LEGS:
        parts = section[leg]
        if not isinstance(parts, Mapping):
            raise ParameterError(f"{where}: legs.{leg} must be a mapping of {', '.join(KEYS)}")
        _same_keys(parts, KEYS, f"{where}: legs.{leg}")
        joints += [str(parts[kind]) for kind in JOINT_KINDS]
        feet.append(str(parts["foot"]))
    for kind, requested, available in (
        ("joint", joints, description.joint_types()),
        ("link", feet, description.links()),
    ):
        for name in requested:
            if name not in available:
                raise NameUnknownError(
                    f"{kind} of the URDF that legs of {where} names", name, available
                )
    return tuple(joints), tuple(feet)


def _same_keys(section: Mapping, expected: tuple[str, ...], where: str) -> None:
    for key in section:
        if key not in expected:
            raise NameUnknownError(f"key in {where}", str(key), expected)
    missing = [key for key in expected if key not in section]
    if missing:
        raise ParameterError(f"{where} needs {', '.join(missing)} too")


def geometry(
    description: Description,
    joints: tuple[str, ...],
    feet: tuple[str, ...],
    standing: np.ndarray | None = None,
) -> np.ndarray:
    """Legs of a URDF, (4, 16), columns named by `legs.geometry.COLUMNS`.

    Args:
        description: The URDF.
        joints: Names of the leg joints in the order of `names`, (12,).
        feet: Names of the feet in the order of `names`, (4,).
        standing: Joint positions of the robot standing [rad], (12,): bending direction of knees
            that the URDF lets bend both ways. None for backwards, as on most robots.

    Raises:
        ParameterError: A leg does not have HAA about x, and HFE and KFE about y.
    """
    frames = zero_frames(description)
    legs = np.zeros((4, len(COLUMNS)))
    for i, leg in enumerate(LEGS):
        three = joints[3 * i : 3 * i + 3]
        axes, origins = zip(*(_axis(description, frames, joint) for joint in three), strict=True)
        signs = [_along(leg, joint, axis, kind)
                 for joint, axis, kind in zip(three, axes, (0, 1, 1), strict=True)]  # fmt: skip
        foot = _foot(description, frames, feet[i])
        _check_chain(description, leg, three, feet[i])
        angles = np.zeros(3) if standing is None else standing[3 * i : 3 * i + 3]
        ranges = [_angles(description, joint, angle, standing is not None)
                  for joint, angle in zip(three, angles, strict=True)]  # fmt: skip
        legs[i] = _row(leg, LEFT[i], signs, (*origins, foot), ranges)
    _check_places(legs)
    return legs


def _row(leg: str, left: float, signs: list, points: tuple, ranges: list) -> np.ndarray:
    """One leg of `geometry` from the axes' signs and points in the base frame at the zero pose."""
    haa, hfe, kfe, foot = points
    thigh, shank = kfe - hfe, foot - kfe
    row = np.zeros(len(COLUMNS))
    row[HIP_X], row[HIP_Y], row[HIP_Z] = hfe[0], left * haa[1], haa[2]
    row[SIDE], row[DOWN] = left * (foot[1] - haa[1]), haa[2] - hfe[2]
    row[THIGH], row[SHANK] = math.hypot(thigh[0], thigh[2]), math.hypot(shank[0], shank[2])
    if min(row[THIGH], row[SHANK]) < SHORTEST:
        raise ParameterError(
            f"leg {leg}: thigh and shank must be at least {SHORTEST} m long, got "
            f"{row[THIGH]:.3g} and {row[SHANK]:.3g} m; `foot` is the link at the end of the shank"
        )
    hanging = math.atan2(-thigh[0], -thigh[2])  # canonical angles at the zero pose
    knee_angle = math.atan2(-shank[0], -shank[2]) - hanging
    row[SIGN : SIGN + 3] = -left * signs[0], signs[1], signs[2]
    for joint, angle in enumerate((0.0, hanging, knee_angle)):
        sign, usual = row[SIGN + joint], ranges[joint][0]
        turns = (angle + sign * usual) / (2.0 * math.pi)
        row[ZERO + joint] = -sign * (angle - 2.0 * math.pi * round(turns))
    pose, *bounds = (row[SIGN + 2] * (angle - row[ZERO + 2]) for angle in ranges[2])
    low, high = sorted(bounds)
    one_way = low >= 0.0 or high <= 0.0
    row[KNEE] = 1.0 if (high > 0.0 if one_way else pose > 0.0) else -1.0
    min_bend, max_bend = sorted((row[KNEE] * low, row[KNEE] * high))
    row[FLEXED] = math.cos(min(max_bend, MOST_BENT))
    row[EXTENDED] = math.cos(max(min_bend, STRAIGHTEST))
    return np.round(row, DIGITS) + 0.0  # turns -0.0 into 0.0


def _axis(description: Description, frames: Mapping, joint: str) -> tuple[np.ndarray, np.ndarray]:
    """Direction and a point of a joint's axis in the base frame at the zero pose, each (3,)."""
    rotation, origin = frames[description.child(joint)]
    axis = description.axis(joint)
    return rotation @ axis / np.linalg.norm(axis), origin


def _along(leg: str, joint: str, axis: np.ndarray, index: int) -> float:
    """Sign of a joint's axis along x (0) or y (1) of the base, +1 or -1.

    Raises:
        ParameterError: The axis of the joint is not parallel to that axis.
    """
    if abs(axis[index]) < math.cos(TILT):
        raise ParameterError(
            f"leg {leg}: joint {joint} must turn about {'xy'[index]} of the base at the zero pose "
            f"(x forward, z up), it turns about {np.round(axis, 3).tolist()}: the gait knows legs "
            "of HAA about x, then HFE and KFE about y"
        )
    return float(np.sign(axis[index]))


def _foot(description: Description, frames: Mapping, link: str) -> np.ndarray:
    """Centre of a foot in the base frame [m], (3,): that of its sphere if it has one."""
    rotation, origin = frames[link]
    balls = description.balls(link)
    if len(balls) == 1:
        return origin + rotation @ balls[0][0]
    return origin


def _check_chain(description: Description, leg: str, joints: tuple, foot: str) -> None:
    for joint, tip in zip(joints, (*joints[1:], None), strict=True):
        end = foot if tip is None else description.child(tip)
        if end not in description.below(description.child(joint)):
            raise ParameterError(
                f"leg {leg}: {end} does not hang on {joint}; a leg is HAA, HFE, KFE, foot, "
                "from the base outwards"
            )


def _angles(
    description: Description, joint: str, standing: float, is_known: bool
) -> tuple[float, float, float]:
    """Standing or central angle of a joint, and its smallest and largest angle [rad]."""
    low, high = description.limits(joint)
    if is_known:
        return standing, low, high
    return (0.5 * (low + high) if math.isfinite(low + high) else 0.0), low, high


def _check_places(legs: np.ndarray) -> None:
    """Check that front legs are in front and left legs on the left."""
    for i, leg in enumerate(LEGS):
        other = LEGS[(i + 2) % 4]
        if FRONT[i] * (legs[i, HIP_X] - legs[(i + 2) % 4, HIP_X]) <= 0.0:
            side = "ahead of" if FRONT[i] > 0.0 else "behind"
            raise ParameterError(
                f"the hip of leg {leg} must be {side} that of {other} (x forward), they are at "
                f"x = {legs[i, HIP_X]:.3g} and {legs[(i + 2) % 4, HIP_X]:.3g} m"
            )
        if legs[i, HIP_Y] + legs[i, SIDE] <= 0.0:
            raise ParameterError(
                f"leg {leg} must be on its side of the base (y to the left), its foot is "
                f"{-(legs[i, HIP_Y] + legs[i, SIDE]):.3g} m beyond the middle"
            )


def swung_mass(description: Description, joints: tuple[str, ...]) -> float:
    """Mass of all links behind the HAA joints [kg], the mass swung by the drives."""
    legs = (description.below(description.child(joint)) for joint in joints[:: len(JOINT_KINDS)])
    return added(description.mass_of(link) for links in legs for link in links)
