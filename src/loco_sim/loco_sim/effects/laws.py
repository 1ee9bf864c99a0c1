# SPDX-License-Identifier: Apache-2.0
"""Compiled laws of the effects in the joints: each changes torques or braking torques in place.

A law runs over rows ``first`` to ``last``; row r belongs to joint ``joint[r]`` and has its
constants in ``const[r]`` and its state in ``memory[r]``, zero after a reset. The constants are
set by the effect of the law; `torques`, `motors` and `budgets` run the laws of a
`chain.Chain`, one after the other. Torques [N·m], angles [rad], time [s]; on a prismatic joint
forces [N] and lengths [m].
"""

from __future__ import annotations

from math import cos, exp, sin, tanh

import numpy as np

from ..drives.actuators import add_springs, drive_demand, drive_torques
from ..drives.learned_kernels import learned_torque
from ..drives.servo_kernels import due, motor_torque, scaled
from ..drives.spring_kernels import spring_torque
from ..jit import inlined, kernel
from .rows import (
    BACKLASH,
    COMPENSATION,
    COUPLED,
    DELAY,
    END_STOP,
    GAIN,
    HOLD,
    HYSTERESIS,
    LAG,
    LEARNED,
    LIMIT,
    MAXWELL,
    OF_DRIVES,
    ON_MOTOR,
    RESCALED,
    SAG,
    SATURATION,
    SERIES,
    SHIFTED,
    SPEED_LINE,
    SPRING,
    WAVE,
)

MADE_OF = "72876aa2cf40"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py

REST = 1e-5  # speed below which a joint is at rest, above numerical noise [rad/s] (taste)
OF_DRIVE, OF_JOINT = np.array([True, False])  # of `torques`; numba compiles for each literal anew
SPRING_AT = 2  # index of the first spring constant (`spring.SpringParams.row`) among the constants


@kernel
def copy_rows(values, to):
    """Write `values`, (n, m), into `to`; numba takes seconds to compile it as a slice."""
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            to[i, k] = values[i, k]


@kernel
def gain(first, last, joint, const, memory, tau, q, dq, dt):
    """Law tau <- (1 + error) tau; const: error."""
    for r in range(first, last):
        if const[r, ON_MOTOR] == 0.0:
            tau[joint[r]] *= 1.0 + const[r, 0]


@kernel
def motor_gain(first, last, joint, const, rows):
    """Law `gain` on motors."""
    for r in range(first, last):
        if const[r, ON_MOTOR] != 0.0:
            scaled(rows[joint[r]], 1.0 + const[r, 0])


@kernel
def delay(first, last, joint, const, memory, line, tau):
    """tau(t) <- tau(t - delay); const: delay in steps, start of its delay line.

    The first value is held until delayed values arrive. memory: steps so far, position in the line.
    """
    for r in range(first, last):
        steps, base = int(const[r, 0]), int(const[r, 1])
        if steps == 0:
            continue
        if memory[r, 0] == 0.0:
            for k in range(steps):
                line[base + k] = tau[joint[r]]
            memory[r, 0] = 1.0
        place = int(memory[r, 1])
        late = line[base + place]
        line[base + place] = tau[joint[r]]
        tau[joint[r]] = late
        memory[r, 1] = place + 1 if place + 1 < steps else 0


@kernel
def lag(first, last, joint, const, memory, tau, q, dq, dt):
    """T dy/dt = tau - y, tau <- mean of y over the step; memory: started, y at its end.

    The end value would be half a step early. const: exp(-dt / T), and its mean from 0 to dt.
    """
    for r in range(first, last):
        j = joint[r]
        if memory[r, 0] == 0.0:
            memory[r, 0], memory[r, 1] = 1.0, tau[j]
        target, lead = tau[j], memory[r, 1] - tau[j]
        memory[r, 1] = target + const[r, 0] * lead
        tau[j] = target + const[r, 1] * lead


@kernel
def limit(first, last, joint, const, memory, tau, q, dq, dt):
    """|tau| <= limit; const: limit."""
    for r in range(first, last):
        j = joint[r]
        if const[r, ON_MOTOR] == 0.0:
            tau[j] = min(max(tau[j], -const[r, 0]), const[r, 0])


