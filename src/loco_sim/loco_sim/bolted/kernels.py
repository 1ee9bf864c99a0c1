# SPDX-License-Identifier: Apache-2.0
"""Compiled loop of `loop.Bolted`: drives, springs, laws of effects and dynamics."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..drives.actuators import COMMANDS, add_springs, asked, drive_torques
from ..drives.servo_kernels import ROTOR, SPIN
from ..effects.laws import bend, budgets, motors, torques
from ..effects.rows import GAIN, LIMIT, ON_MOTOR, SAG, SPEED_LINE
from ..world.braking import split
from .dynamics import advance, workshop

MADE_OF = "c0c5437480e0"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py


@njit(cache=True, error_model="numpy")
def run(
    tree,
    order,
    gravity,
    pieces,
    starts,
    targets,
    which,
    power,
    drives,
    springs,
    rotors,
    change,
    brakes,
    pulls,
    slow,
    dt,
    out,
    memories,
):
    """Simulate pieces of a command sequence, each from its own initial state, until one diverges.

    Args:
        tree: `tree.Tree` of n joints.
        order: Index among the robot's joints of each joint of the tree, (n,).
        gravity: Acceleration of gravity [m/s²], (3,).
        pieces: First row of each piece and the row after its last, (w, 2).
        starts: Initial positions and velocities of each piece, in the robot's order, (w, 2, n).
        targets: Commands as in `actuators.drive_torques`, in the robot's order, (k, COMMANDS, n).
        which: Row of `targets` for each physics step, (T * steps,).
        power: Supply and switch of each row, (T, 2).
        drives: Drives as in `actuators.drive_torques`, (n, COLUMNS).
        springs: Springs as in `actuators.add_springs`, (n, 7).
        rotors: State of the drives as in `actuators.drive_torques`, (n, MEMORY);
            changed.
        change: `effects.rows.Laws` of the effects on torques.
        brakes: `effects.rows.Laws` of the friction effects.
        pulls: `effects.pulls.Pulls`.
        slow: Values of `braking.stopped_per_torque` per piece, in the robot's order, (w, n).
        dt: Physics step [s].
        out: Result: positions, velocities and mean torques before each row, (T, 3, n).
        memories: Result: memory of the effects before each row, (T, rows, MEMORY), or empty.
    """
    memory, line, n = change[3], change[4], out.shape[2]
    q, dq = np.empty(n), np.empty(n)  # in the order of the tree
    for w in range(len(pieces)):
        for i in range(n):
            q[i], dq[i] = starts[w, 0, order[i]], starts[w, 1, order[i]]
            rotors[i] = 0.0
            rotors[i, ROTOR], rotors[i, SPIN] = starts[w, 0, i], starts[w, 1, i]
        memory[:] = 0.0
        line[:] = 0.0
        follow(
            tree, order, gravity, q, dq, pieces[w, 0], pieces[w, 1], targets, which, power,
            drives, springs, rotors, change, brakes, pulls, slow[w], dt, out, memories,
        )  # fmt: skip


@njit(cache=True, error_model="numpy")
def follow(
    tree,
    order,
    gravity,
    q,
    dq,
    first,
    stop,
    targets,
    which,
    power,
    drives,
    springs,
    rotors,
    change,
    brakes,
    pulls,
    slow,
    dt,
    out,
    memories,
):
    """Simulate one piece; arguments as in `run`, `q` and `dq` in the order of the tree, changed."""
    plan, joint, const, memory, line = change
    brake_plan, brake_joint, brake_const = brakes[:3]
    n = len(q)
    steps = len(which) // out.shape[0]
    state, mean = np.empty(2 * n), np.zeros(n)
    command, budget, tau, drive_tau = np.empty((COMMANDS, n)), np.zeros(n), np.empty(n), np.empty(n)
    push, motor = np.empty(n), np.zeros(n)  # in the order of the tree
    step, has_brakes, weakened = first * steps, len(brake_plan) > 0, False
    rows = drives.copy()
    for k in range(len(plan)):
        if plan[k, 0] in (GAIN, LIMIT, SPEED_LINE, SAG):
            weakened |= np.any(const[plan[k, 1] : plan[k, 2], ON_MOTOR] != 0.0)
    work = workshop(n)
    for row in range(first, stop):
        for i in range(n):
            if not (np.isfinite(q[i]) and np.isfinite(dq[i])):
                return
        for i in range(n):
            out[row, 0, order[i]], out[row, 1, order[i]] = q[i], dq[i]
            out[row, 2, i] = mean[i]
        if len(memories):
            memories[row] = memory
        mean[:] = 0.0
        for _ in range(steps):
            target_row = which[step]
            for c in range(COMMANDS):
                for i in range(n):
                    command[c, i] = targets[target_row, c, i]
            for i in range(n):
                state[order[i]], state[n + order[i]] = q[i], dq[i]
            if len(plan):
                bend(step, plan, joint, memory, command)
            supply, on = power[row, 0], power[row, 1]
            if weakened:
                rows[:] = drives
                share = asked(state, command, drives, rotors, supply, on, dt, step)
                motors(step, plan, joint, const, rows, share[0], share[1])
            drive_torques(state, command, rows, rotors, dt, supply, on, tau, step)
            if len(plan):
                torques(True, step, dt, change, tau, state[:n], state[n:])
            drive_tau[:] = tau
            add_springs(state, springs, tau)
            if len(plan):
                torques(False, step, dt, change, tau, state[:n], state[n:])
            for i in range(n):
                mean[i] += tau[i]
                push[i] = tau[order[i]]
            if has_brakes:
                budget[:] = 0.0
                budgets(step, brake_plan, brake_joint, brake_const, budget, drive_tau, state[n:])
                held, drag = split(budget, state[n:], slow)
                for i in range(n):
                    push[i] += drag[order[i]]
                    motor[i] = held[order[i]]
            advance(tree, gravity, push, motor, pulls, step, q, dq, dt, work)
            step += 1
        mean /= steps
