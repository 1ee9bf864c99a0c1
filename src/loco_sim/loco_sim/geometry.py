# SPDX-License-Identifier: Apache-2.0
"""Rotations and sums in plain floats, several times faster than arrays for single quaternions.

Quaternions are x y z w and turn vectors of the base frame into the world frame.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import reduce
from math import asin, atan2
from operator import add
from typing import Any

Triple = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Rotation = tuple[float, float, float, float, float, float, float, float, float]  # row by row


def added(values: Iterable[float]) -> float:
    """Sum of numbers in sequential order; `sum` rounds differently since Python 3.12."""
    return reduce(add, values, 0.0)


def multiply(a: Sequence[float], b: Sequence[float]) -> Quaternion:
    """Quaternion product a b: rotation by b, then by a."""
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotation_matrix(quaternion: Sequence[float]) -> Rotation:
    """Rotation matrix of a unit quaternion, row by row, (9,)."""
    x, y, z, w = quaternion
    return (
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w),
        2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w),
        2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y),
    )  # fmt: skip


def rotate(matrix: Rotation, v: Sequence[float]) -> Triple:
    """R v: a vector of the base frame, expressed in the world frame."""
    a, b, c, d, e, f, g, h, i = matrix
    x, y, z = v
    return a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + i * z


def rotate_back(matrix: Rotation, v: Sequence[float]) -> Triple:
    """Rᵀ v: a vector of the world frame, expressed in the base frame."""
    a, b, c, d, e, f, g, h, i = matrix
    x, y, z = v
    return a * x + d * y + g * z, b * x + e * y + h * z, c * x + f * y + i * z


def seen_from(turn: Sequence[float], base: Any) -> Any:
    """State of a base (`world.Base`), attitude and velocities rotated by a quaternion."""
    matrix = rotation_matrix(turn)
    return base._replace(
        orientation=multiply(turn, base.orientation),
        velocity=rotate(matrix, base.velocity),
        angular_velocity=rotate(matrix, base.angular_velocity),
    )


def roll_pitch(matrix: Rotation) -> tuple[float, float]:
    """Roll and pitch [rad], fixed axes x y z (REP 103)."""
    return atan2(matrix[7], matrix[8]), asin(max(-1.0, min(1.0, -matrix[6])))