@kernel
def motor_limit(first, last, joint, const, rows):
    """Law `limit` on motors."""
    for r in range(first, last):
        if const[r, ON_MOTOR] != 0.0:
            rows[joint[r], 8] = min(rows[joint[r], 8], const[r, 0])


@kernel
def speed_line(first, last, joint, const, memory, tau, q, dq, dt):
    """|tau| <= stall (1 - slope |dq|) if tau dq > 0; const: stall, slope."""
    for r in range(first, last):
        j = joint[r]
        if const[r, ON_MOTOR] == 0.0 and tau[j] * dq[j] > 0.0:
            bound = const[r, 0] * max(0.0, 1.0 - const[r, 1] * abs(dq[j]))
            tau[j] = min(max(tau[j], -bound), bound)


@kernel
def motor_line(first, last, joint, const, rows, duty, speed):
    """Law `speed_line` on motors, at their speed."""
    for r in range(first, last):
        j = joint[r]
        if const[r, ON_MOTOR] != 0.0 and motor_torque(rows[j], duty[j], speed[j]) * speed[j] > 0.0:
            bound = const[r, 0] * max(0.0, 1.0 - const[r, 1] * abs(speed[j]))
            rows[j, 8] = min(rows[j, 8], bound)


@kernel
def sag(first, last, joint, const, memory, tau, q, dq, dt):
    """Law tau <- tau (1 - sag mean |tau| / stall); const: stall, sag."""
    load = 0.0
    for r in range(first, last):
        if const[r, ON_MOTOR] == 0.0:
            load += abs(tau[joint[r]]) / const[r, 0]
    load /= max(1, last - first)
    for r in range(first, last):
        if const[r, ON_MOTOR] == 0.0:
            tau[joint[r]] *= max(0.0, 1.0 - const[r, 1] * load)


@kernel
def motor_sag(first, last, joint, const, rows, duty, speed):
    """Law `sag` on motors; the load of drives without a rotor does not count."""
    load = 0.0
    for r in range(first, last):
        j = joint[r]
        if const[r, ON_MOTOR] != 0.0:
            load += abs(motor_torque(rows[j], duty[j], speed[j])) / const[r, 0]
    load /= max(1, last - first)
    for r in range(first, last):
        if const[r, ON_MOTOR] != 0.0:
            scaled(rows[joint[r]], max(0.0, 1.0 - const[r, 1] * load))


@kernel
def backlash(first, last, joint, const, memory, tau, q, dq, dt):
    """Torque is transmitted only while the motor touches an end of the play.

    const: half the play, rotor inertia. memory: started, motor minus joint, motor speed.
    """
    for r in range(first, last):
        j, half_play, want = joint[r], const[r, 0], tau[joint[r]]
        if memory[r, 0] == 0.0:
            memory[r, 0], memory[r, 2] = 1.0, dq[j]
            memory[r, 1] = half_play if want > 0.0 else (-half_play if want < 0.0 else 0.0)
        gap, speed = memory[r, 1], memory[r, 2]
        if (gap >= half_play and want > 0.0) or (gap <= -half_play and want < 0.0):
            memory[r, 2] = dq[j]
            continue
        tau[j] = 0.0
        speed += want / const[r, 1] * dt
        gap += (speed - dq[j]) * dt
        if abs(gap) >= half_play:
            gap, speed = (half_play if gap > 0.0 else -half_play), dq[j]
        memory[r, 1], memory[r, 2] = gap, speed


