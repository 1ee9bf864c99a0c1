# SPDX-License-Identifier: Apache-2.0
"""Division of joint friction into constraints of the engine and plain torques.

A joint too fast to be stopped within one step gets its whole friction as a torque against
the motion, at no cost. Only slow joints need a constraint of the engine, which is one more
row to solve for each.
"""

from __future__ import annotations

import numpy as np

from ..jit import inlined

MARGIN = 4.0  # fast joint: speed above this multiple of what friction can stop in one step


def stopped_per_torque(inertia: np.ndarray, dt: float) -> np.ndarray:
    """Limit speed of slow joints per friction torque [rad/s / (N·m)], (n,).

    Args:
        inertia: Joint-space inertia matrix [kg·m²], (n, n).
        dt: Physics step [s].
    """
    return MARGIN * dt * np.diag(np.linalg.inv(inertia))


@inlined
def split(budget, dq, stop_ratio, both):
    """Divide friction into braking torques of the engine's constraints and torques to apply.

    Args:
        budget: Friction torque of each joint [N·m], (n,).
        dq: Joint velocities [rad/s], (n,).
        stop_ratio: Values of `stopped_per_torque`, (n,).
        both: Result: braking torques of the constraints, then torques to apply [N·m], (2, n).
    """
    for j in range(len(budget)):
        both[0, j] = both[1, j] = 0.0
        if abs(dq[j]) <= stop_ratio[j] * budget[j]:
            both[0, j] = budget[j]
        else:
            both[1, j] = -budget[j] if dq[j] > 0.0 else budget[j]
