# SPDX-License-Identifier: Apache-2.0
"""Compiled loop of `loop.Bolted`: drives, springs, laws of effects and dynamics."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..drives.actuators import COMMANDS, add_springs, asked, drive_torques
from ..drives.servo_kernels import INTEGRAL, ROTOR, SPIN
from ..effects.laws import OF_DRIVE, OF_JOINT, bend, budgets, copy_rows, motors, torques
from ..effects.rows import GAIN, LIMIT, ON_MOTOR, SAG, SPEED_LINE
from ..jit import kernel
from ..world.braking import split
from .dynamics import advance, workshop

MADE_OF = "d0ac758e95bf"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py


@njit(cache=True, error_model="numpy")
def run(orders, out, memories):
    """Allocate the work arrays of `simulate`, and run it; arguments as there."""
    n = out.shape[2]
    room = (
        (np.empty(n), np.empty(n), np.empty(n), np.empty(2 * n), np.empty((COMMANDS, n))),
        (np.empty(n), np.empty(n), np.empty(n), np.empty((2, n)), orders.drives.copy()),
        (np.empty(n), np.empty((2, n)), np.zeros(n)),
        workshop(n),
    )
    simulate(orders, out, memories, room)


@kernel
def simulate(orders, out, memories, room):
    """Simulate pieces of a command sequence, each from its own initial state, until one diverges.

    Args:
        orders: `limbs.Orders`; states of drives and memory of effects are changed.
        out: Result: positions, velocities and mean torques before each row, (T, 3, n).
        memories: Result: memory of the effects before each row, (T, rows, MEMORY), or empty.
        room: Work arrays, from `run`.
    """
    tree, order, gravity, pieces, starts, targets, which, power = orders[:8]
    drives, springs, rotors, change, brakes, pulls, slow, dt = orders[8:]
    plan, joint, const, memory, line = change
    brake_plan, brake_joint, brake_const = brakes[:3]
    n, steps = out.shape[2], len(which) // out.shape[0]
    (q, dq, push, state, command), (tau, drive_tau, mean, share, rows), braked, work = room
    budget, split_up, motor = braked  # motor, q, dq and push are in the tree's order
    has_brakes, weakened = len(brake_plan) > 0, False
    for k in range(len(plan)):
        if plan[k, 0] in (GAIN, LIMIT, SPEED_LINE, SAG):
            for i in range(plan[k, 1], plan[k, 2]):
                weakened |= const[i, ON_MOTOR] != 0.0
    for w in range(len(pieces)):
        for i in range(n):
            q[i], dq[i], mean[i] = starts[w, 0, order[i]], starts[w, 1, order[i]], 0.0
            rotors[i] = 0.0
            rotors[i, ROTOR], rotors[i, SPIN] = starts[w, 0, i], starts[w, 1, i]
            rotors[i, INTEGRAL] = starts[w, 2, i]
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
                    asked(state, command, drives, rotors, supply, on, dt, step, share)
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
                    split(budget, velocity, slow[w], split_up)
                    for i in range(n):
                        motor[i] = split_up[0, order[i]]
                        push[i] += split_up[1, order[i]]
                advance(tree, gravity, push, motor, pulls, step, q, dq, dt, work)
                step += 1
            for i in range(n):
                mean[i] /= steps