@kernel
def series(first, last, joint, const, memory, tau, q, dq, dt):
    """A spring between motor and joint; the motor equation is solved implicitly.

    J w' = tau - (theta - q) / c - d (w - dq), tau <- (theta - q) / c + d (w - dq).
    const: c, J, d. memory: started, theta, theta - q, w - dq, w.
    """
    for r in range(first, last):
        j, c, inertia, d = joint[r], const[r, 0], const[r, 1], const[r, 2]
        if memory[r, 0] == 0.0:
            memory[r, 0], memory[r, 1], memory[r, 4] = 1.0, q[j] + c * tau[j], dq[j]
        pull = tau[j] - (memory[r, 1] - q[j]) / c + d * dq[j]
        speed = (memory[r, 4] + dt / inertia * pull) / (1.0 + dt / inertia * (d + dt / c))
        memory[r, 1] += speed * dt
        memory[r, 2], memory[r, 3], memory[r, 4] = memory[r, 1] - q[j], speed - dq[j], speed
        tau[j] = memory[r, 2] / c + d * memory[r, 3]


@kernel
def hold(first, last, joint, const, memory, tau, step, dt):
    """Law tau <- tau of the last sample; const: period. memory: started, tau."""
    for r in range(first, last):
        if memory[r, 0] == 0.0 or due(step, dt, const[r, 0]):
            memory[r, 0], memory[r, 1] = 1.0, tau[joint[r]]
        tau[joint[r]] = memory[r, 1]


@kernel
def spring(first, last, joint, const, memory, tau, q, dq, dt):
    """Law tau <- tau - k x - k3 x^3, x = q - rest; const: rest, k, k3."""
    for r in range(first, last):
        x = q[joint[r]] - const[r, 0]
        tau[joint[r]] -= (const[r, 1] + const[r, 2] * x * x) * x


@kernel
def saturation(first, last, joint, const, memory, tau, q, dq, dt):
    """Spring torque beyond `level` is reduced to a share; const: level, share, spring."""
    for r in range(first, last):
        j, level = joint[r], const[r, 0]
        had = spring_torque(q[j], 0.0, const[r, SPRING_AT:])
        over = abs(had) - level
        if over > 0.0:
            lost = (1.0 - const[r, 1]) * over
            tau[j] -= lost if had > 0.0 else -lost


@kernel
def rescaled(first, last, joint, const, memory, tau, q, dq, dt):
    """A spring's torque s becomes (1 + error) s; const: error, unused, spring."""
    for r in range(first, last):
        j = joint[r]
        tau[j] += const[r, 0] * spring_torque(q[j], 0.0, const[r, SPRING_AT:])


@kernel
def shifted(first, last, joint, const, memory, tau, q, dq, dt):
    """A spring's torque s(q) becomes s(q - offset); const: offset, unused, spring."""
    for r in range(first, last):
        j = joint[r]
        row = const[r, SPRING_AT:]
        tau[j] += spring_torque(q[j] - const[r, 0], 0.0, row) - spring_torque(q[j], 0.0, row)


@kernel
def end_stop(first, last, joint, const, memory, tau, q, dq, dt):
    """A spring and damper that only push, beyond an angle; const: angle, side, k, d."""
    for r in range(first, last):
        j, side = joint[r], const[r, 1]
        depth = side * (q[j] - const[r, 0])
        if depth > 0.0:
            push = const[r, 2] * depth + const[r, 3] * side * dq[j]
            tau[j] -= side * max(0.0, push)


@kernel
def hysteresis(first, last, joint, const, memory, tau, q, dq, dt):
    """Law stroke dz/dt = dq - |dq| z, tau <- tau - T z; const: T, stroke.

    memory: z, whether it begins with the torque that is left of tau, and the torque that is needed.
    """
    for r in range(first, last):
        j = joint[r]
        if memory[r, 1] != 0.0:
            held = (tau[j] - memory[r, 2]) / const[r, 0]
            memory[r, 0], memory[r, 1] = min(max(held, -1.0), 1.0), 0.0
        side = 1.0 if dq[j] > 0.0 else -1.0
        fade = exp(-abs(dq[j]) * dt / const[r, 1])
        memory[r, 0] = side + (memory[r, 0] - side) * fade
        tau[j] -= const[r, 0] * memory[r, 0]


@kernel
def maxwell(first, last, joint, const, memory, tau, q, dq, dt):
    """dz/dt = dq - z / T, tau <- tau - k z; const: k, exp(-dt / T), T. memory: z."""
    for r in range(first, last):
        j, keep = joint[r], const[r, 1]
        memory[r, 0] = keep * memory[r, 0] + (1.0 - keep) * const[r, 2] * dq[j]
        tau[j] -= const[r, 0] * memory[r, 0]


