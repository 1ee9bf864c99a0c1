# SPDX-License-Identifier: Apache-2.0
"""Torque of a learned correction: a smooth function of the state and torque of a joint.

Position, velocity, and torque of drive and spring are normalised by the fitted region, in which
every feature lies between -1 and 1. Outside of it the correction fades to zero.
"""

from __future__ import annotations

from math import tanh

from ..jit import kernel

REGION = 7  # number of constants before the weights
SMOOTHING = 0.02  # speed below which its sign is smoothed, share of the fitted speed (taste)
FADE = 0.5  # width of the fade to zero outside of the region, in half ranges (taste)


@kernel
def fade(x: float) -> float:
    """1 for |x| up to 1, 0 from `1 + FADE` on, and a smooth step between them."""
    excess = (abs(x) - 1.0) / FADE
    if excess <= 0.0:
        return 1.0
    return 0.0 if excess >= 1.0 else 1.0 - excess * excess * (3.0 - 2.0 * excess)


@kernel
def learned_torque(q: float, dq: float, tau: float, late: float, row) -> float:
    """Torque that a learned correction adds to a joint [N·m, or N where it slides].

    Args:
        q: Position [rad or m].
        dq: Velocity [rad/s or m/s].
        tau: Torque of drive and spring, which depends on the commands [N·m or N].
        late: `tau` through a first-order lag [N·m or N].
        row: Centre and half range of the positions, largest speed, centre and half range of the
            torque, limit of the correction, a constant of the lag of `late`, and the weight of
            each feature, (25,).
    """
    x, v, u = (q - row[0]) / row[1], dq / row[2], (tau - row[3]) / row[4]
    validity = fade(x) * fade(v) * fade(u)
    if validity == 0.0:
        return 0.0
    x, v, u = min(max(x, -1.0), 1.0), min(max(v, -1.0), 1.0), min(max(u, -1.0), 1.0)
    change = min(max((tau - late) / row[4], -1.0), 1.0)
    side = tanh(v / SMOOTHING)
    x2 = x * x
    w = row[REGION:]
    total = w[0] + w[1] * x + w[2] * (2.0 * x2 - 1.0) + w[3] * (4.0 * x2 - 3.0) * x
    total += w[4] * (8.0 * x2 * (x2 - 1.0) + 1.0) + w[5] * ((16.0 * x2 - 20.0) * x2 + 5.0) * x
    total += (w[6] + w[7] * v * v) * v + w[8] * side
    total += (w[9] + w[10] * u + w[11] * u * u) * u
    total += w[12] * x * v + w[13] * x * u + w[14] * v * u
    total += (w[15] * x + w[16] * u) * side + w[17] * change
    return min(max(validity * total, -row[5]), row[5])
