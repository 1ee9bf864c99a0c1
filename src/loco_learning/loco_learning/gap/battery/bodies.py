# SPDX-License-Identifier: Apache-2.0
"""Equations of motion of a `tree.Tree`, compiled, in world coordinates.

M(q) ddq + h(q, dq) = tau. The mass matrix is made of the momenta of composite bodies, h of
Newton's and Euler's equations from the tips to the root. Small loops instead of array
operations: for three numbers those cost ten times as much.
"""

from __future__ import annotations

import numpy as np
from numba import njit


def room(n: int) -> tuple[np.ndarray, ...]:
    """Memory for the functions below: vectors (12, n, 3), matrices (4, n, 3, 3), (n, n), (n,)."""
    return np.zeros((12, n, 3)), np.zeros((4, n, 3, 3)), np.zeros((n, n)), np.zeros(n)


AT, WAY, COM, OMEGA, ALPHA, ACC, FORCE, MOMENT, MIDDLE = range(9)  # rows of the vectors
ROT, INERTIA, WHOLE, OWN = range(4)  # rows of the matrices


@njit(cache=True)
def cross(a, b, out):
    """Vector product into `out`, which must be neither."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def dot(a, b):
    """Scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True)
def turned(matrix, a, out):
    """Matrix times vector into `out`."""
    for r in range(3):
        out[r] = matrix[r, 0] * a[0] + matrix[r, 1] * a[1] + matrix[r, 2] * a[2]


@njit(cache=True)
def product(a, b, out):
    """Matrix times matrix into `out`."""
    for r in range(3):
        for c in range(3):
            out[r, c] = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]


@njit(cache=True)
def _spin(a, angle, out):
    """Rotation about an axis of length 1 (Rodrigues)."""
    c, s = np.cos(angle), np.sin(angle)
    k = 1.0 - c
    x, y, z = a[0], a[1], a[2]
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * k, x * y * k - z * s, x * z * k + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * k + z * s, c + y * y * k, y * z * k - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * k - y * s, z * y * k + x * s, c + z * z * k


@njit(cache=True)
def poses(q, body, work):
    """Where every body is: origin, joint axis, centre of mass, rotation, inertia, in the world.

    Args:
        q: Joint positions [rad], (n,).
        body: parent, turn, place, axis, slides, mass, com, inertia, armature.
        work: From `room`; filled in.
    """
    parent, turn, place, axis, slides, _, com, inertia, _ = body
    vec, mat = work[0], work[1]
    for i in range(len(q)):
        rot, base, own = mat[ROT, i], mat[WHOLE, i], mat[OWN, i]
        at, way, p = vec[AT, i], vec[WAY, i], parent[i]
        if p < 0:
            base[:] = turn[i]
            at[:] = place[i]
        else:
            product(mat[ROT, p], turn[i], base)
            turned(mat[ROT, p], place[i], at)
            for k in range(3):
                at[k] += vec[AT, p, k]
        _spin(axis[i], 0.0 if slides[i] else q[i], own)
        product(base, own, rot)
        turned(base, axis[i], way)
        if slides[i]:
            for k in range(3):
                at[k] += q[i] * way[k]
        turned(rot, com[i], vec[COM, i])
        for k in range(3):
            vec[COM, i, k] += at[k]
        product(rot, inertia[i], own)
        full = mat[INERTIA, i]
        for r in range(3):
            for c in range(3):
                full[r, c] = own[r, 0] * rot[c, 0] + own[r, 1] * rot[c, 1] + own[r, 2] * rot[c, 2]


@njit(cache=True)
def mass_matrix(body, work):
    """Joint-space mass matrix [kg·m²] into work[2], (n, n); after `poses`."""
    parent, slides, mass, armature = body[0], body[4], body[5], body[8]
    vec, mat, out, m = work
    n = len(mass)
    push, spin, arm, more = vec[9, 0], vec[10, 0], vec[11, 0], vec[OMEGA, 0]
    for i in range(n):
        m[i] = mass[i]
        vec[MIDDLE, i] = vec[COM, i]
        mat[WHOLE, i] = mat[INERTIA, i]
    for i in range(n - 1, -1, -1):  # what hangs on a body counts as part of it
        p = parent[i]
        if p >= 0:
            _merge(m, vec[MIDDLE], mat[WHOLE], p, i)
    for i in range(n):
        way, middle = vec[WAY, i], vec[MIDDLE, i]
        if slides[i]:
            for k in range(3):
                push[k], spin[k] = m[i] * way[k], 0.0
        else:
            for k in range(3):
                arm[k] = m[i] * (middle[k] - vec[AT, i, k])
            cross(way, arm, push)
            turned(mat[WHOLE, i], way, spin)
        j = i
        while j >= 0:
            if slides[j]:
                value = dot(vec[WAY, j], push)
            else:
                for k in range(3):
                    arm[k] = middle[k] - vec[AT, j, k]
                cross(arm, push, more)
                for k in range(3):
                    more[k] += spin[k]
                value = dot(vec[WAY, j], more)
            out[i, j] = out[j, i] = value
            j = parent[j]
        out[i, i] += armature[i]