@kernel
def learned(first, last, joint, const, memory, tau, q, dq, dt):
    """Law `learned_kernels.learned_torque`; const[6]: exp(-dt / T). memory: started, lagged tau."""
    for r in range(first, last):
        j = joint[r]
        late = memory[r, 1] if memory[r, 0] != 0.0 else tau[j]
        memory[r, 0], memory[r, 1] = 1.0, tau[j] + const[r, 6] * (late - tau[j])
        tau[j] += learned_torque(q[j], dq[j], tau[j], late, const[r])


@kernel
def wave(first, last, joint, const, memory, tau, q, dq, dt):
    """Law tau <- tau + sine sin(count q) + cosine cos(count q); const: sine, count, cosine."""
    for r in range(first, last):
        j = joint[r]
        at = const[r, 1] * q[j]
        tau[j] += const[r, 0] * sin(at) + const[r, 2] * cos(at)


@kernel
def coupled(first, last, joint, const, memory, tau, q, dq, dt):
    """Law `hysteresis`, and damping, of the summed speeds of two joints, acting on both.

    const: T, stroke, damping, the other joint. memory: z.
    """
    for r in range(first, last):
        j, other = joint[r], int(const[r, 3])
        speed = dq[j] + dq[other]
        side = 1.0 if speed > 0.0 else -1.0
        fade = exp(-abs(speed) * dt / const[r, 1])
        memory[r, 0] = side + (memory[r, 0] - side) * fade
        drag = const[r, 0] * memory[r, 0] + const[r, 2] * speed
        tau[j] -= drag
        tau[other] -= drag


@kernel
def compensation(first, last, joint, const, memory, tau, q, dq, dt):
    """Law tau <- tau + T tanh(dq / v) + damping dq; const: T, v, damping."""
    for r in range(first, last):
        speed = dq[joint[r]]
        tau[joint[r]] += const[r, 0] * tanh(speed / const[r, 1]) + const[r, 2] * speed


@kernel
def friction(first, last, joint, const, budget, tau, dq):
    """Budget + dry + extra exp(-(dq / v)^2) + viscous |dq| + share |tau|.

    const: dry, extra, 1 / v, viscous, share, and additional dry friction in negative direction;
    the direction of a joint at rest is that of its drive torque.
    """
    for r in range(first, last):
        j = joint[r]
        ratio = dq[j] * const[r, 2]
        resistance = const[r, 0] + const[r, 3] * abs(dq[j]) + const[r, 4] * abs(tau[j])
        if const[r, 1] != 0.0:
            resistance += const[r, 1] * exp(-ratio * ratio)
        if dq[j] < -REST or (dq[j] <= REST and tau[j] < 0.0):
            resistance += const[r, 5]
        budget[j] += resistance


