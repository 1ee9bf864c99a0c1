# SPDX-License-Identifier: Apache-2.0
"""Dynamics of a fixed-base tree of links: mass matrix, bias forces and one integration step.

Recursive Newton-Euler and composite rigid bodies in world axes (Featherstone 2008, Rigid body
dynamics algorithms, chapters 5 and 6); semi-implicit Euler, with joint stops and brakes as
impulses, as in PyBullet.
"""

from __future__ import annotations

import numpy as np

from ..jit import inlined, kernel, njit
from .tree import ARMATURE, AXIS, COM, DAMPING, HIGH, IMPLICIT, INERTIA, LOW, MASS, PLACE, TURN

STOP_SHARE = 0.2  # share of the penetration of a stop that is corrected per step, as in PyBullet
STOP_DEPTH = 0.04  # deeper penetrations are not corrected [rad or m]
SWEEPS = 50  # largest number of iterations over the impulses
VELOCITY_TOLERANCE = 1e-5  # velocity change below which the iterations end, as in PyBullet [rad/s]


# Columns of the link array of `workshop`: pose, velocities and accelerations (including gravity),
# then force, moment and inertia of the link with all links outwards of it.
# Numbers of NumPy, see `tree`.
AT, ALONG, SPIN, SPIN_RATE, RATE, ROT = np.array([0, 3, 6, 9, 12, 15])
FORCE, MOMENT, FIRST, SECOND, WEIGHT, WIDTH = np.array([24, 27, 30, 33, 42, 43])

ZERO = (0.0, 0.0, 0.0)

# Vectors and matrices are tuples of 3 and 9 numbers, which stay in registers.


@kernel
def vector(a, i, k=0):
    """Three numbers of row i of an array, from column k."""
    return a[i, k], a[i, k + 1], a[i, k + 2]


@kernel
def matrix(a, i, k=0):
    """Nine numbers of row i of an array, from column k."""
    return (
        a[i, k], a[i, k + 1], a[i, k + 2],
        a[i, k + 3], a[i, k + 4], a[i, k + 5],
        a[i, k + 6], a[i, k + 7], a[i, k + 8],
    )  # fmt: skip


@kernel
def put(a, i, k, values):
    """Write a vector or matrix into row i of an array, from column k."""
    for r in range(len(values)):
        a[i, k + r] = values[r]


@kernel
def dot(a, b):
    """Inner product of two vectors."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel
def cross(a, b):
    """Vector product of two vectors."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@kernel
def along_by(a, b, by):
    """Vector a + by * b, with the scalar `by`."""
    return a[0] + by * b[0], a[1] + by * b[1], a[2] + by * b[2]


@kernel
def applied(m, v):
    """Matrix times vector."""
    return dot(m[0:3], v), dot(m[3:6], v), dot(m[6:9], v)