@njit(cache=True)
def _merge(m, middle, whole, p, i):
    """Make body i part of body p: mass, centre, inertia."""
    total = m[p] + m[i]
    share = m[p] * m[i] / total if total > 0.0 else 0.0
    square = 0.0
    for k in range(3):
        square += (middle[p, k] - middle[i, k]) ** 2
    for r in range(3):
        for c in range(3):
            gap = (middle[p, r] - middle[i, r]) * (middle[p, c] - middle[i, c])
            whole[p, r, c] += whole[i, r, c] - share * gap
        whole[p, r, r] += share * square
    for k in range(3):
        middle[p, k] = (m[p] * middle[p, k] + m[i] * middle[i, k]) / total
    m[p] = total


@njit(cache=True)
def bias(dq, body, gravity, work, out):
    """Torque that keeps the joints from accelerating [N·m], into `out`, (n,); after `poses`.

    Args:
        dq: Joint velocities [rad/s], (n,).
        body: As of `poses`.
        gravity: Acceleration of gravity, downwards [m/s²].
        work: From `room`.
        out: Gravity and Coriolis.
    """
    parent, slides, mass = body[0], body[4], body[5]
    vec, mat = work[0], work[1]
    n = len(dq)
    a, b, c = vec[9, 0], vec[10, 0], vec[11, 0]
    for i in range(n):
        p, way = parent[i], vec[WAY, i]
        omega, alpha, acc = vec[OMEGA, i], vec[ALPHA, i], vec[ACC, i]
        if p >= 0:
            for k in range(3):
                a[k] = vec[AT, i, k] - vec[AT, p, k]
                omega[k], alpha[k] = vec[OMEGA, p, k], vec[ALPHA, p, k]
            _carried(vec[ACC, p], alpha, omega, a, b, c, acc)
        else:
            for k in range(3):
                omega[k] = alpha[k] = acc[k] = 0.0
            acc[2] = gravity
        cross(omega, way, a)
        for k in range(3):
            if slides[i]:
                acc[k] += 2.0 * dq[i] * a[k]
            else:
                alpha[k] += dq[i] * a[k]
                omega[k] += dq[i] * way[k]
    for i in range(n):
        omega, alpha = vec[OMEGA, i], vec[ALPHA, i]
        force, moment, arm = vec[FORCE, i], vec[MOMENT, i], vec[MIDDLE, i]
        for k in range(3):
            arm[k] = vec[COM, i, k] - vec[AT, i, k]
        _carried(vec[ACC, i], alpha, omega, arm, b, c, force)
        for k in range(3):
            force[k] *= mass[i]
        turned(mat[INERTIA, i], omega, b)
        cross(omega, b, moment)
        turned(mat[INERTIA, i], alpha, b)
        cross(arm, force, c)
        for k in range(3):
            moment[k] += b[k] + c[k]
    for i in range(n - 1, -1, -1):
        way, p = vec[WAY, i], parent[i]
        out[i] = dot(way, vec[FORCE, i]) if slides[i] else dot(way, vec[MOMENT, i])
        if p >= 0:
            for k in range(3):
                a[k] = vec[AT, i, k] - vec[AT, p, k]
            cross(a, vec[FORCE, i], b)
            for k in range(3):
                vec[FORCE, p, k] += vec[FORCE, i, k]
                vec[MOMENT, p, k] += vec[MOMENT, i, k] + b[k]


@njit(cache=True)
def _carried(acc, alpha, omega, arm, b, c, out):
    """Acceleration of a point of a body: of its origin, and alpha x r + omega x (omega x r)."""
    cross(omega, arm, b)
    cross(omega, b, c)
    cross(alpha, arm, b)
    for k in range(3):
        out[k] = acc[k] + b[k] + c[k]


@njit(cache=True)
def solved(matrix, x):
    """Solve matrix y = x in place of x by Cholesky; the matrix is left as it is."""
    n = len(x)
    low = np.empty((n, n))
    for i in range(n):
        for j in range(i + 1):
            value = matrix[i, j]
            for k in range(j):
                value -= low[i, k] * low[j, k]
            low[i, j] = np.sqrt(value) if i == j else value / low[j, j]
    for i in range(n):
        for k in range(i):
            x[i] -= low[i, k] * x[k]
        x[i] /= low[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= low[k, i] * x[k]
        x[i] /= low[i, i]


@njit(cache=True)
def pulled(out, body, point, force, parent, slides, work):
    """Add the joint torques of a force [N] on a point [m] of a body, both in the world."""
    vec, arm, moment = work[0], np.empty(3), np.empty(3)
    j = body
    while j >= 0:
        for k in range(3):
            arm[k] = point[k] - vec[AT, j, k]
        cross(arm, force, moment)
        out[j] += dot(vec[WAY, j], force) if slides[j] else dot(vec[WAY, j], moment)
        j = parent[j]
