# SPDX-License-Identifier: Apache-2.0
"""Division of joint friction into constraints of the engine and plain torques.

A joint too fast to be stopped within one step gets its whole friction as a torque against
the motion, at no cost. Only slow joints need a constraint of the engine, which is one more
row to solve for each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

MARGIN = 4.0  # fast joint: speed above this multiple of what friction can stop in one step


def stopped_per_torque(inertia: np.ndarray, dt: float) -> np.ndarray:
    """Limit speed of slow joints per friction torque [rad/s / (N·m)], (n,).

    Args:
        inertia: Joint-space inertia matrix [kg·m²], (n, n).
        dt: Physics step [s].
    """
    return MARGIN * dt * np.diag(np.linalg.inv(inertia))


@njit(cache=True, error_model="numpy", forceinline=True)
def split(budget, dq, slow):
    """Braking torque for the engine's constraints, and torque to apply [N·m], both (n,).

    Args:
        budget: Friction torque of each joint [N·m], (n,).
        dq: Joint velocities [rad/s], (n,).
        slow: Values of `stopped_per_torque`, (n,).
    """
    motor, drag = np.zeros(len(budget)), np.zeros(len(budget))
    for j in range(len(budget)):
        if abs(dq[j]) <= slow[j] * budget[j]:
            motor[j] = budget[j]
        else:
            drag[j] = -budget[j] if dq[j] > 0.0 else budget[j]
    return motor, drag
