# SPDX-License-Identifier: Apache-2.0
"""Sensor readings and ground truth of a robot, computed from the state of the world.

A state is one row of numbers in the format of `kernels.run`: positions, velocities and mean
torques of n joints, m force components on feet, and the base.
"""

from __future__ import annotations

from math import asin, atan2, isfinite

import numpy as np
from numba import njit

from loco_control.types import GroundTruth, RobotState

from ..effects.readings import unpacked
from ..geometry import roll_pitch, rotation_matrix
from ..robot.robot import FallLimits

BASE = 13  # numbers of the base: position, quaternion, linear, angular velocity (world frame)
FINE, FALL, BROKEN = range(3)  # verdicts: normal, fallen, state not finite


@njit(cache=True, error_model="numpy", nogil=True)
def readings(rows, n, dt, gravity, threshold, limits):
    """Exact readings of consecutive states, one control period apart.

    The accelerometer at the base origin measures the mean over the period of Rᵀ (dv/dt - g).

    Args:
        rows: States, (T + 1, 3 n + m + BASE); the first is the initial state only.
        n: Number of joints.
        dt: Control period [s].
        gravity: Acceleration of gravity, world frame [m/s²], three numbers.
        threshold: Force above which a foot counts as in contact [N].
        limits: Height [m] below which, and roll and pitch [rad] above which, a robot has fallen.

    Returns:
        Signals in the order of `RobotState`, then of `GroundTruth`, (T, 3 n + m + 10 + BASE); feet
        that touch the ground, (T, m / 3) bool; and a verdict on each row, (T,).
    """
    count = len(rows) - 1
    imu = rows.shape[1] - BASE  # same offset in both: q, dq, tau, forces come first
    values = np.empty((count, imu + 10 + BASE))
    touches = np.empty((count, (imu - 3 * n) // 3), dtype=np.bool_)
    verdicts = np.zeros(count, dtype=np.int64)
    gx, gy, gz = gravity
    for r in range(count):
        before, row, value = rows[r, imu:], rows[r + 1], values[r]
        base = row[imu:]
        x, y, z, w = base[3], base[4], base[5], base[6]
        a, b, c = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)
        d, e, f = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)
        g, h, i = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)
        total = 0.0  # finite where all that it adds up is
        for k in range(imu):
            value[k] = row[k]
        for k in range(3 * n):
            total += row[k]
        for k in range(4):
            value[imu + k] = base[3 + k]
        px, py, pz = base[10], base[11], base[12]
        value[imu + 4] = a * px + d * py + g * pz
        value[imu + 5] = b * px + e * py + h * pz
        value[imu + 6] = c * px + f * py + i * pz
        px = (base[7] - before[7]) / dt - gx
        py = (base[8] - before[8]) / dt - gy
        pz = (base[9] - before[9]) / dt - gz
        value[imu + 7] = a * px + d * py + g * pz
        value[imu + 8] = b * px + e * py + h * pz
        value[imu + 9] = c * px + f * py + i * pz
        truth = value[imu + 10 :]
        for k in range(7):
            truth[k] = base[k]
        px, py, pz = base[7], base[8], base[9]
        truth[7] = a * px + d * py + g * pz
        truth[8] = b * px + e * py + h * pz
        truth[9] = c * px + f * py + i * pz
        for k in range(3):
            truth[10 + k] = value[imu + 4 + k]
            total += base[k] + base[7 + k]
        for k in range(touches.shape[1]):
            px, py, pz = row[3 * n + 3 * k], row[3 * n + 3 * k + 1], row[3 * n + 3 * k + 2]
            touches[r, k] = px * px + py * py + pz * pz > threshold * threshold
        if not isfinite(total):
            verdicts[r] = BROKEN
        elif base[2] < limits[0] or abs(atan2(h, i)) > limits[1]:
            verdicts[r] = FALL
        elif abs(asin(max(-1.0, min(1.0, -g)))) > limits[2]:
            verdicts[r] = FALL
    return values, touches, verdicts


def robot_state(tick: int, t: float, values: np.ndarray, touches: np.ndarray) -> RobotState:
    """`RobotState` of a row of `readings`, as views.

    Args:
        tick: Control periods since reset.
        t: Time [s].
        values: Row of the signals.
        touches: Row of the feet that touch the ground, (m / 3,).
    """
    return unpacked(tick, t, values[:-BASE], touches)


def ground_truth(tick: int, t: float, values: np.ndarray) -> GroundTruth:
    """`GroundTruth` of a row of `readings`, as views."""
    at = len(values) - BASE
    return GroundTruth(
        tick, t, values[at : at + 3], values[at + 3 : at + 7], values[at + 7 : at + 10],
        values[at + 10 :],
    )  # fmt: skip


def fall_reason(values: np.ndarray, limits: FallLimits) -> str | None:
    """Reason why the robot counts as fallen, or None. Source: the author's hyq_ml, hyq/physics.py.

    Args:
        values: Row of `readings`.
        limits: Limits of height, roll and pitch.
    """
    _, _, height, *orientation = values[len(values) - BASE :][:7].tolist()
    if height < limits.height:
        return f"base height {height:.3f} m is below {limits.height:g} m"
    roll, pitch = roll_pitch(rotation_matrix(orientation))
    if abs(roll) > limits.roll:
        return f"roll {roll:.3f} rad is beyond {limits.roll:g} rad"
    if abs(pitch) > limits.pitch:
        return f"pitch {pitch:.3f} rad is beyond {limits.pitch:g} rad"
    return None
