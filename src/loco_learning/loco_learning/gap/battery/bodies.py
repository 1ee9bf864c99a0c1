# SPDX-License-Identifier: Apache-2.0
"""Equations of motion of a `tree.Tree`, compiled, in world coordinates.

M(q) ddq + h(q, dq) = tau. The mass matrix is made of the momenta of composite bodies, h of
Newton's and Euler's equations from the tips to the root. Vectors and matrices are tuples of 3
and 9 numbers: arrays of three numbers cost ten times as much, and views of rows twice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

# Columns of `Body.rows`, what a body is,
TURN, PLACE, AXIS, CENTRE, TENSOR = 0, 9, 12, 15, 18
MASS, ARMATURE, DAMPING, LOWER, UPPER, ROWS = range(27, 33)
# and of `Body.links`, where it is and how it moves.
AT, WAY, COM, OMEGA, ALPHA, ACC, FORCE, MOMENT, MIDDLE = range(0, 27, 3)
ROT, INERTIA, WHOLE, HEAVY, LINKS = 27, 36, 45, 54, 55

UNTURNED = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


class Body(NamedTuple):
    """What moves, n bodies, and memory for the functions below."""

    kin: np.ndarray  # body that a joint hangs on, -1 is the world, and 1 if it slides, (n, 2)
    rows: np.ndarray  # (n, ROWS)
    links: np.ndarray  # filled in, (n, LINKS)
    mass: np.ndarray  # mass matrix, filled in [kg·m²], (n, n)
    low: np.ndarray  # its Cholesky factor, filled in


def of(tree) -> Body:
    """Arrays of a `tree.Tree`."""
    n = len(tree.joints)
    single = (tree.mass, tree.armature, tree.damping, tree.lower, tree.upper)
    turn, tensor = tree.turn.reshape(n, 9), tree.inertia.reshape(n, 9)
    rows = np.column_stack([turn, tree.place, tree.axis, tree.com, tensor, *single])
    kin = np.column_stack([tree.parent, tree.slides]).astype(np.int64)
    return Body(kin, rows, np.zeros((n, LINKS)), np.zeros((n, n)), np.zeros((n, n)))


@njit(cache=True, error_model="numpy", forceinline=True)
def three(a, i, k):
    """Three numbers of row i, from column k."""
    return a[i, k], a[i, k + 1], a[i, k + 2]


@njit(cache=True, error_model="numpy", forceinline=True)
def nine(a, i, k):
    """Nine numbers of row i, from column k."""
    return three(a, i, k) + three(a, i, k + 3) + three(a, i, k + 6)


@njit(cache=True, error_model="numpy", forceinline=True)
def put(a, i, k, values):
    """Put numbers into row i, from column k."""
    for r in range(len(values)):
        a[i, k + r] = values[r]


@njit(cache=True, error_model="numpy", forceinline=True)
def plus(a, b):
    """Sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def minus(a, b):
    """Difference of two vectors."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def times(c, a):
    """Number times vector."""
    return c * a[0], c * a[1], c * a[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def cross(a, b):
    """Vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy", forceinline=True)
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def turned(m, a):
    """Matrix times vector."""
    return dot(m[0:3], a), dot(m[3:6], a), dot(m[6:9], a)


