# SPDX-License-Identifier: Apache-2.0
"""Compiled loop of `loop.Bolted`: drives, springs, laws of effects and dynamics."""

from __future__ import annotations

import numpy as np

from ..drives.actuators import COMMANDS
from ..drives.servo_kernels import INTEGRAL, ROTOR, SPIN
from ..effects.laws import budgets, copy_rows, joint_torques
from ..effects.rows import GAIN, HYSTERESIS, LIMIT, ON_MOTOR, SAG, SPEED_LINE
from ..jit import kernel, njit
from ..multibody.dynamics import advance, workshop
from ..world.braking import split

MADE_OF = "19ea6b079abc"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py


@kernel
def load(plan, joint, memory, needed):
    """Tell hysteresis the torques that its joints need in their initial motion, if known, (n,)."""
    for k in range(len(plan)):
        if plan[k, 0] == HYSTERESIS:
            for r in range(plan[k, 1], plan[k, 2]):
                if np.isfinite(needed[joint[r]]):
                    memory[r, 1], memory[r, 2] = 1.0, needed[joint[r]]


@njit(error_model="numpy")
def run(inputs, out, memory_log):
    """Allocate the work arrays of `simulate`, and run it; arguments as there."""
    n = out.shape[2]
    workspace = (
        (np.empty(n), np.empty(n), np.empty(n), np.empty(2 * n), np.empty(n)),
        (np.empty((COMMANDS, n)), inputs.drives.copy(), np.empty((2, n)), np.empty(n), np.empty(n)),
        (np.empty(n), np.empty((2, n)), np.zeros(n)),
        workshop(n),
    )
    simulate(inputs, out, memory_log, workspace)


@kernel
def simulate(inputs, out, memory_log, workspace):
    """Simulate pieces of a command sequence, each from its own initial state, until one diverges.

    Args:
        inputs: `limbs.RunInputs`; states of drives and memory of effects are changed.
        out: Result: positions, velocities and mean torques before each row, (T, 3, n).
        memory_log: Result: memory of the effects before each row, (T, rows, MEMORY), or empty.
        workspace: Work arrays, from `run`.
    """
    tree, order, gravity, segments, starts, targets, which, power = inputs[:8]
    drives, springs, rotors, change, brakes, pulls, stop_ratio, motor_torque, dt = inputs[8:]
    plan, joint, const, memory, line = change
    brake_plan, brake_joint, brake_const = brakes[:3]
    n, steps = out.shape[2], len(which) // out.shape[0]
    (q, dq, push, state, mean), motors, brake_work, work = workspace
    command, _, _, tau, drive_tau = motors
    budget, split_up, motor = brake_work  # motor, q, dq and push are in the tree's order
    driven, has_brakes, weakened = (drives, springs, rotors), len(brake_plan) > 0, False
    for k in range(len(plan)):
        if plan[k, 0] in (GAIN, LIMIT, SPEED_LINE, SAG):
            for i in range(plan[k, 1], plan[k, 2]):
                weakened |= const[i, ON_MOTOR] != 0.0
    for w in range(len(segments)):
        for i in range(n):
            q[i], dq[i], mean[i] = starts[w, 0, order[i]], starts[w, 1, order[i]], 0.0
            rotors[i] = 0.0
            rotors[i, ROTOR], rotors[i, SPIN] = starts[w, 0, i], starts[w, 1, i]
            rotors[i, INTEGRAL] = starts[w, 2, i]
        memory[:] = 0.0
        line[:] = 0.0
        load(plan, joint, memory, starts[w, 3])
        step = segments[w, 0] * steps
        for row in range(segments[w, 0], segments[w, 1]):
            finite = True
            for i in range(n):
                finite &= np.isfinite(q[i]) and np.isfinite(dq[i])
            if not finite:
                break
            for i in range(n):
                out[row, 0, order[i]], out[row, 1, order[i]] = q[i], dq[i]
                out[row, 2, i] = mean[i]
                mean[i] = 0.0
            if len(memory_log):
                copy_rows(memory, memory_log[row])
            supply = power[row]
            for _ in range(steps):
                copy_rows(targets[which[step]], command)
                for i in range(n):
                    state[order[i]], state[n + order[i]] = q[i], dq[i]
                joint_torques(step, dt, supply, driven, change, weakened, state, motors)
                for i in range(n):
                    mean[i] += drive_tau[i] if motor_torque else tau[i]
                    push[i] = tau[order[i]]
                if has_brakes:
                    budget[:] = 0.0
                    velocity = state[n:]
                    budgets(step, brake_plan, brake_joint, brake_const, budget, drive_tau, velocity)
                    split(budget, velocity, stop_ratio[w], split_up)
                    for i in range(n):
                        motor[i] = split_up[0, order[i]]
                        push[i] += split_up[1, order[i]]
                advance(tree, gravity, push, motor, pulls, step, q, dq, dt, work)
                step += 1
            for i in range(n):
                mean[i] /= steps
