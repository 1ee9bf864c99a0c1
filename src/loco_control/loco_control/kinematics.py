# SPDX-License-Identifier: Apache-2.0
"""Closed-form kinematics of the HyQ leg: where the foot is, how it moves, and back.

Base frame: origin between the four HAA axes, x forward, y left, z up. With
s_x = +1 in front, -1 behind and s_y = +1 left, -1 right, a foot is at

    X = -(l1 sin hfe + l2 sin(hfe + kfe))         ahead of its hip
    D = l0 + l1 cos hfe + l2 cos(hfe + kfe)       below its hip, along the leg plane
    x = s_x hip_x + X,  y = s_y hip_y - s_y D sin haa,  z = -D cos haa

so HAA is negative outwards on both sides, and knees point to each other.
Source: hyq-description; the RCF uses generated code for the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit

from .exceptions import ParameterError
from .names import LEGS
from .params import Params, parameter

FRONT = np.array([1.0, 1.0, -1.0, -1.0])  # s_x per leg
LEFT = np.array([1.0, -1.0, 1.0, -1.0])  # s_y per leg


@dataclass(frozen=True)
class LegGeometry(Params):
    """Lengths of a four-legged robot with HyQ's leg: HAA about x, HFE and KFE about y.

    Source: hyq-description.
    """

    hip_x: float = parameter(0.3735, "hip (HAA) ahead of or behind the trunk centre", "m", low=0.0)
    hip_y: float = parameter(0.207, "hip (HAA) beside the trunk centre", "m", low=0.0)
    hip_length: float = parameter(0.08, "from HAA down to HFE", "m", low=0.0)
    thigh_length: float = parameter(0.35, "from HFE to KFE", "m", low=0.01)
    shank_length: float = parameter(0.341, "from KFE to the foot centre", "m", low=0.01)
    foot_radius: float = parameter(0.02175, "radius of the foot sphere", "m", low=0.0)
    haa_range: tuple[float, float] = parameter(
        (math.radians(-70.0), math.radians(25.0)), "range of HAA", "rad"
    )
    hfe_range: tuple[float, float] = parameter(
        (math.radians(-50.0), math.radians(70.0)), "range of HFE in front, mirrored behind", "rad"
    )
    kfe_range: tuple[float, float] = parameter(
        (math.radians(-140.0), math.radians(-20.0)), "range of KFE in front, mirrored behind", "rad"
    )

    def lengths(self) -> np.ndarray:
        """What the kernels need: hip_x, hip_y, l0, l1, l2 [m] and cos of the knee range."""
        bent, straight = (math.cos(angle) for angle in self.kfe_range)
        leg = (self.hip_length, self.thigh_length, self.shank_length)
        return np.array([self.hip_x, self.hip_y, *leg, bent, straight])


HYQ = LegGeometry()


def joint_limits(geometry: LegGeometry = HYQ) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest position of each joint [rad], each (12,)."""
    front = np.array([geometry.haa_range, geometry.hfe_range, geometry.kfe_range])  # (3, 2)
    behind = np.array([front[0], -front[1, ::-1], -front[2, ::-1]])
    limits = np.concatenate([front, front, behind, behind])
    return limits[:, 0], limits[:, 1]


def foot_position(q: np.ndarray, geometry: LegGeometry = HYQ) -> np.ndarray:
    """Feet in the base frame [m], (4, 3), from joint positions [rad], (12,) or (4, 3)."""
    return feet_and_jacobians(_legs(q), geometry.lengths())[0]


def jacobian(q: np.ndarray, geometry: LegGeometry = HYQ) -> np.ndarray:
    """Derivative d foot / d q of each leg in the base frame [m/rad], (4, 3, 3)."""
    return feet_and_jacobians(_legs(q), geometry.lengths())[1]


def joint_position(feet: np.ndarray, geometry: LegGeometry = HYQ) -> np.ndarray:
    """Joint positions [rad], (12,), that put the feet at `feet`, base frame [m], (4, 3).

    Raises:
        ParameterError: A foot is out of reach for the range of the knee.
    """
    feet = np.ascontiguousarray(feet, dtype=float).reshape(4, 3)
    q = inverse(feet, np.zeros((4, 3)), geometry.lengths())[0]
    missed = np.linalg.norm(foot_position(q, geometry) - feet, axis=1)
    worst = int(np.argmax(missed))
    if not missed[worst] < 1e-6:
        raise ParameterError(
            f"foot {LEGS[worst]} at {np.round(feet[worst], 4).tolist()} m in the base frame is out "
            f"of reach by {missed[worst]:.3g} m (knee range {geometry.kfe_range} rad)"
        )
    return q


