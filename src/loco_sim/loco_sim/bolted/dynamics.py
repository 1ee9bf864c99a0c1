# SPDX-License-Identifier: Apache-2.0
"""Motion of a bolted tree of links: mass matrix, bias forces, and one step in time.

Recursive Newton-Euler and composite bodies in the axes of the world (Featherstone 2008,
Rigid body dynamics algorithms, chapters 5 and 6); semi-implicit Euler, stops and brakes as
impulses, like the engine's.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .tree import ARMATURE, AXIS, COM, DAMPING, HIGH, INERTIA, LOW, MASS, PLACE, TURN

STOP_SHARE = 0.2  # of the way beyond a stop that is given back per step, as the engine does
STOP_DEPTH = 0.04  # but nothing of a way that is longer [rad or m]
SWEEPS = 50  # of the impulses, at most
SETTLED = 1e-5  # they end when no joint's velocity changes by more, as the engine's [rad/s]


# What is known of a link, a row of `workshop`: where it is, how it moves (accelerations with
# gravity), then what it takes to move it and all that hangs on it.
AT, ALONG, SPIN, SPIN_RATE, RATE, ROT = 0, 3, 6, 9, 12, 15
FORCE, MOMENT, FIRST, SECOND, WEIGHT, WIDTH = 24, 27, 30, 33, 42, 43

ZERO = (0.0, 0.0, 0.0)
EYE = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

# Vectors and matrices are tuples of 3 and 9 numbers, which stay in registers. Views of arrays
# are counted in and out at each use, which took longer than the arithmetic.


@njit(cache=True, error_model="numpy")
def vector(a, i, k=0):
    """Three numbers of row i of an array, from column k."""
    return a[i, k], a[i, k + 1], a[i, k + 2]


@njit(cache=True, error_model="numpy")
def matrix(a, i, k=0):
    """Nine numbers of row i of an array, from column k."""
    return (
        a[i, k], a[i, k + 1], a[i, k + 2],
        a[i, k + 3], a[i, k + 4], a[i, k + 5],
        a[i, k + 6], a[i, k + 7], a[i, k + 8],
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def put(a, i, k, values):
    """Put a vector or matrix into row i of an array, from column k."""
    for r in range(len(values)):
        a[i, k + r] = values[r]


@njit(cache=True, error_model="numpy")
def dot(a, b):
    """Inner product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, error_model="numpy")
def cross(a, b):
    """Vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, error_model="numpy")
def along_by(a, b, by):
    """Vector a + by b."""
    return a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2]


@njit(cache=True, error_model="numpy")
def applied(m, v):
    """Matrix times vector."""
    return dot(m[0:3], v), dot(m[3:6], v), dot(m[6:9], v)


@njit(cache=True, error_model="numpy")
def transposed(m):
    """Matrix, rows for columns."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@njit(cache=True, error_model="numpy")
def product(a, b):
    """Matrix product."""
    t = transposed(b)
    x, y, z = applied(a, t[0:3]), applied(a, t[3:6]), applied(a, t[6:9])
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


