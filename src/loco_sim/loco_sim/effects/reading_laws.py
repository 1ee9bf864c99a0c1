# SPDX-License-Identifier: Apache-2.0
"""Compiled arithmetic of the effects on sensors: each changes a vector of readings in place."""

from __future__ import annotations

from math import floor, sqrt

import numpy as np
from numba import njit


@njit(cache=True)
def bend(values, joints, n, rest, quadratic, cubic):
    """Q <- q + quadratic x^2 + cubic x^3 about `rest`, and dq with the slope of it.

    Args:
        values: Readings: n joint positions, n joint velocities and more, in rows.
        joints: Indices of the joints, (k,).
        n: Number of joints.
        rest: Angle at which x is zero [rad], (k,).
        quadratic: [1/rad].
        cubic: [1/rad²].
    """
    for row in range(len(values)):
        for k in range(len(joints)):
            j = joints[k]
            x = values[row, j] - rest[k]
            values[row, n + j] *= 1.0 + (2.0 * quadratic + 3.0 * cubic * x) * x
            values[row, j] += (quadratic + cubic * x) * x * x


@njit(cache=True)
def quantise(values, joints, step):
    """Q <- nearest multiple of a step [rad] for some joints."""
    for k in range(len(joints)):
        j = joints[k]
        values[j] = step * floor(values[j] / step + 0.5)


@njit(cache=True)
def scale(values, factor, extra):
    """Y <- factor y + extra, element by element."""
    for i in range(len(values)):
        values[i] = factor[i] * values[i] + extra[i]


@njit(cache=True)
def product(values, at, a, b):
    """Quaternion a b (x y z w) into ``values[at:at + 4]``; a and b may be part of values."""
    ax, ay, az, aw = a[0], a[1], a[2], a[3]
    bx, by, bz, bw = b[0], b[1], b[2], b[3]
    values[at] = aw * bx + ax * bw + ay * bz - az * by
    values[at + 1] = aw * by - ax * bz + ay * bw + az * bx
    values[at + 2] = aw * bz + ax * by - ay * bx + az * bw
    values[at + 3] = aw * bw - ax * bx - ay * by - az * bz


@njit(cache=True)
def tilt(values, at, turn, back):
    """An IMU that is turned: orientation, angular velocity and force from ``at`` on.

    Args:
        values: Readings.
        at: Index at which the orientation begins; the two vectors follow it.
        turn: Turn of the IMU in the base, x y z w, (4,).
        back: Rotation matrix of that turn, transposed, (3, 3).
    """
    product(values, at, values[at : at + 4], turn)
    for first in (at + 4, at + 7):
        x, y, z = values[first], values[first + 1], values[first + 2]
        for row in range(3):
            values[first + row] = back[row, 0] * x + back[row, 1] * y + back[row, 2] * z


@njit(cache=True)
def between(values, old, new, share, at):
    """Values between an older and a newer sample; ``values[at:at + 4]`` is a quaternion."""
    for i in range(len(values)):
        values[i] = old[i] + share * (new[i] - old[i])
    size = 0.0
    for i in range(at, at + 4):
        size += values[i] * values[i]
    for i in range(at, at + 4):
        values[i] /= sqrt(size)


@njit(cache=True)
def add_at(values, joints, first, extra, sign):
    """``values[first + joint] += sign extra[k]`` for each joint."""
    for k in range(len(joints)):
        values[first + joints[k]] += sign * extra[k]


@njit(cache=True)
def add_noise(values, std, drawn, turn):
    """``values += std * drawn`` but for the orientation, for whose four there are three drawn.

    Args:
        values: Readings, (n,).
        std: Standard deviations, (n,).
        drawn: Normal numbers, (n - 1,).
        turn: Index at which the orientation begins.
    """
    for i in range(turn):
        values[i] += std[i] * drawn[i]
    for i in range(turn + 4, len(values)):
        values[i] += std[i] * drawn[i - 1]


@njit(cache=True)
def move_back(q, dq, joints, memory):
    """Command as a motor behind a spring sees it: less what the spring is bent by."""
    for k in range(len(joints)):
        q[joints[k]] -= memory[k, 2]
        dq[joints[k]] -= memory[k, 3]


@njit(cache=True)
def followed(values, share):
    """First-order lag of values, (T,), from 0: it comes nearer by a share at each."""
    made, at = np.empty(len(values)), 0.0
    for i in range(len(values)):
        at += share * (values[i] - at)
        made[i] = at
    return made
