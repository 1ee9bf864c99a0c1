# SPDX-License-Identifier: Apache-2.0
"""Torque and energy of the springs of `robot.spring`, from parameter rows."""

from __future__ import annotations

import math

import numpy as np

from ..jit import inlined
from ..robot.spring import LINEAR, PRETENSION


@inlined
def spring_torque(q: float, dq: float, row: np.ndarray) -> float:
    """Torque of a joint's spring and damper [N·m, or N if prismatic].

    Args:
        q: Joint position [rad or m].
        dq: Joint velocity [rad/s or m/s].
        row: `SpringParams.row`, or zeros for no spring.
    """
    tau = -row[2] * dq
    if row[0] == LINEAR:
        tau -= row[1] * (q - row[3])
    elif row[0] == PRETENSION:
        femur, tibia = row[5], row[6]
        length = math.sqrt(femur**2 + tibia**2 - 2.0 * femur * tibia * math.cos(q))
        tau -= row[1] * (length - row[4]) * femur * tibia * math.sin(q) / length
    return tau


def spring_torques(q: np.ndarray, dq: np.ndarray, row: np.ndarray) -> np.ndarray:
    """As `spring_torque`, at T positions and velocities, (T,)."""
    return np.array([spring_torque(*at, row) for at in zip(q, dq, strict=True)])


def spring_energy(q: float, row: np.ndarray) -> float:
    """Energy stored in a joint's spring [J]."""
    if row[0] == PRETENSION:
        femur, tibia = row[5], row[6]
        length = math.sqrt(femur**2 + tibia**2 - 2.0 * femur * tibia * math.cos(q))
        return 0.5 * row[1] * (length - row[4]) ** 2
    return 0.5 * row[1] * (q - row[3]) ** 2
