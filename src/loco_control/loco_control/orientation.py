# SPDX-License-Identifier: Apache-2.0
"""Orientation of the trunk: quaternions x y z w, fixed-axis roll pitch yaw (REP 103)."""

from __future__ import annotations

import math

import numpy as np
from numba import njit


@njit(cache=True)
def roll_pitch_yaw(orientation):
    """Roll, pitch, yaw [rad] of a unit quaternion x y z w, base to world, (4,)."""
    x, y, z, w = orientation[0], orientation[1], orientation[2], orientation[3]
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw


def quaternion(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Unit quaternion x y z w, (4,), of roll, pitch and yaw [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = (
        (math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in (roll, pitch, yaw)
    )
    return np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )


@njit(cache=True)
def rotation_base_to_horizontal(roll, pitch):
    """R_y(pitch) R_x(roll), (3, 3): base frame to the horizontal frame of the same heading."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    return np.array([[cp, sp * sr, sp * cr], [0.0, cr, -sr], [-sp, cp * sr, cp * cr]])


@njit(cache=True)
def wrap_angle(angle):
    """The same angle in [-pi, pi) [rad]."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi
