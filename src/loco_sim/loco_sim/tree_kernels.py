# SPDX-License-Identifier: Apache-2.0
"""Motion of a bolted tree of links: mass matrix, bias forces, and one step in time.

Recursive Newton-Euler and composite bodies in the axes of the world (Featherstone 2008,
Rigid body dynamics algorithms, chapters 5 and 6); semi-implicit Euler, stops and brakes as
impulses, like the engine's.
"""

from __future__ import annotations

import numpy as np
from numba import njit

STOP_SHARE = 0.2  # of the way beyond a stop that is given back per step, as the engine does
STOP_DEPTH = 0.04  # but nothing of a way that is longer [rad or m]
SWEEPS = 50  # of the impulses, at most
SETTLED = 1e-5  # they end when no joint's velocity changes by more, as the engine's [rad/s]


@njit(cache=True)
def cross(a, b, out):
    """Put a x b into out, (3,) each."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    out[0], out[1] = x, y


@njit(cache=True)
def product(a, b, out):
    """Put the product of two (3, 3) into a third."""
    for r in range(3):
        for c in range(3):
            out[r, c] = a[r, 0] * b[0, c] + a[r, 1] * b[1, c] + a[r, 2] * b[2, c]


@njit(cache=True)
def applied(a, v, out):
    """Put a (3, 3) times a (3,) into another (3,)."""
    for r in range(3):
        out[r] = a[r, 0] * v[0] + a[r, 1] * v[1] + a[r, 2] * v[2]


@njit(cache=True)
def turn_about(axis, angle, out):
    """Rotation about a unit axis, (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = axis[0], axis[1], axis[2]
    v = 1.0 - c
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@njit(cache=True)
def workshop(n):
    """Arrays that `dynamics` and `advance` work in, for n joints; making them takes longer."""
    vectors = np.empty((10, n, 3))
    return vectors, np.empty((2, n, 3, 3)), np.empty((6, 3)), np.empty((3, 3, 3)), np.empty((3, n))


@njit(cache=True)
def dynamics(tree, gravity, q, dq, room, mass_matrix, bias):
    """Mass matrix, (n, n), and torque that keeps all accelerations zero, (n,), in place.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        q: Joint positions [rad or m], (n,).
        dq: Joint velocities, (n,).
        room: From `workshop`.
        mass_matrix: Filled in.
        bias: Filled in.
    """
    outwards(tree, gravity, q, dq, room)
    inwards(tree, room, mass_matrix, bias)


@njit(cache=True)
def outwards(tree, gravity, q, dq, room):
    """From the base outwards: where links are, and what it takes to move them as they do.

    Args:
        tree: `tree.Tree`.
        gravity: Acceleration of gravity [m/s²], (3,).
        q: Joint positions [rad or m], (n,).
        dq: Joint velocities, (n,).
        room: From `workshop`; filled in for `inwards`, if no joint accelerates: origin of each
            link [m], axis of its joint, force on it [N], moment [N·m], mass times centre of
            mass, and inertia, the last three about the world's origin.
    """
    parent, slides, place, turn, axis, mass, com, inertia = tree[:8]
    n = len(parent)
    at, along, force, moment, first = room[0][0], room[0][1], room[0][2], room[0][3], room[0][4]
    spin, spin_rate, rate = room[0][5], room[0][6], room[0][7]  # acceleration: gravity included
    second, rot = room[1][0], room[1][1]  # link to world
    tmp, arm, x, y = room[2][0], room[2][1], room[2][2], room[2][3]
    own, world, base = room[3][0], room[3][1], room[3][2]
    for r in range(3):
        for c in range(3):
            base[r, c] = 1.0 if r == c else 0.0
    for i in range(n):
        p = parent[i]
        up = base if p < 0 else rot[p]
        product(up, turn[i], world)
        applied(world, axis[i], along[i])
        applied(up, place[i], arm)
        if slides[i]:
            rot[i, :, :] = world
            for r in range(3):
                arm[r] += along[i, r] * q[i]
        else:
            turn_about(axis[i], q[i], own)
            product(world, own, rot[i])
        if p < 0:
            for r in range(3):
                at[i, r], spin[i, r], spin_rate[i, r] = arm[r], 0.0, 0.0
                rate[i, r] = -gravity[r]
        else:
            carried(arm, spin[p], spin_rate[p], rate[p], x, y, rate[i])
            cross(spin[p], along[i], tmp)
            for r in range(3):
                at[i, r] = at[p, r] + arm[r]
                spin[i, r], spin_rate[i, r] = spin[p, r], spin_rate[p, r]
                if slides[i]:
                    rate[i, r] += 2.0 * dq[i] * tmp[r]
                else:
                    spin_rate[i, r] += dq[i] * tmp[r]
        if not slides[i]:
            for r in range(3):
                spin[i, r] += along[i, r] * dq[i]
        # Force and moment of the link, and its inertia about the world's origin.
        m = mass[i]
        applied(rot[i], com[i], arm)
        carried(arm, spin[i], spin_rate[i], rate[i], x, y, force[i])
        for r in range(3):
            force[i, r] *= m
            arm[r] += at[i, r]
            first[i, r] = m * arm[r]
        product(rot[i], inertia[i], world)
        product(world, rot[i].T, own)
        applied(own, spin[i], tmp)
        cross(spin[i], tmp, tmp)
        cross(arm, force[i], moment[i])
        square = arm[0] * arm[0] + arm[1] * arm[1] + arm[2] * arm[2]
        for r in range(3):
            moment[i, r] += tmp[r]
            for c in range(3):
                moment[i, r] += own[r, c] * spin_rate[i, c]
                second[i, r, c] = own[r, c] - m * arm[r] * arm[c]
            second[i, r, r] += m * square


@njit(cache=True)
def carried(arm, spin, spin_rate, rate, x, y, out):
    """Acceleration of a point that is `arm` away on a body, (3,) each; x and y are room."""
    cross(spin_rate, arm, x)
    cross(spin, arm, y)
    cross(spin, y, y)
    for r in range(3):
        out[r] = rate[r] + x[r] + y[r]


@njit(cache=True)
def inwards(tree, room, mass_matrix, bias):
    """From the tips inwards: what each joint carries; arguments as of `dynamics`."""
    parent, slides = tree[0], tree[1]
    at, along, force, moment, first = room[0][0], room[0][1], room[0][2], room[0][3], room[0][4]
    second, weight, tmp, arm = room[1][0], room[4][0], room[2][0], room[2][1]
    push, spun = room[2][2], room[2][3]  # momentum of what a joint moves with speed 1
    weight[:] = tree[5]
    for i in range(len(parent) - 1, -1, -1):
        cross(at[i], force[i], tmp)
        bias[i] = 0.0
        for r in range(3):
            bias[i] += along[i, r] * (force[i, r] if slides[i] else moment[i, r] - tmp[r])
        if slides[i]:
            for r in range(3):
                push[r] = weight[i] * along[i, r]
            cross(first[i], along[i], spun)
        else:
            cross(at[i], along[i], arm)  # velocity of the point at the world's origin
            cross(along[i], first[i], push)
            cross(first[i], arm, spun)
            for r in range(3):
                push[r] += weight[i] * arm[r]
                for c in range(3):
                    spun[r] += second[i, r, c] * along[i, c]
        j = i
        while j >= 0:
            total = 0.0
            cross(at[j], push, tmp)
            for r in range(3):
                total += along[j, r] * (push[r] if slides[j] else spun[r] - tmp[r])
            mass_matrix[i, j] = mass_matrix[j, i] = total
            j = parent[j]
        p = parent[i]
        if p >= 0:
            weight[p] += weight[i]
            for r in range(3):
                force[p, r] += force[i, r]
                moment[p, r] += moment[i, r]
                first[p, r] += first[i, r]
                for c in range(3):
                    second[p, r, c] += second[i, r, c]


@njit(cache=True)
def factorise(parent, matrix):
    """L' L of a mass matrix, in place in its lower half; zeros between branches are skipped."""
    for k in range(len(parent) - 1, -1, -1):
        matrix[k, k] = np.sqrt(matrix[k, k])
        i = parent[k]
        while i >= 0:
            matrix[k, i] /= matrix[k, k]
            i = parent[i]
        i = parent[k]
        while i >= 0:
            j = i
            while j >= 0:
                matrix[i, j] -= matrix[k, i] * matrix[k, j]
                j = parent[j]
            i = parent[i]


@njit(cache=True)
def solve(parent, factor, x):
    """Solve M x = x in place, with M from `factorise`."""
    n = len(parent)
    for i in range(n - 1, -1, -1):
        x[i] /= factor[i, i]
        j = parent[i]
        while j >= 0:
            x[j] -= factor[i, j] * x[i]
            j = parent[j]
    for i in range(n):
        j = parent[i]
        while j >= 0:
            x[i] -= factor[i, j] * x[j]
            j = parent[j]
        x[i] /= factor[i, i]


@njit(cache=True)
def pulled(tree, room, pulls, step, x):
    """Take what forces from outside do at the joints from torques, in place.

    Args:
        tree: `tree.Tree`.
        room: After `outwards`.
        pulls: `effects.pulls.Pulls`.
        step: Of the run.
        x: Torques [N·m], (n,).
    """
    parent, slides = tree[0], tree[1]
    at, along, rot = room[0][0], room[0][1], room[1][1]
    body, window, const = pulls
    point, force, moment = room[2][0], room[2][1], room[2][2]
    for k in range(len(body)):
        i = body[k]
        if i < 0 or not window[k, 0] <= step < window[k, 1]:
            continue
        applied(rot[i], const[k, 0:3], point)
        distance = 0.0
        for r in range(3):
            point[r] += at[i, r]
            force[r] = const[k, 3 + r]
            distance += (const[k, 6 + r] - point[r]) ** 2
        distance = np.sqrt(distance)
        if const[k, 9] > 0.0 and distance > const[k, 10]:
            pull = const[k, 9] * (distance - const[k, 10]) / distance
            for r in range(3):
                force[r] += pull * (const[k, 6 + r] - point[r])
        while i >= 0:
            for r in range(3):
                room[2][3][r] = point[r] - at[i, r]
            cross(room[2][3], force, moment)
            for r in range(3):
                x[i] -= along[i, r] * (force[r] if slides[i] else moment[r])
            i = parent[i]


@njit(cache=True)
def advance(tree, gravity, tau, brake, pulls, step, q, dq, dt, room, factor):
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
        room: From `workshop`.
        factor: Room for the mass matrix, (n, n), with zeros between branches.
    """
    parent, damping, low, high, fastest = tree[0], tree[8], tree[9], tree[10], tree[11]
    n, x = len(parent), room[4][1]
    dynamics(tree, gravity, q, dq, room, factor, x)
    pulled(tree, room, pulls, step, x)
    for i in range(n):
        x[i] = tau[i] - damping[i] * dq[i] - x[i]
    factorise(parent, factor)
    solve(parent, factor, x)
    held = False
    for i in range(n):
        dq[i] = min(max(dq[i] + dt * x[i], -fastest), fastest)
        held |= brake[i] > 0.0 or q[i] <= low[i] or q[i] >= high[i]
    if held:
        stop(parent, factor, brake, low, high, q, dq, dt)
    for i in range(n):
        q[i] += dt * dq[i]


@njit(cache=True)
def stop(parent, factor, brake, low, high, q, dq, dt):
    """Impulses of stops and brakes, by sweeps to and fro; arguments as of `advance`.

    A brake may work against a stop, and light legs feel what is left over when the sweeps
    end: so order and end are those of the engine.
    """
    n = len(parent)
    answer = np.zeros((n, n))  # rows: velocities after an impulse of 1 on a joint
    given = np.zeros(2 * n)  # by stops, then by brakes
    active = np.zeros(2 * n, dtype=np.bool_)
    for i in range(n):
        active[i], active[n + i] = q[i] <= low[i] or q[i] >= high[i], brake[i] > 0.0
        if active[i] or active[n + i]:
            answer[i, i] = 1.0
            solve(parent, factor, answer[i])
    for sweep in range(SWEEPS):
        moved = 0.0
        for k in range(2 * n):
            row = (n - 1 - k) % (2 * n) if sweep % 2 == 0 else (n + k) % (2 * n)
            if not active[row]:
                continue
            i = row % n
            if row >= n:
                most = brake[i] * dt
                wanted = min(max(given[row] - dq[i] / answer[i, i], -most), most)
            elif q[i] <= low[i]:
                back = given_back(low[i] - q[i], dt)
                wanted = max(0.0, given[row] + (back - dq[i]) / answer[i, i])
            else:
                back = given_back(high[i] - q[i], dt)
                wanted = min(0.0, given[row] + (back - dq[i]) / answer[i, i])
            shove(answer[i], wanted - given[row], dq)
            moved = max(moved, abs(wanted - given[row]) * answer[i, i])
            given[row] = wanted
        if moved <= SETTLED:
            break


@njit(cache=True)
def given_back(way, dt):
    """Speed with which a stop pushes a joint back that is beyond it [rad/s or m/s]."""
    return STOP_SHARE * way / dt if abs(way) < STOP_DEPTH else 0.0


@njit(cache=True)
def shove(answer, impulse, dq):
    """Add what an impulse does to the velocities."""
    for j in range(len(dq)):
        dq[j] += impulse * answer[j]
