# SPDX-License-Identifier: Apache-2.0
"""Compiled loop of `loop.Bolted`: drives, springs, laws of effects and dynamics."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..drives.actuators import COMMANDS, add_springs, asked, drive_torques
from ..drives.servo_kernels import ROTOR, SPIN
from ..effects.laws import OF_DRIVE, OF_JOINT, bend, budgets, copy_rows, motors, torques
from ..effects.rows import GAIN, LIMIT, ON_MOTOR, SAG, SPEED_LINE
from ..world.braking import split
from .dynamics import advance, workshop

MADE_OF = "da436373395e"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py


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
    plan, joint, const, memory, line = change
    brake_plan, brake_joint, brake_const = brakes[:3]
    n, steps = out.shape[2], len(which) // out.shape[0]
    q, dq, push, motor = np.empty(n), np.empty(n), np.empty(n), np.zeros(n)  # in the tree's order
    state, command, mean = np.empty(2 * n), np.empty((COMMANDS, n)), np.empty(n)
    budget, tau, drive_tau, rows = np.zeros(n), np.empty(n), np.empty(n), drives.copy()
    has_brakes, weakened = len(brake_plan) > 0, False
    for k in range(len(plan)):
        if plan[k, 0] in (GAIN, LIMIT, SPEED_LINE, SAG):
            for i in range(plan[k, 1], plan[k, 2]):
                weakened |= const[i, ON_MOTOR] != 0.0
    work = workshop(n)
    for w in range(len(pieces)):
        for i in range(n):
            q[i], dq[i], mean[i] = starts[w, 0, order[i]], starts[w, 1, order[i]], 0.0
            rotors[i] = 0.0
            rotors[i, ROTOR], rotors[i, SPIN] = starts[w, 0, i], starts[w, 1, i]
        memory[:] = 0.0
        line[:] = 0.0
        step = pieces[w, 0] * steps
        for row in range(pieces[w, 0], pieces[w, 1]):
            finite = True
            for i in range(n):
                finite &= np.isfinite(q[i]) and np.isfinite(dq[i])
            if not finite:
                break
            for i in range(n):
                out[row, 0, order[i]], out[row, 1, order[i]] = q[i], dq[i]
                out[row, 2, i] = mean[i]
                mean[i] = 0.0
            if len(memories):
                copy_rows(memory, memories[row])
            for _ in range(steps):
                copy_rows(targets[which[step]], command)
                for i in range(n):
                    state[order[i]], state[n + order[i]] = q[i], dq[i]
                if len(plan):
                    bend(step, plan, joint, memory, command)
                supply, on = power[row, 0], power[row, 1]
                if weakened:
                    copy_rows(drives, rows)
                    share = asked(state, command, drives, rotors, supply, on, dt, step)
                    motors(step, plan, joint, const, rows, share[0], share[1])
                drive_torques(state, command, rows, rotors, dt, supply, on, tau, step)
                if len(plan):
                    torques(OF_DRIVE, step, dt, change, tau, state[:n], state[n:])
                for i in range(n):
                    drive_tau[i] = tau[i]
                add_springs(state, springs, tau)
                if len(plan):
                    torques(OF_JOINT, step, dt, change, tau, state[:n], state[n:])
                for i in range(n):
                    mean[i] += tau[i]
                    push[i] = tau[order[i]]
                if has_brakes:
                    budget[:] = 0.0
                    velocity = state[n:]
                    budgets(step, brake_plan, brake_joint, brake_const, budget, drive_tau, velocity)
                    held, drag = split(budget, velocity, slow[w])
                    for i in range(n):
                        push[i] += drag[order[i]]
                        motor[i] = held[order[i]]
                advance(tree, gravity, push, motor, pulls, step, q, dq, dt, work)
                step += 1
            for i in range(n):
                mean[i] /= steps