@njit(cache=True, error_model="numpy", forceinline=True)
def product(a, b):
    """Matrix times matrix."""
    x, y, z = (b[0], b[3], b[6]), (b[1], b[4], b[7]), (b[2], b[5], b[8])
    p, q, r = turned(a, x), turned(a, y), turned(a, z)
    return p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def flipped(m):
    """Rows for columns."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@njit(cache=True, error_model="numpy", forceinline=True)
def _spin(a, angle):
    """Rotation about an axis of length 1 (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    k = 1.0 - c
    x, y, z = a
    return (
        c + x * x * k, x * y * k - z * s, x * z * k + y * s,
        y * x * k + z * s, c + y * y * k, y * z * k - x * s,
        z * x * k - y * s, z * y * k + x * s, c + z * z * k,
    )  # fmt: skip


@njit(cache=True, error_model="numpy", forceinline=True)
def poses(q, body):
    """Where every body is: origin, joint axis, centre of mass, rotation, inertia, in the world.

    Args:
        q: Joint positions [rad], (n,).
        body: `Body`; its links are filled in.
    """
    kin, rows, links = body.kin, body.rows, body.links
    for i in range(len(kin)):
        p, axis = kin[i, 0], three(rows, i, AXIS)
        base, at = nine(rows, i, TURN), three(rows, i, PLACE)
        if p >= 0:
            above = nine(links, p, ROT)
            base, at = product(above, base), plus(turned(above, at), three(links, p, AT))
        way = turned(base, axis)
        if kin[i, 1]:
            rot = product(base, _spin(axis, 0.0))
            at = plus(at, times(q[i], way))
        else:
            rot = product(base, _spin(axis, q[i]))
        put(links, i, AT, at)
        put(links, i, WAY, way)
        put(links, i, ROT, rot)
        put(links, i, COM, plus(turned(rot, three(rows, i, CENTRE)), at))
        full = product(product(rot, nine(rows, i, TENSOR)), flipped(rot))
        put(links, i, INERTIA, full)


@njit(cache=True, error_model="numpy", forceinline=True)
def mass_matrix(body):
    """Fill in the joint-space mass matrix [kg·m²]; after `poses`."""
    kin, rows, links, out = body.kin, body.rows, body.links, body.mass
    n = len(kin)
    for i in range(n):
        links[i, HEAVY] = rows[i, MASS]
        put(links, i, MIDDLE, three(links, i, COM))
        put(links, i, WHOLE, nine(links, i, INERTIA))
    for i in range(n - 1, -1, -1):  # what hangs on a body counts as part of it
        if kin[i, 0] >= 0:
            _merge(links, kin[i, 0], i)
    for i in range(n):
        way, middle, m = three(links, i, WAY), three(links, i, MIDDLE), links[i, HEAVY]
        if kin[i, 1]:
            push, spin = times(m, way), (0.0, 0.0, 0.0)
        else:
            push = cross(way, times(m, minus(middle, three(links, i, AT))))
            spin = turned(nine(links, i, WHOLE), way)
        j = i
        while j >= 0:
            if kin[j, 1]:
                value = dot(three(links, j, WAY), push)
            else:
                moment = cross(minus(middle, three(links, j, AT)), push)
                value = dot(three(links, j, WAY), plus(moment, spin))
            out[i, j] = out[j, i] = value
            j = kin[j, 0]
        out[i, i] += rows[i, ARMATURE]


@njit(cache=True, error_model="numpy", forceinline=True)
def _merge(links, p, i):
    """Make body i part of body p: mass, centre, inertia."""
    mine, other = links[p, HEAVY], links[i, HEAVY]
    total = mine + other
    share = mine * other / total if total > 0.0 else 0.0
    a, b = three(links, p, MIDDLE), three(links, i, MIDDLE)
    gap = minus(a, b)
    square = dot(gap, gap)
    for r in range(3):
        for c in range(3):
            k = WHOLE + 3 * r + c
            links[p, k] += links[i, k] - share * (gap[r] * gap[c])
        links[p, WHOLE + 4 * r] += share * square
        links[p, MIDDLE + r] = (mine * a[r] + other * b[r]) / total
    links[p, HEAVY] = total


@njit(cache=True, error_model="numpy", forceinline=True)
def bias(dq, body, gravity, out):
    """Torque that keeps the joints from accelerating [N·m], into `out`, (n,); after `poses`.

    Args:
        dq: Joint velocities [rad/s], (n,).
        body: `Body`.
        gravity: Acceleration of gravity, downwards [m/s²].
        out: Gravity and Coriolis.
    """
    kin, rows, links = body.kin, body.rows, body.links
    n = len(kin)
    for i in range(n):
        p, way = kin[i, 0], three(links, i, WAY)
        omega, alpha, acc = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, gravity)
        if p >= 0:
            omega, alpha = three(links, p, OMEGA), three(links, p, ALPHA)
            arm = minus(three(links, i, AT), three(links, p, AT))
            acc = _carried(three(links, p, ACC), alpha, omega, arm)
        side = cross(omega, way)
        if kin[i, 1]:
            acc = plus(acc, times(2.0 * dq[i], side))
        else:
            alpha = plus(alpha, times(dq[i], side))
            omega = plus(omega, times(dq[i], way))
        put(links, i, OMEGA, omega)
        put(links, i, ALPHA, alpha)
        put(links, i, ACC, acc)
        arm = minus(three(links, i, COM), three(links, i, AT))
        force = times(rows[i, MASS], _carried(acc, alpha, omega, arm))
        tensor = nine(links, i, INERTIA)
        moment = cross(omega, turned(tensor, omega))
        put(links, i, FORCE, force)
        put(links, i, MOMENT, plus(moment, plus(turned(tensor, alpha), cross(arm, force))))
    for i in range(n - 1, -1, -1):
        way, p = three(links, i, WAY), kin[i, 0]
        force, moment = three(links, i, FORCE), three(links, i, MOMENT)
        out[i] = dot(way, force) if kin[i, 1] else dot(way, moment)
        if p >= 0:
            arm = minus(three(links, i, AT), three(links, p, AT))
            put(links, p, FORCE, plus(three(links, p, FORCE), force))
            more = plus(moment, cross(arm, force))
            put(links, p, MOMENT, plus(three(links, p, MOMENT), more))


@njit(cache=True, error_model="numpy", forceinline=True)
def _carried(acc, alpha, omega, arm):
    """Acceleration of a point of a body: of its origin, and alpha x r + omega x (omega x r)."""
    return plus(plus(acc, cross(alpha, arm)), cross(omega, cross(omega, arm)))


@njit(cache=True, error_model="numpy", forceinline=True)
def factored(matrix, low):
    """Cholesky factor of a matrix into the lower half of `low`."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(value) if i == j else value / low[j, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def solved(low, x):
    """Solve matrix y = x in place of x, with the factor of the matrix."""
    n = len(x)
    for i in range(n):
        for k in range(i):
            x[i] -= low[i, k] * x[k]
        x[i] /= low[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= low[k, i] * x[k]
        x[i] /= low[i, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def pulled(out, i, point, force, body):
    """Add the joint torques of a force [N] on a point [m] of a body, both in the world."""
    kin, links = body.kin, body.links
    j = i
    while j >= 0:
        way, arm = three(links, j, WAY), minus(point, three(links, j, AT))
        out[j] += dot(way, force) if kin[j, 1] else dot(way, cross(arm, force))
        j = kin[j, 0]