@njit(cache=True, error_model="numpy")
def turn_about(axis, angle):
    """Rotation about a unit axis."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis
    v = 1.0 - c
    return (
        c + x * x * v, x * y * v - z * s, x * z * v + y * s,
        y * x * v + z * s, c + y * y * v, y * z * v - x * s,
        z * x * v - y * s, z * y * v + x * s, c + z * z * v,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def workshop(n):
    """Arrays that `advance` works in, for n joints; making them takes longer than a step.

    Links; mass matrix; velocities after an impulse of 1 on a joint, a row each, and after them
    accelerations, which are seen by themselves as well; impulses by stops, then by brakes, and
    which of them act.
    """
    rows = np.empty((n + 1, n))
    given, acting = np.empty(2 * n), np.empty(2 * n, dtype=np.int64)
    return np.empty((n, WIDTH)), np.zeros((n, n)), rows, rows[n], given, acting


@njit(cache=True, error_model="numpy", forceinline=True)
def dynamics(tree, gravity, q, dq, links, mass_matrix, bias):
    """Mass matrix, (n, n), and torque that keeps all accelerations zero, (n,), in place.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        q: Joint positions [rad or m], (n,).
        dq: Joint velocities, (n,).
        links: First of `workshop`; filled in.
        mass_matrix: Filled in, but for zeros between branches.
        bias: Filled in.
    """
    outwards(tree, gravity, q, dq, links)
    inwards(tree, links, mass_matrix, bias)


@njit(cache=True, error_model="numpy", forceinline=True)
def outwards(tree, gravity, q, dq, links):
    """From the base outwards: where links are, and what it takes to move them as they do.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        q: Joint positions [rad or m], (n,).
        dq: Joint velocities, (n,).
        links: Filled in, if no joint accelerates: origin of each link [m], axis of its joint,
            angular velocity and acceleration, acceleration, rotation to the world, force on
            it [N], moment [N·m], mass times centre of mass, inertia, and mass; moment to
            inertia about the world's origin.
    """
    kin, body = tree[0], tree[1]
    for i in range(len(kin)):
        p, slides, m = kin[i, 0], kin[i, 1], body[i, MASS]
        up = EYE if p < 0 else matrix(links, p, ROT)
        rot = product(up, matrix(body, i, TURN))
        along = applied(rot, vector(body, i, AXIS))
        arm = applied(up, vector(body, i, PLACE))
        if slides:
            arm = along_by(arm, along, q[i])
        else:
            rot = product(rot, turn_about(vector(body, i, AXIS), q[i]))
        at, spin, spin_rate = arm, ZERO, ZERO
        rate = -gravity[0], -gravity[1], -gravity[2]
        if p >= 0:
            at = along_by(vector(links, p, AT), arm, 1.0)
            spin, spin_rate = vector(links, p, SPIN), vector(links, p, SPIN_RATE)
            rate = carried(arm, spin, spin_rate, vector(links, p, RATE))
            turned = cross(spin, along)
            if slides:
                rate = along_by(rate, turned, 2.0 * dq[i])
            else:
                spin_rate = along_by(spin_rate, turned, dq[i])
        if not slides:
            spin = along_by(spin, along, dq[i])
        put(links, i, AT, at)
        put(links, i, ALONG, along)
        put(links, i, SPIN, spin)
        put(links, i, SPIN_RATE, spin_rate)
        put(links, i, RATE, rate)
        put(links, i, ROT, rot)
        # Force and moment of the link, and its inertia about the world's origin.
        arm = applied(rot, vector(body, i, COM))
        push = carried(arm, spin, spin_rate, rate)
        force = push[0] * m, push[1] * m, push[2] * m
        arm = along_by(arm, at, 1.0)
        own = product(product(rot, matrix(body, i, INERTIA)), transposed(rot))
        moment = along_by(cross(arm, force), cross(spin, applied(own, spin)), 1.0)
        put(links, i, FORCE, force)
        square = m * dot(arm, arm)
        for r in range(3):
            total = moment[r]
            links[i, FIRST + r] = m * arm[r]
            for c in range(3):
                total += own[3 * r + c] * spin_rate[c]
                links[i, SECOND + 3 * r + c] = own[3 * r + c] - m * arm[r] * arm[c]
            links[i, SECOND + 4 * r] += square
            links[i, MOMENT + r] = total
        links[i, WEIGHT] = m


@njit(cache=True, error_model="numpy")
def carried(arm, spin, spin_rate, rate):
    """Acceleration of a point that is `arm` away on a body."""
    x, y = cross(spin_rate, arm), cross(spin, cross(spin, arm))
    return rate[0] + x[0] + y[0], rate[1] + x[1] + y[1], rate[2] + x[2] + y[2]


@njit(cache=True, error_model="numpy", forceinline=True)
def inwards(tree, links, mass_matrix, bias):
    """From the tips inwards: what each joint carries; arguments as of `dynamics`."""
    kin = tree[0]
    for i in range(len(kin) - 1, -1, -1):
        at, along, first = vector(links, i, AT), vector(links, i, ALONG), vector(links, i, FIRST)
        force = vector(links, i, FORCE)
        bias[i] = lever(kin[i, 1], at, along, force, vector(links, i, MOMENT))
        m = links[i, WEIGHT]
        if kin[i, 1]:  # momentum of what a joint moves with speed 1
            push, spun = (m * along[0], m * along[1], m * along[2]), cross(first, along)
        else:
            arm = cross(at, along)  # velocity of the point at the world's origin
            push, spun = along_by(cross(along, first), arm, m), cross(first, arm)
            for c in range(3):
                column = (
                    links[i, SECOND + c], links[i, SECOND + 3 + c], links[i, SECOND + 6 + c]
                )  # fmt: skip
                spun = along_by(spun, column, along[c])
        j = i
        while j >= 0:
            at, along = vector(links, j, AT), vector(links, j, ALONG)
            mass_matrix[i, j] = mass_matrix[j, i] = lever(kin[j, 1], at, along, push, spun)
            j = kin[j, 0]
        mass_matrix[i, i] += tree[1][i, ARMATURE]
        p = kin[i, 0]
        if p >= 0:
            for k in range(FORCE, WIDTH):
                links[p, k] += links[i, k]


@njit(cache=True, error_model="numpy")
def lever(slides, at, along, force, moment):
    """Torque at a joint, of a force and a moment about the world's origin."""
    if slides:
        return dot(along, force)
    return dot(along, along_by(moment, cross(at, force), -1.0))


