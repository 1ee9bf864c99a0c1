# SPDX-License-Identifier: Apache-2.0
"""Compiled loop of `compiled.Compiled`: drives, springs, laws of effects, engine steps.

It runs without the Python interpreter and its lock, so that threads run in parallel.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from ..drives.actuators import COMMANDS
from ..effects.laws import budgets, copy_rows, joint_torques
from ..jit import njit
from ..world.hinges import torque as hinge_torque
from .sensing import BASE

MADE_OF = "9e80ea94336e"  # of the kernels called here: see tests/loco_sim/test_kernel_caches.py


@intrinsic
def call(typing_context, address, model, data):
    """Call a C function that takes a model and its data, by its address."""

    def code(context, builder, signature, args):
        kind = ir.FunctionType(ir.VoidType(), [args[1].type, args[2].type])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp), code


@njit(error_model="numpy", nogil=True)
def run(engine, drives, acting, commands, first, dt, memory_log, out):
    """Simulate commands while the state is finite; return the number of simulated rows.

    Args:
        engine: `world.Handles`.
        drives: Drives, springs and states of drives as in `actuators.drive_torques`; the states
            are changed.
        acting: `compiled.Acting`.
        commands: Commands as in `actuators.drive_torques`, (k, COMMANDS, n); their index at each
            physics step, (T * steps,); and supply and switch of the drives in each row, (T, 2).
        first: Number of the first physics step.
        dt: Physics step [s].
        memory_log: Result: memory of the effects before each row and after the last,
            (T + 1, rows, MEMORY), or empty.
        out: Result: the state before each row and after the last, (T + 1, 3 n + 3 m + BASE):
            positions, velocities and mean torques of the joints, ground force on each foot
            (world frame), state of the base; torques and forces of the first row are not set.
    """
    table, which, power = commands
    memory = acting.change[3]
    brake_plan, brake_joint, brake_const = acting.brakes[:3]
    n, m, rows = len(engine.q_at), len(engine.feet), len(power)
    steps, event = len(which) // rows, 0
    state, command, budget = np.empty(2 * n), np.empty((COMMANDS, n)), np.zeros(n)
    tau, drive_tau = np.empty(n), np.empty(n)
    work = command, drives[0].copy(), np.empty((2, n)), tau, drive_tau
    observe(engine, out[0])
    if len(memory_log):
        copy_rows(memory, memory_log[0])
    for row in range(rows):
        reading, supply = out[row + 1], power[row]
        reading[2 * n : 3 * n + m] = 0.0
        for k in range(steps):
            at = row * steps + k
            step = first + at
            for i in range(n):
                state[i], state[n + i] = engine.q[engine.q_at[i]], engine.dq[engine.dq_at[i]]
            copy_rows(table[which[at]], command)
            joint_torques(step, dt, supply, drives, acting.change, acting.weakens, state, work)
            for i in range(n):
                reading[2 * n + i] += drive_tau[i] if acting.motor_torque else tau[i]
                engine.tau[engine.dq_at[i]] = tau[i]
            if len(brake_plan):
                budget[:] = 0.0
                budgets(step, brake_plan, brake_joint, brake_const, budget, drive_tau, state[n:])
                for i in range(n):
                    engine.held[engine.dq_at[i]] = budget[i]
            hang(engine, acting.hinges, dt)
            while event < len(acting.slips[0]) and acting.slips[0][event, 0] <= step:
                engine.friction[acting.slips[0][event, 1], 0] = acting.slips[1][event]
                event += 1
            pulled = pull(engine, acting.pulls, step)
            call(engine.step, engine.model, engine.data)
            if pulled:
                engine.wrench[:] = 0.0
            limit_speed(engine)
            if engine.warned[0] != engine.quiet:
                return row
            if engine.mean or k == steps - 1:
                for i in range(m):
                    reading[3 * n + i] += engine.feet[i]
        for i in range(n):
            reading[2 * n + i] /= steps
        if engine.mean:
            for i in range(m):
                reading[3 * n + i] /= steps
        observe(engine, reading)
        if len(memory_log):
            copy_rows(memory, memory_log[row + 1])
        if not np.isfinite(np.sum(reading)):
            return row
    return rows


@njit(error_model="numpy", nogil=True)
def limit_speed(engine):
    """Limit all velocities to the fastest, as PyBullet does."""
    for i in range(len(engine.dq)):
        if abs(engine.dq[i]) > engine.fastest:
            engine.dq[i] = engine.fastest if engine.dq[i] > 0.0 else -engine.fastest


@njit(nogil=True)
def step_engine(engine, steps):
    """Advance the engine alone by `steps` steps, with unchanged torques."""
    for _ in range(steps):
        call(engine.step, engine.model, engine.data)


@njit(error_model="numpy", nogil=True)
def observe(engine, reading):
    """Current state of joints and base, written into a row of `out` of `run`."""
    n, q, dq = len(engine.q_at), engine.q, engine.dq
    for i in range(n):
        reading[i], reading[n + i] = q[engine.q_at[i]], dq[engine.dq_at[i]]
    base = reading[len(reading) - BASE :]
    if len(engine.fixed):
        for i in range(BASE):
            base[i] = engine.fixed[i]
        return
    w, x, y, z = q[3], q[4], q[5], q[6]
    base[0], base[1], base[2], base[3], base[4], base[5], base[6] = q[0], q[1], q[2], x, y, z, w
    base[7], base[8], base[9] = dq[0], dq[1], dq[2]
    a, b, c = dq[3], dq[4], dq[5]  # angular velocity in the body frame
    base[10] = (
        (1.0 - 2.0 * (y * y + z * z)) * a + 2.0 * (x * y - z * w) * b + 2.0 * (x * z + y * w) * c
    )
    base[11] = (
        2.0 * (x * y + z * w) * a + (1.0 - 2.0 * (x * x + z * z)) * b + 2.0 * (y * z - x * w) * c
    )
    base[12] = (
        2.0 * (x * z - y * w) * a + 2.0 * (y * z + x * w) * b + (1.0 - 2.0 * (x * x + y * y)) * c
    )


@njit(error_model="numpy", nogil=True)
def hang(engine, hinges, dt):
    """Apply the torques of sprung hinges within links; `hinges` has stiffness, damping, inertia."""
    for i in range(len(hinges)):
        spring, at = (hinges[i, 0], hinges[i, 1]), engine.hinge_dq_at[i]
        deflection = engine.q[engine.hinge_q_at[i]], engine.dq[at]
        engine.tau[at] = hinge_torque(spring, deflection, hinges[i, 2], dt)


@njit(error_model="numpy", nogil=True)
def pull(engine, pulls, step):
    """Apply the external forces of one step, `pulls.Pulls` on bodies; whether there are any."""
    body, window, const = pulls
    active = False
    for k in range(len(body)):
        if not window[k, 0] <= step < window[k, 1]:
            continue
        if not active:
            call(engine.look, engine.model, engine.data)
            active = True
        b, c = body[k], const[k]
        place, turn, centre = engine.place[b], engine.turn[b], engine.centre[b]
        ax = place[0] + turn[0] * c[0] + turn[1] * c[1] + turn[2] * c[2]
        ay = place[1] + turn[3] * c[0] + turn[4] * c[1] + turn[5] * c[2]
        az = place[2] + turn[6] * c[0] + turn[7] * c[1] + turn[8] * c[2]
        fx, fy, fz = c[3], c[4], c[5]
        wx, wy, wz = c[6] - ax, c[7] - ay, c[8] - az
        distance = np.sqrt(wx * wx + wy * wy + wz * wz)
        if c[9] > 0.0 and distance > c[10]:
            strength = c[9] * (distance - c[10]) / distance
            fx, fy, fz = fx + strength * wx, fy + strength * wy, fz + strength * wz
        ax, ay, az = ax - centre[0], ay - centre[1], az - centre[2]
        wrench = engine.wrench[b]
        wrench[0] += fx
        wrench[1] += fy
        wrench[2] += fz
        wrench[3] += ay * fz - az * fy
        wrench[4] += az * fx - ax * fz
        wrench[5] += ax * fy - ay * fx
    return active
