# SPDX-License-Identifier: Apache-2.0
"""Compiled arithmetic of the effects on sensors and commands: each changes values in place."""

from __future__ import annotations

from math import copysign, floor, sqrt

import numpy as np
from numba import njit


@njit(cache=True)
def bend(values, joints, n, rest, quadratic, cubic):
    """Law q <- q + quadratic x^2 + cubic x^3 with x = q - rest, and dq by its derivative.

    Args:
        values: Readings: n joint positions, n joint velocities and more, in rows.
        joints: Indices of the joints, (k,).
        n: Number of joints.
        rest: Angle at which x is zero [rad], (k,).
        quadratic: Coefficient of x^2 [1/rad], (k,).
        cubic: Coefficient of x^3 [1/rad²], (k,).
    """
    for row in range(len(values)):
        for k in range(len(joints)):
            j = joints[k]
            x = values[row, j] - rest[k]
            values[row, n + j] *= 1.0 + (2.0 * quadratic + 3.0 * cubic * x) * x
            values[row, j] += (quadratic + cubic * x) * x * x


@njit(cache=True)
def quantise(values, joints, step):
    """Law q <- nearest multiple of a step [rad], for some joints."""
    for k in range(len(joints)):
        j = joints[k]
        values[j] = step * floor(values[j] / step + 0.5)


@njit(cache=True)
def scale(values, factor, extra):
    """Law y <- factor y + extra, element by element."""
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
    """Readings of a rotated IMU: orientation, angular velocity and specific force from ``at`` on.

    Args:
        values: Readings.
        at: Index at which the orientation begins; the two vectors follow it.
        turn: Rotation of the IMU in the base, x y z w, (4,).
        back: Transposed matrix of that rotation, (3, 3).
    """
    product(values, at, values[at : at + 4], turn)
    for first in (at + 4, at + 7):
        x, y, z = values[first], values[first + 1], values[first + 2]
        for row in range(3):
            values[first + row] = back[row, 0] * x + back[row, 1] * y + back[row, 2] * z


@njit(cache=True)
def between(values, old, new, share, at):
    """Interpolation between an older and a newer sample; ``values[at:at + 4]`` is a quaternion."""
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
    """``values += std * drawn``, except the orientation: three random numbers for its four values.

    Args:
        values: Readings, (n,).
        std: Standard deviations, (n,).
        drawn: Standard normal random numbers, (n - 1,).
        turn: Index of the first value of the orientation.
    """
    for i in range(turn):
        values[i] += std[i] * drawn[i]
    for i in range(turn + 4, len(values)):
        values[i] += std[i] * drawn[i - 1]


@njit(cache=True)
def move_back(q, dq, joints, memory):
    """Command relative to a motor with a series spring: the spring's deflection is subtracted."""
    for k in range(len(joints)):
        q[joints[k]] -= memory[k, 2]
        dq[joints[k]] -= memory[k, 3]


@njit(cache=True)
def followed(values, share):
    """First-order lag of values, (T,), from 0: each sample covers `share` of the difference."""
    filtered, at = np.empty(len(values)), 0.0
    for i in range(len(values)):
        at += share * (values[i] - at)
        filtered[i] = at
    return filtered


@njit(cache=True)
def slew(targets, joints, speed, dt):
    """Limit the rate of desired positions from row to row, and desired velocities.

    Args:
        targets: Desired positions, desired velocities and more of each physics step, (T, m, n).
        joints: Indices of the joints, (k,).
        speed: Largest rate [rad/s].
        dt: Physics step [s].
    """
    step = speed * dt
    for row in range(len(targets)):
        for k in range(len(joints)):
            j = joints[k]
            if row > 0:
                change = targets[row, 0, j] - targets[row - 1, 0, j]
                if abs(change) > step:
                    targets[row, 0, j] = targets[row - 1, 0, j] + copysign(step, change)
            targets[row, 1, j] = min(max(targets[row, 1, j], -speed), speed)