@njit(cache=True, error_model="numpy")
def factorise(kin, matrix):
    """L' L of a mass matrix, in place in its lower half; zeros between branches are skipped."""
    for k in range(len(kin) - 1, -1, -1):
        matrix[k, k] = np.sqrt(matrix[k, k])
        i = kin[k, 0]
        while i >= 0:
            matrix[k, i] /= matrix[k, k]
            i = kin[i, 0]
        i = kin[k, 0]
        while i >= 0:
            j = i
            while j >= 0:
                matrix[i, j] -= matrix[k, i] * matrix[k, j]
                j = kin[j, 0]
            i = kin[i, 0]


@njit(cache=True, error_model="numpy")
def solve(kin, factor, rows, k):
    """Solve M x = x in place in row k, with M from `factorise`."""
    n = len(kin)
    for i in range(n - 1, -1, -1):
        rows[k, i] /= factor[i, i]
        j = kin[i, 0]
        while j >= 0:
            rows[k, j] -= factor[i, j] * rows[k, i]
            j = kin[j, 0]
    for i in range(n):
        j = kin[i, 0]
        while j >= 0:
            rows[k, i] -= factor[i, j] * rows[k, j]
            j = kin[j, 0]
        rows[k, i] /= factor[i, i]


@njit(cache=True, error_model="numpy", forceinline=True)
def pulled(tree, links, pulls, step, x):
    """Take what forces from outside do at the joints from torques, in place.

    Args:
        tree: `tree.Tree`.
        links: After `outwards`.
        pulls: `effects.pulls.Pulls`.
        step: Number of the physics step.
        x: Torques [N·m], (n,).
    """
    kin = tree[0]
    pulled_body, window, const = pulls
    for k in range(len(pulled_body)):
        i = pulled_body[k]
        if i < 0 or not window[k, 0] <= step < window[k, 1]:
            continue
        point = applied(matrix(links, i, ROT), vector(const, k))
        point = along_by(point, vector(links, i, AT), 1.0)
        way = along_by(vector(const, k, 6), point, -1.0)
        force, distance = vector(const, k, 3), np.sqrt(dot(way, way))
        if const[k, 9] > 0.0 and distance > const[k, 10]:
            force = along_by(force, way, const[k, 9] * (distance - const[k, 10]) / distance)
        while i >= 0:
            moment = cross(along_by(point, vector(links, i, AT), -1.0), force)
            for r in range(3):
                x[i] -= links[i, ALONG + r] * (force[r] if kin[i, 1] else moment[r])
            i = kin[i, 0]


