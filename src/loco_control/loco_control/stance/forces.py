# SPDX-License-Identifier: Apache-2.0
"""Distribution of a wrench on the trunk to ground forces on the stance feet.

Forces f, (n, 3), on n feet make the wrench G f about the origin of the frame.
Several f produce the same wrench; the two mappings of the RCF select different
ones. With two feet the moment about the line between them cannot be produced;
both mappings minimise the error. All arguments are C-contiguous float
arrays in one frame. Source: the two options of the RCF controller.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

BASE_WEIGHT, RIDGE = 1000.0, 1e-4  # weights of the RCF's weighted pseudo-inverse
TINY = 1e-9  # regularises G G^T where the feet cannot produce a direction


@njit(cache=True)
def grasp_map(feet):
    """G, (6, 3n): forces on `feet` [m], (n, 3), to force and moment about the origin."""
    count = len(feet)
    G = np.zeros((6, 3 * count))
    for leg in range(count):
        x, y, z = feet[leg]
        a, b, c = 3 * leg, 3 * leg + 1, 3 * leg + 2
        G[0, a] = G[1, b] = G[2, c] = 1.0
        G[3, b], G[3, c] = -z, y
        G[4, a], G[4, c] = z, -x
        G[5, a], G[5, b] = -y, x
    return G


@njit(cache=True)
def nullspace_forces(wrench, feet, jacobians):
    """Ground forces of the null-space mapping: nearly the minimum joint torque.

    The RCF projects the wrench by (I - J_h^+ J_h)^T with J_h = [J | G^T] and
    J_h^+ = W J_h^T (J_h W J_h^T + ridge I)^-1. Its joint part is -J^T f with

        (J J^T + weight G^T G + ridge I) f = weight G^T w,

    the minimum of |J^T f|² + weight |G f - w|² + ridge |f|².

    Args:
        wrench: w, force [N] then moment [N·m] about the origin, (6,).
        feet: Stance feet [m], (n, 3).
        jacobians: d foot / d q of their legs [m/rad], (n, 3, 3).

    Returns:
        Ground force on each foot [N], (n, 3).
    """
    G = grasp_map(feet)
    size = G.shape[1]
    normal, right = np.empty((size, size)), np.empty(size)
    for i in range(size):
        right[i] = BASE_WEIGHT * dot(G[:, i], wrench)
        for j in range(size):
            normal[i, j] = BASE_WEIGHT * dot(G[:, i], G[:, j])
            if i // 3 == j // 3:
                normal[i, j] += dot(jacobians[i // 3, i % 3], jacobians[i // 3, j % 3])
        normal[i, i] += RIDGE
    return solve_positive(normal, right).reshape(-1, 3)


@njit(cache=True)
def minimum_forces(wrench, feet):
    """Ground forces [N], (n, 3), of least norm whose wrench is nearest to `wrench`, (6,)."""
    G = grasp_map(feet)
    normal, forces = np.empty((6, 6)), np.empty(G.shape[1])
    for i in range(6):
        for j in range(6):
            normal[i, j] = dot(G[i], G[j])
        normal[i, i] += TINY
    multiplier = solve_positive(normal, wrench.copy())
    for i in range(len(forces)):
        forces[i] = dot(G[:, i], multiplier)
    return forces.reshape(-1, 3)


@njit(cache=True)
def solve_positive(A, b):
    """Solve A x = b for a symmetric positive definite A (n, n), by Cholesky, in place.

    Overwrites A and b, returns x. For a few unknowns this is ten times faster than a
    call into LAPACK.
    """
    size = len(b)
    for j in range(size):
        for i in range(j, size):
            remainder = A[i, j] - dot(A[i, :j], A[j, :j])
            A[i, j] = math.sqrt(remainder) if i == j else remainder / A[j, j]
        b[j] = (b[j] - dot(A[j, :j], b[:j])) / A[j, j]
    for j in range(size - 1, -1, -1):
        b[j] = (b[j] - dot(A[j + 1 :, j], b[j + 1 :])) / A[j, j]
    return b


@njit(cache=True)
def dot(a, b):
    """Sum of products; for a few numbers faster than a call into BLAS."""
    total = 0.0
    for i in range(len(a)):
        total += a[i] * b[i]
    return total
