# SPDX-License-Identifier: Apache-2.0
"""Closed-form forward and inverse kinematics of four legs with three joints each.

Each leg has HAA about x, then HFE and KFE about y. Canonical angles are 0 where thigh and
shank hang straight down; HAA is positive inwards, HFE and KFE swing the foot backwards. With
s = +1 on the left and -1 on the right, a foot is at

    X = -(l1 sin hfe + l2 sin(hfe + kfe))         ahead of its hip
    D = l0 + l1 cos hfe + l2 cos(hfe + kfe)       below its HAA axis, along the leg plane
    x = hip_x + X
    y = s (hip_y - D sin haa + side cos haa)
    z = hip_z - D cos haa - side sin haa

in the base frame (x forward, y left, z up), where `side` is how far the plane of thigh and
shank lies outside of the HAA axis. With q the URDF angle, the canonical angle is sign (q - zero).

A robot is an array with a row per leg (lf rf lh rh) and columns named by `geometry.COLUMNS`; it is
read from a URDF by `loco_sim.robot.legs`. HyQ's sides, zeros and signs are exactly 0, 0 and 1,
so they do not change its results.
Source: hyq-description; the RCF uses generated code for the same.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..exceptions import ParameterError
from ..names import LEGS
from .geometry import (
    DOWN,
    EXTENDED,
    FLEXED,
    HIP_X,
    HIP_Y,
    HIP_Z,
    HYQ,
    KNEE,
    LEFT,
    SHANK,
    SIDE,
    SIGN,
    THIGH,
    ZERO,
)  # fmt: skip


def foot_position(q: np.ndarray, legs: np.ndarray = HYQ) -> np.ndarray:
    """Feet in the base frame [m], (4, 3), from joint positions [rad], (12,) or (4, 3)."""
    return feet_and_jacobians(_by_leg(q), legs)[0]


def jacobian(q: np.ndarray, legs: np.ndarray = HYQ) -> np.ndarray:
    """Derivative d foot / d q of each leg in the base frame [m/rad], (4, 3, 3)."""
    return feet_and_jacobians(_by_leg(q), legs)[1]


def joint_position(feet: np.ndarray, legs: np.ndarray = HYQ) -> np.ndarray:
    """Joint positions [rad], (12,), that put the feet at `feet`, base frame [m], (4, 3).

    Raises:
        ParameterError: A foot is out of reach for the range of the knee.
    """
    feet = np.ascontiguousarray(feet, dtype=float).reshape(4, 3)
    q = inverse(feet, np.zeros((4, 3)), legs)[0]
    missed = np.linalg.norm(foot_position(q, legs) - feet, axis=1)
    index = int(np.argmax(missed))
    if not missed[index] < 1e-6:
        knee = np.arccos(legs[index, [EXTENDED, FLEXED]]).round(3).tolist()
        raise ParameterError(
            f"foot {LEGS[index]} at {np.round(feet[index], 4).tolist()} m in the base frame is out "
            f"of reach by {missed[index]:.3g} m (the knee bends by {knee[0]} to {knee[1]} rad)"
        )
    return q


def _by_leg(q: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(q, dtype=float).reshape(4, 3)


@njit(cache=True)
def feet_and_jacobians(q, legs):
    """Kernel of `foot_position` and `jacobian`: q (4, 3) to feet (4, 3) and J (4, 3, 3)."""
    feet, jac = np.empty((4, 3)), np.zeros((4, 3, 3))
    for leg in range(4):
        row, left = legs[leg], LEFT[leg]
        side, l0, l1, l2 = row[SIDE], row[DOWN], row[THIGH], row[SHANK]
        haa = row[SIGN] * (q[leg, 0] - row[ZERO])
        hfe = row[SIGN + 1] * (q[leg, 1] - row[ZERO + 1])
        knee = hfe + row[SIGN + 2] * (q[leg, 2] - row[ZERO + 2])
        sin_haa, cos_haa = math.sin(haa), math.cos(haa)
        x = -(l1 * math.sin(hfe) + l2 * math.sin(knee))
        below = l0 + l1 * math.cos(hfe) + l2 * math.cos(knee)
        feet[leg, 0] = row[HIP_X] + x
        feet[leg, 1] = left * (row[HIP_Y] - below * sin_haa + side * cos_haa)
        feet[leg, 2] = row[HIP_Z] - below * cos_haa - side * sin_haa
        jac[leg, 1, 0] = -left * below * cos_haa - left * side * sin_haa
        jac[leg, 2, 0] = below * sin_haa - side * cos_haa
        jac[leg, 0, 1], jac[leg, 0, 2] = l0 - below, -l2 * math.cos(knee)
        for joint, d_below in ((1, x), (2, -l2 * math.sin(knee))):
            jac[leg, 1, joint] = -left * d_below * sin_haa
            jac[leg, 2, joint] = -d_below * cos_haa
        for joint in range(3):
            for axis in range(3):
                jac[leg, axis, joint] *= row[SIGN + joint]
    return feet, jac


@njit(cache=True)
def inverse(feet, velocity, legs):
    """Joint positions and velocities, each (12,), of feet (4, 3) that move at `velocity` (4, 3).

    The knee stays inside its range; a foot out of reach is approached as closely as possible.
    """
    q, dq, canonical = np.empty(12), np.empty(12), np.empty(3)
    for leg in range(4):
        row = legs[leg]
        side, l0, l1, l2 = row[SIDE], row[DOWN], row[THIGH], row[SHANK]
        x, z = feet[leg, 0] - row[HIP_X], feet[leg, 2] - row[HIP_Z]
        out, v_out = row[HIP_Y] - LEFT[leg] * feet[leg, 1], -LEFT[leg] * velocity[leg, 1]
        reach = math.hypot(out, z)
        below = math.sqrt(max((reach - side) * (reach + side), 1e-12))
        haa = math.atan2(out, -z) + math.atan2(side, below)
        length = below - l0
        cos_knee = (x * x + length * length - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
        kfe = row[KNEE] * math.acos(min(max(cos_knee, row[FLEXED]), row[EXTENDED]))
        hfe = math.atan2(-x, length) - math.atan2(l2 * math.sin(kfe), l1 + l2 * math.cos(kfe))
        v_x, sin_haa, cos_haa = velocity[leg, 0], math.sin(haa), math.cos(haa)
        d_haa = (cos_haa * v_out + sin_haa * velocity[leg, 2]) / below
        v_below = sin_haa * v_out - cos_haa * velocity[leg, 2] - side * d_haa
        sin_foot, cos_foot = l2 * math.sin(hfe + kfe), l2 * math.cos(hfe + kfe)
        det = l1 * l2 * math.sin(kfe)
        canonical[0], canonical[1], canonical[2] = haa, hfe, kfe
        dq[3 * leg] = d_haa
        dq[3 * leg + 1] = (cos_foot * v_below - sin_foot * v_x) / det
        dq[3 * leg + 2] = -(length * v_below + x * v_x) / det
        for joint in range(3):
            sign, zero = row[SIGN + joint], row[ZERO + joint]
            q[3 * leg + joint] = zero + sign * canonical[joint]
            dq[3 * leg + joint] *= sign
    return q, dq


@njit(cache=True)
def turned_feet(q, dq, R, spin, legs):
    """Feet, Jacobians and foot velocities in a frame turned by R (3, 3) from the base.

    The frame keeps its axes while the base turns in it at `spin` [rad/s], (3,), so the
    velocity of foot p is R J dq + spin x p. Shapes (4, 3), (4, 3, 3), (4, 3).
    """
    feet_in_base, jac_in_base = feet_and_jacobians(q, legs)
    feet, jac, velocity = np.zeros((4, 3)), np.zeros((4, 3, 3)), np.empty((4, 3))
    for leg in range(4):
        for row in range(3):
            for k in range(3):
                feet[leg, row] += R[row, k] * feet_in_base[leg, k]
                for joint in range(3):
                    jac[leg, row, joint] += R[row, k] * jac_in_base[leg, k, joint]
        x, y, z = feet[leg, 0], feet[leg, 1], feet[leg, 2]
        velocity[leg, 0] = spin[1] * z - spin[2] * y
        velocity[leg, 1] = spin[2] * x - spin[0] * z
        velocity[leg, 2] = spin[0] * y - spin[1] * x
        for row in range(3):
            for joint in range(3):
                velocity[leg, row] += jac[leg, row, joint] * dq[leg, joint]
    return feet, jac, velocity