@njit(cache=True, error_model="numpy", forceinline=True)
def advance(tree, gravity, tau, brake, pulls, step, q, dq, dt, room):
    """One step in time, in place.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        tau: Joint torques [N·m], (n,).
        brake: Torque that is there to stop each joint [N·m], (n,), >= 0.
        pulls: `effects.pulls.Pulls`.
        step: Number of this step.
        q: Joint positions, (n,).
        dq: Joint velocities, (n,).
        dt: Step [s].
        room: Arrays to work in, from `workshop`.
    """
    kin, body, fastest = tree
    links, factor, rows, x, given, acting = room
    n = len(kin)
    dynamics(tree, gravity, q, dq, links, factor, x)
    pulled(tree, links, pulls, step, x)
    for i in range(n):
        x[i] = tau[i] - body[i, DAMPING] * dq[i] - x[i]
    factorise(kin, factor)
    solve(kin, factor, rows, n)
    held = False
    for i in range(n):
        dq[i] = min(max(dq[i] + dt * x[i], -fastest), fastest)
        held |= brake[i] > 0.0 or q[i] <= body[i, LOW] or q[i] >= body[i, HIGH]
    if held:
        stop(kin, factor, brake, body, q, dq, dt, rows, given, acting)
    for i in range(n):
        q[i] += dt * dq[i]


@njit(cache=True, error_model="numpy")
def stop(kin, factor, brake, body, q, dq, dt, answer, given, acting):
    """Impulses of stops and brakes, by sweeps to and fro; arguments as of `advance` and `workshop`.

    A brake may work against a stop, and light legs feel what is left over when the sweeps
    end: so order and end are those of the engine.
    """
    n = len(kin)
    count = 0
    for k in range(2 * n):  # brakes, then stops
        row, i = (k + n, k) if k < n else (k - n, k - n)
        if brake[i] > 0.0 if row >= n else q[i] <= body[i, LOW] or q[i] >= body[i, HIGH]:
            acting[count], given[row] = row, 0.0
            count += 1
            for j in range(n):
                answer[i, j] = 0.0
            answer[i, i] = 1.0
            solve(kin, factor, answer, i)
    for sweep in range(SWEEPS):
        moved = 0.0
        for k in range(count):
            row = acting[count - 1 - k if sweep % 2 == 0 else k]
            i = row if row < n else row - n
            if row >= n:
                most = brake[i] * dt
                wanted = min(max(given[row] - dq[i] / answer[i, i], -most), most)
            elif q[i] <= body[i, LOW]:
                back = given_back(body[i, LOW] - q[i], dt)
                wanted = max(0.0, given[row] + (back - dq[i]) / answer[i, i])
            else:
                back = given_back(body[i, HIGH] - q[i], dt)
                wanted = min(0.0, given[row] + (back - dq[i]) / answer[i, i])
            shove(answer, i, wanted - given[row], dq)
            moved = max(moved, abs(wanted - given[row]) * answer[i, i])
            given[row] = wanted
        if moved <= SETTLED:
            break


@njit(cache=True, error_model="numpy")
def given_back(way, dt):
    """Speed with which a stop pushes a joint back that is beyond it [rad/s or m/s]."""
    return STOP_SHARE * way / dt if abs(way) < STOP_DEPTH else 0.0


@njit(cache=True, error_model="numpy")
def shove(answer, i, impulse, dq):
    """Add what an impulse on joint i does to the velocities."""
    for j in range(len(dq)):
        dq[j] += impulse * answer[i, j]
