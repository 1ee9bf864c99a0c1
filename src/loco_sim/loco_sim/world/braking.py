# SPDX-License-Identifier: Apache-2.0
"""The joints that the engine must brake, and those that a plain torque brakes as well.

A joint too fast to be stopped within one step gets its whole budget of friction: a
torque against the motion, which costs nothing. Only the slow ones need the engine's
constraint, a row more to solve for each.
"""

from __future__ import annotations

import numpy as np
from numba import njit

MARGIN = 4.0  # fast is: this many times what friction could stop in one step


def stopped_per_torque(inertia: np.ndarray, dt: float) -> np.ndarray:
    """Speed below which a joint counts as slow, per friction torque [rad/s / (N·m)], (n,).

    Args:
        inertia: Inertia that the joints feel [kg·m²], (n, n).
        dt: Physics step [s].
    """
    return MARGIN * dt * np.diag(np.linalg.inv(inertia))


@njit(cache=True, error_model="numpy", forceinline=True)
def split(budget, dq, slow):
    """Stopping torque for the engine, and torque to apply [N·m], both (n,).

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