@kernel
def transposed(m):
    """Transposed matrix."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@kernel
def product(a, b):
    """Matrix product."""
    t = transposed(b)
    x, y, z = applied(a, t[0:3]), applied(a, t[3:6]), applied(a, t[6:9])
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


@kernel
def turn_about(axis, angle):
    """Rotation matrix about a unit axis by an angle [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis
    v = 1.0 - c
    return (
        c + x * x * v, x * y * v - z * s, x * z * v + y * s,
        y * x * v + z * s, c + y * y * v, y * z * v - x * s,
        z * x * v - y * s, z * y * v + x * s, c + z * z * v,
    )  # fmt: skip


@njit(error_model="numpy")
def workshop(n):
    """Work arrays of `advance` for n joints, allocated once.

    Links, (n, WIDTH); mass matrix, (n, n); velocity responses to a unit impulse on each joint and
    the accelerations in the last row, (n + 1, n); a view of that row; impulses of stops, then of
    brakes, (2 n,); indices of the active ones, (2 n,).
    """
    rows = np.empty((n + 1, n))
    impulses, acting = np.empty(2 * n), np.empty(2 * n, dtype=np.int64)
    return np.empty((n, WIDTH)), np.zeros((n, n)), rows, rows[n], impulses, acting


@inlined
def dynamics(tree, gravity, q, dq, links, mass_matrix, bias):
    """Mass matrix, (n, n), and bias torque at zero acceleration, (n,), in place.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        q: Joint positions [rad or m], (n,).
        dq: Joint velocities, (n,).
        links: First array of `workshop`; overwritten.
        mass_matrix: Overwritten, except zeros between branches.
        bias: Overwritten.
    """
    outwards(tree, gravity, q, dq, links)
    inwards(tree, links, mass_matrix, bias)


@inlined
def outwards(tree, gravity, q, dq, links):
    """Pass from base to tips: poses, velocities, and link forces at zero joint acceleration.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        q: Joint positions [rad or m], (n,).
        dq: Joint velocities, (n,).
        links: Overwritten: origin of each link [m], axis of its joint, angular velocity and
            acceleration, acceleration, rotation to the world, force on it [N], moment [N·m],
            mass times centre of mass, inertia, and mass; moment to inertia are about the
            world's origin.
    """
    kin, body = tree[0], tree[1]
    for i in range(len(kin)):
        p, slides, m = kin[i, 0], kin[i, 1], body[i, MASS]
        rot, arm = matrix(body, i, TURN), vector(body, i, PLACE)
        if p >= 0:
            up = matrix(links, p, ROT)
            rot, arm = product(up, rot), applied(up, arm)
        along = applied(rot, vector(body, i, AXIS))
        if slides:
            arm = along_by(arm, along, q[i])
        else:
            rot = product(rot, turn_about(vector(body, i, AXIS), q[i]))
        at, spin, spin_rate = arm, ZERO, ZERO
        rate = -gravity[0], -gravity[1], -gravity[2]
        if p >= 0:
            at = along_by(vector(links, p, AT), arm, 1.0)
            spin, spin_rate = vector(links, p, SPIN), vector(links, p, SPIN_RATE)
            rate = transport(arm, spin, spin_rate, vector(links, p, RATE))
            axis_rate = cross(spin, along)
            if slides:
                rate = along_by(rate, axis_rate, 2.0 * dq[i])
            else:
                spin_rate = along_by(spin_rate, axis_rate, dq[i])
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
        push = transport(arm, spin, spin_rate, rate)
        force = push[0] * m, push[1] * m, push[2] * m
        arm = along_by(arm, at, 1.0)
        tensor = product(product(rot, matrix(body, i, INERTIA)), transposed(rot))
        moment = along_by(cross(arm, force), cross(spin, applied(tensor, spin)), 1.0)
        put(links, i, FORCE, force)
        square = m * dot(arm, arm)
        for r in range(3):
            total = moment[r]
            links[i, FIRST + r] = m * arm[r]
            for c in range(3):
                total += tensor[3 * r + c] * spin_rate[c]
                links[i, SECOND + 3 * r + c] = tensor[3 * r + c] - m * arm[r] * arm[c]
            links[i, SECOND + 4 * r] += square
            links[i, MOMENT + r] = total
        links[i, WEIGHT] = m


@kernel
def transport(arm, spin, spin_rate, rate):
    """Acceleration of the point at `arm` [m] from the origin of a rotating body [m/s²]."""
    x, y = cross(spin_rate, arm), cross(spin, cross(spin, arm))
    return rate[0] + x[0] + y[0], rate[1] + x[1] + y[1], rate[2] + x[2] + y[2]


@inlined
def inwards(tree, links, mass_matrix, bias):
    """Pass from tips to base: bias torques and mass matrix; arguments as in `dynamics`."""
    kin = tree[0]
    for i in range(len(kin) - 1, -1, -1):
        at, along, first = vector(links, i, AT), vector(links, i, ALONG), vector(links, i, FIRST)
        force = vector(links, i, FORCE)
        bias[i] = lever(kin[i, 1], at, along, force, vector(links, i, MOMENT))
        m = links[i, WEIGHT]
        if kin[i, 1]:  # momentum of the links moved by the joint at unit speed
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


@kernel
def lever(slides, at, along, force, moment):
    """Torque (force if sliding) at a joint from a force and a moment about the world's origin."""
    if slides:
        return dot(along, force)
    return dot(along, along_by(moment, cross(at, force), -1.0))


@kernel
def needed(tree, q, dq, ddq, links, mass_matrix, moved, held):
    """Inverse dynamics of each row of a motion, in place.

    Args:
        tree: `tree.Tree`.
        q: Joint positions [rad or m], (T, n).
        dq: Joint velocities, (T, n).
        ddq: Joint accelerations, (T, n).
        links: First array of `workshop`; overwritten.
        mass_matrix: Second array of `workshop`; overwritten.
        moved: Result: torques of the motion without weight [N·m or N], (T, n).
        held: Result: torques that hold the weight per component of gravity, (T, n, 3).
    """
    kin, n = tree[0], q.shape[1]
    for t in range(len(q)):
        dynamics(tree, ZERO, q[t], dq[t], links, mass_matrix, moved[t])
        for i in range(n):
            for j in range(n):
                moved[t, i] += mass_matrix[i, j] * ddq[t, j]
            along, m = vector(links, i, ALONG), links[i, WEIGHT]  # mass moved by the joint
            if kin[i, 1]:
                put(held[t], i, 0, (-m * along[0], -m * along[1], -m * along[2]))
            else:
                arm = along_by(vector(links, i, FIRST), vector(links, i, AT), -m)
                put(held[t], i, 0, cross(arm, along))


@kernel
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


@kernel
def solve(kin, factor, rows, k):
    """Solve M y = x for row k of `rows`, in place, with the factors of M from `factorise`."""
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


@inlined
def pulled(tree, links, pulls, step, x):
    """Subtract the joint torques of external forces from `x`, in place.

    Args:
        tree: `tree.Tree`.
        links: Link array from `outwards`.
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
        to_anchor = along_by(vector(const, k, 6), point, -1.0)
        force, distance = vector(const, k, 3), np.sqrt(dot(to_anchor, to_anchor))
        if const[k, 9] > 0.0 and distance > const[k, 10]:
            force = along_by(force, to_anchor, const[k, 9] * (distance - const[k, 10]) / distance)
        while i >= 0:
            moment = cross(along_by(point, vector(links, i, AT), -1.0), force)
            for r in range(3):
                x[i] -= links[i, ALONG + r] * (force[r] if kin[i, 1] else moment[r])
            i = kin[i, 0]


@inlined
def advance(tree, gravity, tau, brake, pulls, step, q, dq, dt, workspace):
    """One integration step of positions and velocities, in place.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        tau: Joint torques [N·m], (n,).
        brake: Available braking torque of each joint [N·m], (n,), >= 0.
        pulls: `effects.pulls.Pulls`.
        step: Number of this step.
        q: Joint positions, (n,).
        dq: Joint velocities, (n,).
        dt: Step [s].
        workspace: Work arrays from `workshop`.
    """
    kin, body, fastest = tree
    links, factor, rows, x, impulses, acting = workspace
    n = len(kin)
    dynamics(tree, gravity, q, dq, links, factor, x)
    pulled(tree, links, pulls, step, x)
    for i in range(n):
        x[i] = tau[i] - body[i, DAMPING] * dq[i] - x[i]
        factor[i, i] += dt * body[i, IMPLICIT]
    factorise(kin, factor)
    solve(kin, factor, rows, n)
    held = False
    for i in range(n):
        dq[i] = min(max(dq[i] + dt * x[i], -fastest), fastest)
        held |= brake[i] > 0.0 or q[i] <= body[i, LOW] or q[i] >= body[i, HIGH]
    if held:
        stop(kin, factor, brake, body, q, dq, dt, rows, impulses, acting)
    for i in range(n):
        q[i] += dt * dq[i]


@kernel
def stop(kin, factor, brake, body, q, dq, dt, answer, applied, acting):
    """Impulses of joint stops and brakes; arguments as in `advance` and `workshop`.

    They are solved by projected Gauss-Seidel sweeps in alternating order. Brakes may oppose stops,
    and the error at the end of the sweeps affects light legs; so the order of the sweeps and their
    termination are those of PyBullet.
    """
    n = len(kin)
    count = 0
    for k in range(2 * n):  # brakes, then stops
        row, i = (k + n, k) if k < n else (k - n, k - n)
        if brake[i] > 0.0 if row >= n else q[i] <= body[i, LOW] or q[i] >= body[i, HIGH]:
            acting[count], applied[row] = row, 0.0
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
                max_impulse = brake[i] * dt
                impulse = min(max(applied[row] - dq[i] / answer[i, i], -max_impulse), max_impulse)
            elif q[i] <= body[i, LOW]:
                back = given_back(body[i, LOW] - q[i], dt)
                impulse = max(0.0, applied[row] + (back - dq[i]) / answer[i, i])
            else:
                back = given_back(body[i, HIGH] - q[i], dt)
                impulse = min(0.0, applied[row] + (back - dq[i]) / answer[i, i])
            shove(answer, i, impulse - applied[row], dq)
            moved = max(moved, abs(impulse - applied[row]) * answer[i, i])
            applied[row] = impulse
        if moved <= VELOCITY_TOLERANCE:
            break


@kernel
def given_back(penetration, dt):
    """Speed that corrects the penetration `penetration` of a stop [rad/s or m/s]."""
    return STOP_SHARE * penetration / dt if abs(penetration) < STOP_DEPTH else 0.0


@kernel
def shove(answer, i, impulse, dq):
    """Add the effect of an impulse on joint i to the velocities."""
    for j in range(len(dq)):
        dq[j] += impulse * answer[i, j]
