# SPDX-License-Identifier: Apache-2.0
"""Compiled arithmetic of the stance estimate and the trunk controller, run at every tick.

Parameters and state between ticks are in `controller` and `trunk`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..legs.kinematics import feet_and_jacobians, turned_feet
from ..orientation import roll_pitch_yaw, rotation_base_to_horizontal, wrap_angle
from .forces import dot, minimum_forces, nullspace_forces

GAINS = (  # fields of `TrunkParams`, in the order of the vector `gains`
    *("roll_kp", "roll_kd", "pitch_kp", "pitch_kd", "yaw_kp", "yaw_kd"),
    *("height_kp", "height_kd", "mass", "gravity"),
)
MAX_HEADING_ERROR = math.radians(45.0)
SLOWEST_TURN = 1e-3  # slower turning rates count as zero, so that the heading is held [rad/s]


@njit(cache=True)
def foot_heights(q, ground, legs):
    """Heights of the feet [m], (4,), over `ground`, both along z of the base; q (12,)."""
    feet, _ = feet_and_jacobians(q.reshape(4, 3), legs)
    return feet[:, 2] - ground


@njit(cache=True)
def average_heights(history, newest, height, stance, threshold, hysteresis):
    """Moving average of the foot heights, and which feet are low.

    Args:
        history: Last heights [m], (window, 4); row `newest` is overwritten with `height`.
        newest: Row of the oldest heights, overwritten with the newest.
        height: Heights now [m], (4,).
        stance: Feet that were low before, (4,) bool.
        threshold: Height above which a foot is in swing [m].
        hysteresis: Fraction of the threshold by which a landing foot must be below it.

    Returns:
        Average heights [m], (4,), and the feet that are low, (4,) bool.
    """
    mean, low = np.zeros(4), np.empty(4, dtype=np.bool_)
    for leg in range(4):
        history[newest, leg] = height[leg]
        mean[leg] = history[:, leg].sum() / len(history)
        share = 1.0 if stance[leg] else 1.0 - hysteresis
        low[leg] = mean[leg] < share * threshold
    return mean, low


@njit(cache=True)
def turning_rate(feet, velocity, stance):
    """Turning rate of the trunk in a gait [rad/s], from the lateral velocities of its feet.

    Stance feet move opposite to the trunk, so their velocity to the left decreases with x by the
    rate. Exactly 0 if no foot moves sideways, or if no stance foot is in front of another.

    Args:
        feet: Positions of the target's feet, base frame [m], (4, 3).
        velocity: Velocities of these feet [m/s], (4, 3).
        stance: Feet on the ground, by the gait clock, (4,) bool.
    """
    count, x, y = 0, 0.0, 0.0
    for leg in range(4):
        if stance[leg]:
            count, x, y = count + 1, x + feet[leg, 0], y + velocity[leg, 1]
    square_sum = slope = 0.0
    for leg in range(4):
        if stance[leg]:
            x_lever = feet[leg, 0] - x / count
            square_sum += x_lever * x_lever
            slope += x_lever * (velocity[leg, 1] - y / count)
    rate = -slope / square_sum if square_sum > 1e-6 else 0.0
    return rate if abs(rate) > SLOWEST_TURN else 0.0


@njit(cache=True)
def trunk_wrench(roll, pitch, yaw_error, spin, sunk, rise, gains):
    """Springs and dampers on the trunk: force [N] then moment [N·m], horizontal frame, (6,).

    Args:
        roll: Roll of the trunk [rad].
        pitch: Pitch of the trunk [rad].
        yaw_error: Heading minus desired heading [rad].
        spin: Angular velocity minus desired value, horizontal frame [rad/s], (3,).
        sunk: Desired height minus height [m].
        rise: Vertical velocity [m/s].
        gains: Named by `GAINS`, (10,).
    """
    roll_kp, roll_kd, pitch_kp, pitch_kd, yaw_kp, yaw_kd = gains[:6]
    height_kp, height_kd, mass, gravity = gains[6:]
    yaw_error = min(max(yaw_error, -MAX_HEADING_ERROR), MAX_HEADING_ERROR)
    wrench = np.zeros(6)
    wrench[2] = height_kp * sunk - height_kd * rise + mass * gravity
    wrench[3] = -roll_kp * roll - roll_kd * spin[0]
    wrench[4] = -pitch_kp * pitch - pitch_kd * spin[1]
    wrench[5] = -yaw_kp * yaw_error - yaw_kd * spin[2]
    return wrench


@njit(cache=True)
def standing(stance, values):
    """Rows of `values`, (4, n), of the stance legs."""
    rows, row = np.empty((stance.sum(), values.shape[1])), 0
    for leg in range(4):
        if stance[leg]:
            for i in range(values.shape[1]):
                rows[row, i] = values[leg, i]
            row += 1
    return rows


@njit(cache=True)
def trunk_torque(
    q, dq, orientation, angular_velocity, target_feet, heading, stance, gains, options, legs
):
    """Joint torques of the stance legs, and the desired wrench on the trunk.

    Args:
        q: Joint positions [rad], (12,).
        dq: Joint velocities [rad/s], (12,).
        orientation: Base to world, x y z w, (4,).
        angular_velocity: Base frame [rad/s], (3,).
        target_feet: Feet of the target, base frame [m], (4, 3).
        heading: Desired yaw [rad] and turning rate [rad/s].
        stance: Stance legs, (4,) bool.
        gains: Named by `GAINS`, (10,).
        options: Minimum number of stance legs; null-space mapping or not; pushing only or not.
        legs: Leg geometry, columns named by `legs.geometry.COLUMNS`, (4, 16).

    Returns:
        Joint torque [N·m], (12,), zero for swing legs, and wrench [N, N·m], (6,); both
        zero with too few legs.
    """
    fewest, nullspace, push_only = options
    tau, count = np.zeros((4, 3)), stance.sum()
    if count < fewest:
        return tau.reshape(12), np.zeros(6)
    roll, pitch, yaw = roll_pitch_yaw(orientation)
    R = rotation_base_to_horizontal(roll, pitch)
    spin = np.zeros(3)
    for row in range(3):
        for k in range(3):
            spin[row] += R[row, k] * angular_velocity[k]
    all_feet, all_J, all_velocity = turned_feet(q.reshape(4, 3), dq.reshape(4, 3), R, spin, legs)
    feet, velocity = standing(stance, all_feet), standing(stance, all_velocity)
    J = standing(stance, all_J.reshape(4, 9)).reshape(count, 3, 3)
    height, rise = -feet[:, 2].sum() / count, -velocity[:, 2].sum() / count
    lowest = min(target_feet[0, 2], target_feet[1, 2], target_feet[2, 2], target_feet[3, 2])
    yaw_error, sunk = wrap_angle(yaw - heading[0]), -lowest - height
    spin[2] -= heading[1]
    wrench = trunk_wrench(roll, pitch, yaw_error, spin, sunk, rise, gains)
    forces = nullspace_forces(wrench, feet, J) if nullspace else minimum_forces(wrench, feet)
    i = 0
    for leg in range(4):
        if stance[leg]:
            if push_only:
                forces[i, 2] = max(forces[i, 2], 0.0)
            for joint in range(3):
                tau[leg, joint] = -dot(forces[i], J[i, :, joint])
            i += 1
    return tau.reshape(12), wrench