def joint_velocity(
    q: np.ndarray, foot_velocity: np.ndarray, geometry: LegGeometry = HYQ
) -> np.ndarray:
    """Joint velocities [rad/s], (12,), that move the feet at `foot_velocity` [m/s], (4, 3)."""
    velocity = np.asarray(foot_velocity, dtype=float).reshape(4, 3, 1)
    return np.linalg.solve(jacobian(q, geometry), velocity).ravel()


def _legs(q: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(q, dtype=float).reshape(4, 3)


@njit(cache=True)
def feet_and_jacobians(q, lengths):
    """Kernel of `foot_position` and `jacobian`: q (4, 3) to feet (4, 3) and J (4, 3, 3)."""
    hip_x, hip_y, l0, l1, l2 = lengths[0], lengths[1], lengths[2], lengths[3], lengths[4]
    feet, jac = np.empty((4, 3)), np.zeros((4, 3, 3))
    for leg in range(4):
        left, hfe, knee = LEFT[leg], q[leg, 1], q[leg, 1] + q[leg, 2]
        sin_haa, cos_haa = math.sin(q[leg, 0]), math.cos(q[leg, 0])
        ahead = -(l1 * math.sin(hfe) + l2 * math.sin(knee))
        below = l0 + l1 * math.cos(hfe) + l2 * math.cos(knee)
        feet[leg, 0] = FRONT[leg] * hip_x + ahead
        feet[leg, 1] = left * (hip_y - below * sin_haa)
        feet[leg, 2] = -below * cos_haa
        jac[leg, 1, 0], jac[leg, 2, 0] = -left * below * cos_haa, below * sin_haa
        jac[leg, 0, 1], jac[leg, 0, 2] = l0 - below, -l2 * math.cos(knee)
        for joint, d_below in ((1, ahead), (2, -l2 * math.sin(knee))):
            jac[leg, 1, joint] = -left * d_below * sin_haa
            jac[leg, 2, joint] = -d_below * cos_haa
    return feet, jac


@njit(cache=True)
def inverse(feet, velocity, lengths):
    """Joint positions and velocities, each (12,), of feet (4, 3) that move at `velocity` (4, 3).

    The knee stays inside its range, so a foot out of reach is approached, not an error.
    """
    hip_x, hip_y, l0, l1, l2 = lengths[0], lengths[1], lengths[2], lengths[3], lengths[4]
    q, dq = np.empty(12), np.empty(12)
    for leg in range(4):
        x = feet[leg, 0] - FRONT[leg] * hip_x
        out, v_out = hip_y - LEFT[leg] * feet[leg, 1], -LEFT[leg] * velocity[leg, 1]
        below = math.hypot(out, feet[leg, 2])
        haa = math.atan2(out, -feet[leg, 2])
        length = below - l0
        cos_knee = (x * x + length * length - l1 * l1 - l2 * l2) / (2.0 * l1 * l2)
        kfe = -FRONT[leg] * math.acos(min(max(cos_knee, lengths[5]), lengths[6]))
        hfe = math.atan2(-x, length) - math.atan2(l2 * math.sin(kfe), l1 + l2 * math.cos(kfe))
        v_x, sin_haa, cos_haa = velocity[leg, 0], math.sin(haa), math.cos(haa)
        v_below = sin_haa * v_out - cos_haa * velocity[leg, 2]
        sin_foot, cos_foot = l2 * math.sin(hfe + kfe), l2 * math.cos(hfe + kfe)
        det = l1 * l2 * math.sin(kfe)
        q[3 * leg], q[3 * leg + 1], q[3 * leg + 2] = haa, hfe, kfe
        dq[3 * leg] = (cos_haa * v_out + sin_haa * velocity[leg, 2]) / below
        dq[3 * leg + 1] = (cos_foot * v_below - sin_foot * v_x) / det
        dq[3 * leg + 2] = -(length * v_below + x * v_x) / det
    return q, dq


@njit(cache=True)
def turned_feet(q, dq, R, spin, lengths):
    """Feet, Jacobians and foot velocities in a frame turned by R (3, 3) from the base.

    The frame keeps its axes while the base turns in it at `spin` [rad/s], (3,), so the
    velocity of foot p is R J dq + spin x p. Shapes (4, 3), (4, 3, 3), (4, 3).
    """
    feet_in_base, jac_in_base = feet_and_jacobians(q, lengths)
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
