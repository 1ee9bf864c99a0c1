# SPDX-License-Identifier: Apache-2.0
"""Runs the laws of a `chain.Chain`, one after the other."""

from __future__ import annotations

from numba import njit

from . import laws
from .chain import (
    BACKLASH,
    DELAY,
    END_STOP,
    GAIN,
    HYSTERESIS,
    LAG,
    LIMIT,
    MAXWELL,
    RESCALED,
    SAG,
    SATURATION,
    SERIES,
    SHIFTED,
    SPEED_LINE,
    SPRING,
)

MADE_OF = "44738cb09cc0"  # of the kernels called here: see tests/loco_sim/test_kernel_caches.py


@njit(cache=True)
def torques(step, dt, plan, joint, const, memory, line, tau, q, dq):
    """Run laws of the torque one after the other, in place.

    Args:
        step: Physics step.
        dt: Its length [s].
        plan: Law, first row, row after the last, first step, step after the last, (m, 5).
        joint: Joint of each row, (r,).
        const: Constants of each row, (r, CONSTANTS).
        memory: Memory of each row, (r, MEMORY).
        line: Delay lines of all rows.
        tau: Torques [N·m], (n,).
        q: Joint positions [rad], (n,).
        dq: Joint velocities [rad/s], (n,).
    """
    for k in range(plan.shape[0]):
        law, a, b = plan[k, 0], plan[k, 1], plan[k, 2]
        if step < plan[k, 3] or step >= plan[k, 4]:
            continue
        if law == GAIN:
            laws.gain(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == DELAY:
            laws.delay(a, b, joint, const, memory, line, tau)
        elif law == LAG:
            laws.lag(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == LIMIT:
            laws.limit(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SPEED_LINE:
            laws.speed_line(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SAG:
            laws.sag(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == BACKLASH:
            laws.backlash(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SERIES:
            laws.series(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SPRING:
            laws.spring(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SATURATION:
            laws.saturation(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == RESCALED:
            laws.rescaled(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SHIFTED:
            laws.shifted(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == END_STOP:
            laws.end_stop(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == HYSTERESIS:
            laws.hysteresis(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == MAXWELL:
            laws.maxwell(a, b, joint, const, memory, tau, q, dq, dt)


@njit(cache=True)
def motors(step, plan, joint, const, rows, asked, speed):
    """Run laws of motors one after the other, in place of what servos are.

    Args:
        step: Physics step.
        plan: As of `torques`.
        joint: As there.
        const: As there.
        rows: Drives, as in `servo.ServoParams.row`, (n, 9); changed.
        asked: Share of the voltage that each asks for, (n,).
        speed: Of its rotor [rad/s], (n,).
    """
    for k in range(plan.shape[0]):
        law, a, b = plan[k, 0], plan[k, 1], plan[k, 2]
        if step < plan[k, 3] or step >= plan[k, 4]:
            continue
        if law == GAIN:
            laws.motor_gain(a, b, joint, const, rows)
        elif law == LIMIT:
            laws.motor_limit(a, b, joint, const, rows)
        elif law == SPEED_LINE:
            laws.motor_line(a, b, joint, const, rows, asked, speed)
        elif law == SAG:
            laws.motor_sag(a, b, joint, const, rows, asked, speed)


@njit(cache=True)
def budgets(step, plan, joint, const, budget, tau, dq):
    """Add up laws of friction, in place; arguments as of `torques`."""
    for k in range(plan.shape[0]):
        if plan[k, 3] <= step < plan[k, 4]:
            laws.friction(plan[k, 1], plan[k, 2], joint, const, budget, tau, dq)
