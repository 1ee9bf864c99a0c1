# SPDX-License-Identifier: Apache-2.0
"""Effective inertia at joints, and springs of the hinges that effects add within links."""

from __future__ import annotations

import numpy as np
from numba import njit


def felt(mass: np.ndarray, coordinates: list[int], free: list[int]) -> np.ndarray:
    """Effective inertia of some coordinates while others move freely, (n, n).

    M_qq - M_qb M_bb^-1 M_bq.

    Args:
        mass: Mass matrix of all coordinates [kg·m²], (m, m).
        coordinates: Indices of the n coordinates.
        free: Indices of the freely moving coordinates.
    """
    joints, cross = mass[np.ix_(coordinates, coordinates)], mass[np.ix_(coordinates, free)]
    if not free:
        return joints
    return joints - cross @ np.linalg.solve(mass[np.ix_(free, free)], cross.T)


def inertia(mass: np.ndarray, rows: list[int]) -> list[float]:
    """Effective inertia at each hinge while all other coordinates move freely [kg·m²].

    Args:
        mass: Mass matrix of all coordinates [kg·m²], (m, m).
        rows: Indices of the hinges.
    """
    free = np.diag(np.linalg.inv(mass))
    return [1.0 / float(free[row]) for row in rows]


@njit(cache=True)
def torque(
    spring: tuple[float, float], state: tuple[float, float], inertia: float, dt: float
) -> float:
    """Implicit torque of spring and damper of a hinge, stable for any stiffness [N·m].

    Args:
        spring: Stiffness [N·m/rad] and damping [N·m·s/rad].
        state: Angle [rad] and velocity [rad/s].
        inertia: Smallest effective inertia at the hinge [kg·m²].
        dt: Physics step [s].
    """
    (k, d), (angle, rate) = spring, state
    held = k * (angle + dt * rate) + d * rate
    return -held / (1.0 + dt * (d + dt * k) / inertia)