@kernel
def torques(of_drives, step, dt, laws, tau, q, dq):
    """Run the torque laws of a chain in sequence, in place; dispatches on the number of the law.

    Args:
        of_drives: Run the laws on the torque of the drives, else those on the joint torque,
            springs included.
        step: Physics step.
        dt: Length of a physics step [s].
        laws: `rows.Laws`; memory and delay lines are changed.
        tau: Torques [N·m], (n,).
        q: Joint positions [rad], (n,).
        dq: Joint velocities [rad/s], (n,).
    """
    plan, joint, const, memory, line = laws
    for k in range(plan.shape[0]):
        law, a, b = plan[k, 0], plan[k, 1], plan[k, 2]
        if step < plan[k, 3] or step >= plan[k, 4] or (law < OF_DRIVES) != of_drives:
            continue
        if law == GAIN:
            gain(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == DELAY:
            delay(a, b, joint, const, memory, line, tau)
        elif law == LAG:
            lag(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == LIMIT:
            limit(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SPEED_LINE:
            speed_line(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SAG:
            sag(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == BACKLASH:
            backlash(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SERIES:
            series(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == HOLD:
            hold(a, b, joint, const, memory, tau, step, dt)
        elif law == SPRING:
            spring(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SATURATION:
            saturation(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == RESCALED:
            rescaled(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == SHIFTED:
            shifted(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == END_STOP:
            end_stop(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == HYSTERESIS:
            hysteresis(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == MAXWELL:
            maxwell(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == WAVE:
            wave(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == COUPLED:
            coupled(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == COMPENSATION:
            compensation(a, b, joint, const, memory, tau, q, dq, dt)
        elif law == LEARNED:
            learned(a, b, joint, const, memory, tau, q, dq, dt)


@kernel
def motors(step, plan, joint, const, rows, duty, speed):
    """Run the motor laws of a chain in sequence, changing the parameter rows of servos in place.

    Args:
        step: Physics step.
        plan: Law, first row, row after the last, first step, step after the last, (m, 5).
        joint: Joint of each row, (r,).
        const: Constants of each row, (r, CONSTANTS).
        rows: Drives, as in `servo.ServoParams.row`, (n, COLUMNS); changed.
        duty: Duty cycle commanded by each servo, in [-1, 1], (n,).
        speed: Speed of its rotor [rad/s], (n,).
    """
    for k in range(plan.shape[0]):
        law, a, b = plan[k, 0], plan[k, 1], plan[k, 2]
        if step < plan[k, 3] or step >= plan[k, 4]:
            continue
        if law == GAIN:
            motor_gain(a, b, joint, const, rows)
        elif law == LIMIT:
            motor_limit(a, b, joint, const, rows)
        elif law == SPEED_LINE:
            motor_line(a, b, joint, const, rows, duty, speed)
        elif law == SAG:
            motor_sag(a, b, joint, const, rows, duty, speed)


@kernel
def budgets(step, plan, joint, const, budget, tau, dq):
    """Add the torques of friction laws in place; arguments as in `torques` and `motors`."""
    for k in range(plan.shape[0]):
        if plan[k, 3] <= step < plan[k, 4]:
            friction(plan[k, 1], plan[k, 2], joint, const, budget, tau, dq)


@kernel
def bend(step, plan, joint, memory, command):
    """Commands relative to motors with series springs: see `reading_laws.move_back`."""
    for k in range(plan.shape[0]):
        if plan[k, 0] == SERIES and plan[k, 3] <= step < plan[k, 4]:
            for r in range(plan[k, 1], plan[k, 2]):
                command[0, joint[r]] -= memory[r, 2]
                command[1, joint[r]] -= memory[r, 3]


@inlined
def joint_torques(step, dt, power, drives, change, weakens, state, work):
    """Torques of drives, springs and effects on the joints in a physics step.

    Args:
        step: Physics step.
        dt: Length of a physics step [s].
        power: Voltage of the drives over its nominal value, and 1, or 0 while they are off, (2,).
        drives: Drives, springs and states of drives as in `drive_torques`; the states are changed.
        change: `rows.Laws`; memory and delay lines are changed.
        weakens: Whether an effect changes the constants of servos.
        state: Positions, then velocities of the joints, (2 n,).
        work: Command, (COMMANDS, n), which springs in series change; constants of the drives and
            duty cycles of servos, changed if `weakens`; result: torques on the joints, and torques
            of the drives alone, (n,) each.
    """
    (constants, springs, rotors), (command, rows, share, tau, drive_tau) = drives, work
    plan, joint, const, memory, _ = change
    n, voltage, on = len(tau), power[0], power[1]
    bend(step, plan, joint, memory, command)
    if weakens:
        copy_rows(constants, rows)
        drive_demand(state, command, constants, rotors, voltage, on, dt, step, share)
        motors(step, plan, joint, const, rows, share[0], share[1])
    drive_torques(state, command, rows, rotors, dt, voltage, on, tau, step)
    torques(OF_DRIVE, step, dt, change, tau, state[:n], state[n:])
    for i in range(n):
        drive_tau[i] = tau[i]
    add_springs(state, springs, tau)
    torques(OF_JOINT, step, dt, change, tau, state[:n], state[n:])
