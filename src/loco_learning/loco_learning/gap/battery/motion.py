# SPDX-License-Identifier: Apache-2.0
"""How a machine moves: Runge-Kutta of order 4 for all that is smooth, then impulses.

Dry friction and hard stops are impulses at the end of a step, found joint after joint until
they agree (projected Gauss-Seidel): a joint at rest stays at rest, to the last bit.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from . import bodies, laws
from .slots import (
    ACTUATION_DELAY,
    BACKLASH,
    COMMAND_DELAY,
    COULOMB,
    DRIFT,
    FREE,
    LAG,
    LAGGED,
    LOAD,
    LOOSE,
    MOTOR,
    MOTOR_V,
    OFFSET,
    ROTOR,
    ROTOR_V,
    SAG,
    SERIES,
    SERVO,
    STATES,
    STRIBECK,
    Q,
    V,
)

SWEEPS = 30  # of the impulses
LINE = 4096  # steps that a delayed torque may be old


@njit(cache=True, error_model="numpy")
def simulate(machine, command, hidden, outside, start, settle, steps, dt, every):
    """Positions and torques of a machine that follows commands.

    Args:
        machine: `plant.Packed`.
        command: Position, velocity, feed-forward at each tick, (ticks, 3, n).
        hidden: Constants of the hidden laws, (LAWS, n, 4).
        outside: Body or -1, kind (0 push, 1 cable), point (3), force or anchor (3),
            start or stiffness, stop or length, (10,).
        start: Joint positions [rad], (n,).
        settle: Ticks for which the first command is held before the record begins.
        steps: Steps per tick.
        dt: Step [s].
        every: Steps between two rows of the answer.

    Returns:
        What the encoders see and true velocities at every row, (rows, n) each, and the mean
        torque over the period before each tick, (ticks, n).
    """
    n, ticks = len(start), len(command)
    total = ticks * steps
    seen = np.zeros((total // every + 1, n))
    speed = np.zeros((total // every + 1, n))
    torque = np.zeros((ticks, n))
    state = np.zeros((STATES, n))
    for j in range(n):
        for k in (Q, ROTOR, MOTOR, LOOSE):
            state[k, j] = start[j]
    work = _room(n)
    summed = np.zeros(n)
    line, gap = np.zeros((LINE, n)), np.zeros((3, n))
    late = hidden[COMMAND_DELAY, 0, 0]
    for step in range(-settle * steps, total):
        t = step * dt
        if step % steps == 0 and step > 0:
            torque[step // steps] = summed / steps
        if step % steps == 0:
            summed[:] = 0.0
        if step >= 0 and step % every == 0:
            _encode(seen[step // every], speed[step // every], state, hidden)
        tick = max(0, int(np.floor((t - late) / (steps * dt) + 1e-6)))
        tick = min(tick, ticks - 1)
        _advance(state, command[tick], machine, hidden, outside, work, line, gap, step, t, dt)
        for j in range(n):
            summed[j] += work[3][j]
    _encode(seen[total // every], speed[total // every], state, hidden)
    torque[0] = torque[1] if ticks > 1 else work[3]
    return seen, speed, torque


@njit(cache=True, error_model="numpy", forceinline=True)
def _room(n):
    """Room: targets, push of servos, what passes, torque, state before, drive, 3 of rates.

    Then what is on a joint, what holds it up, and impulses to either side.
    """
    states = np.zeros((STATES, n)), np.zeros((STATES, n)), np.zeros((STATES, n))
    more = np.zeros(n), np.zeros(n), np.zeros((2, n))
    return (np.zeros((3, n)), np.zeros(n), np.ones(n), np.zeros(n), np.zeros((2, n)), np.zeros(n),
            *states, *more)  # fmt: skip


@njit(cache=True, error_model="numpy", forceinline=True)
def _encode(q, v, state, hidden):
    """What the encoders see: the motor when a spring is behind it."""
    for j in range(len(q)):
        soft = hidden[SERIES, j, 0] > 0.0
        q[j] = state[MOTOR, j] if soft else state[Q, j]
        v[j] = state[MOTOR_V, j] if soft else state[V, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _advance(state, command, machine, hidden, outside, work, line, gap, step, t, dt):
    """One step, in place."""
    target, held, through, both, before, drive, rate, tried, slope, tau, up, impulse = work
    drives, n = machine.drives, state.shape[1]
    for j in range(n):
        for k in range(3):
            target[k, j] = command[k, j]
        target[0, j] += hidden[OFFSET, j, 0]
        soft = hidden[SERIES, j, 0] > 0.0
        seen = state[MOTOR, j] if soft else state[Q, j]
        if drives[j, 0] == SERVO:
            error = _rounded(target[0, j], drives[j, 4]) - _rounded(seen, drives[j, 4])
            held[j] = drives[j, 1] * laws.within(drives[j, 3] * error, 1.0)
    _hold_late(state, target, machine, hidden, held, line, step, t, dt)
    for j in range(n):
        through[j] = 1.0
        if hidden[BACKLASH, j, 0] > 0.0 and drives[j, 0] != SERVO and drives[j, 0] != FREE:
            want = _asked(state, j, target, machine, hidden, held, 0.0, t)
            through[j] = _in_play(gap, j, want, state[V, j], hidden[BACKLASH, j], dt)
    load = _load(state, target, machine, hidden, held, t)
    for j in range(n):
        before[0, j], before[1, j] = state[Q, j], state[V, j]
    for stage in range(4):
        part = (0.0, 0.5, 0.5, 1.0)[stage] * dt
        for k in range(STATES):
            for j in range(n):
                tried[k, j] = state[k, j] + part * rate[k, j]
        _rate(tried, target, machine, hidden, outside, held, through, load, t + part, rate, drive,
              tau, up)  # fmt: skip
        weight = (1.0, 2.0, 2.0, 1.0)[stage]
        for k in range(STATES):
            for j in range(n):
                slope[k, j] = rate[k, j] * weight + (slope[k, j] if stage else 0.0)
        if stage == 0:
            for j in range(n):
                both[j] = drive[j]
    for k in range(STATES):
        for j in range(n):
            state[k, j] += dt / 6.0 * slope[k, j]
    _stop(state, before, machine, hidden, both, impulse, t, dt)


@njit(cache=True, error_model="numpy", forceinline=True)
def _rounded(x, step):
    return step * np.floor(x / step + 0.5) if step > 0.0 else x


@njit(cache=True, error_model="numpy", forceinline=True)
def _hold_late(state, target, machine, hidden, held, line, step, t, dt):
    """Torques that act late: put the one of now in line, take the one that is due."""
    drives = machine.drives
    for j in range(state.shape[1]):
        delay = hidden[ACTUATION_DELAY, j, 0]
        if delay <= 0.0 or drives[j, 0] == SERVO or drives[j, 0] == FREE:
            continue
        soft = hidden[SERIES, j, 0] > 0.0
        seen = state[MOTOR, j] if soft else state[Q, j]
        speed = state[MOTOR_V, j] if soft else state[V, j]
        line[step % LINE, j] = laws.wanted(drives[j], target[:, j], seen, speed)
        delay = max(0.0, delay - 0.5 * dt)  # held for a step, a torque is half a step late
        whole = int(delay / dt)
        part = delay / dt - whole
        due, before = line[(step - whole) % LINE, j], line[(step - whole - 1) % LINE, j]
        held[j] = (1.0 - part) * due + part * before


@njit(cache=True, error_model="numpy", forceinline=True)
def _in_play(gap, j, want, v, row, dt):
    """1 when the motor leans on a flank of its play, else 0 and it moves freely."""
    half = 0.5 * row[0]
    if gap[2, j] == 0.0:
        gap[2, j], gap[1, j] = 1.0, v
        gap[0, j] = half if want > 0.0 else -half
    pushes = (gap[0, j] >= half and want > 0.0) or (gap[0, j] <= -half and want < 0.0)
    if pushes:
        gap[1, j] = v
        return 1.0
    gap[0, j] += dt * (gap[1, j] - v) + 0.5 * dt * dt * want / row[1]
    gap[1, j] += dt * want / row[1]
    if abs(gap[0, j]) >= half:
        gap[0, j] = half if gap[0, j] > 0.0 else -half
        gap[1, j] = v
    return 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _asked(state, j, target, machine, hidden, held, load, t):
    """Torque of a drive that is no servo [N·m]."""
    drives = machine.drives
    soft = hidden[SERIES, j, 0] > 0.0
    seen = state[MOTOR, j] if soft else state[Q, j]
    speed = state[MOTOR_V, j] if soft else state[V, j]
    if hidden[ACTUATION_DELAY, j, 0] > 0.0:
        tau = held[j]
    else:
        tau = laws.wanted(drives[j], target[:, j], seen, speed)
    return laws.weakened(tau, speed, drives[j], hidden, j, load, t)


@njit(cache=True, error_model="numpy", forceinline=True)
def _load(state, target, machine, hidden, held, t):
    """Share of the supply that is lost to the load of all drives."""
    sag = hidden[SAG, 0, 0]
    if sag == 0.0:
        return 0.0
    drives, total, count = machine.drives, 0.0, 0
    for j in range(state.shape[1]):
        if drives[j, 0] == FREE:
            continue
        if drives[j, 0] == SERVO:
            tau = laws.within(held[j] - drives[j, 2] * state[ROTOR_V, j], drives[j, 8])
        else:
            tau = _asked(state, j, target, machine, hidden, held, 0.0, t)
        total += abs(tau) / drives[j, 8]
        count += 1
    return sag * total / max(1, count)


@njit(cache=True, error_model="numpy", forceinline=True)
def _rate(state, target, machine, hidden, outside, held, through, load, t, rate, drive, tau, up):
    """Fill in rates of all states, and torque of drives and springs on the joints."""
    body, springs, rest = machine.body, machine.springs, machine.rest
    n = state.shape[1]
    for k in range(STATES):
        for j in range(n):
            rate[k, j] = 0.0
    for j in range(n):
        through_gear = _drive(state, rate, j, target, machine, hidden, held, through, load, t)
        through_gear += laws.elastic(state, j, springs[j], rest[j], hidden)
        drive[j] = through_gear
        tau[j] = (
            through_gear
            - body.rows[j, bodies.DAMPING] * state[V, j]
            + laws.strange(state, j, hidden)
        )
        laws.memories(state, rate, j, hidden)
        rate[Q, j] = state[V, j]
    bodies.poses(state[Q], body)
    if outside[0] >= 0.0:
        _outside(tau, outside, body, t)
    bodies.mass_matrix(body)
    bodies.bias(state[V], body, machine.gravity, up)
    for j in range(n):
        rate[V, j] = tau[j] - up[j]
    bodies.factored(body.mass, body.low)
    bodies.solved(body.low, rate[V])


@njit(cache=True, error_model="numpy", forceinline=True)
def _drive(state, rate, j, target, machine, hidden, held, through, load, t):
    """Torque of a drive on its joint; rates of rotor, motor and lag [N·m]."""
    row = machine.drives[j]
    if row[0] == FREE:
        return 0.0
    soft = hidden[SERIES, j, 0] > 0.0
    seen = state[MOTOR, j] if soft else state[Q, j]
    speed = state[MOTOR_V, j] if soft else state[V, j]
    if row[0] == SERVO:
        motor = laws.within(held[j] - row[2] * state[ROTOR_V, j], row[8])
        motor = laws.weakened(motor, state[ROTOR_V, j], row, hidden, j, load, t)
        play = laws.play_of(hidden, j, row[0])
        tau = laws.gear(row, state[ROTOR, j] - seen, state[ROTOR_V, j] - speed, play)
        rate[ROTOR, j], rate[ROTOR_V, j] = state[ROTOR_V, j], (motor - tau) / row[5]
    else:
        tau = _asked(state, j, target, machine, hidden, held, load, t)
        if hidden[LAG, j, 0] > 0.0:
            rate[LAGGED, j] = (tau - state[LAGGED, j]) / hidden[LAG, j, 0]
            tau = state[LAGGED, j]
        tau *= through[j]
    if soft:
        twist = (state[MOTOR, j] - state[Q, j]) / hidden[SERIES, j, 0]
        twist += hidden[SERIES, j, 2] * (state[MOTOR_V, j] - state[V, j])
        rate[MOTOR, j] = state[MOTOR_V, j]
        rate[MOTOR_V, j] = (tau - twist) / hidden[SERIES, j, 1]
        tau = twist
    return tau


@njit(cache=True, error_model="numpy", forceinline=True)
def _outside(tau, outside, body, t):
    """Add the torques of a push or a cable."""
    i, links = int(outside[0]), body.links
    point = bodies.turned(bodies.nine(links, i, bodies.ROT), (outside[2], outside[3], outside[4]))
    point = bodies.plus(point, bodies.three(links, i, bodies.AT))
    other = (outside[5], outside[6], outside[7])  # a force, or an anchor
    if outside[1] == 0.0:
        if outside[8] <= t < outside[9]:
            bodies.pulled(tau, i, point, other, body)
        return
    pull = bodies.minus(other, point)
    length = np.sqrt(bodies.dot(pull, pull))
    if length > outside[9]:
        pull = bodies.times(outside[8] * (length - outside[9]) / length, pull)
        bodies.pulled(tau, i, point, pull, body)


@njit(cache=True, error_model="numpy", forceinline=True)
def _stop(state, before, machine, hidden, drive, impulse, t, dt):
    """Impulses of dry friction and hard stops at the end of a step, in place."""
    body, n, count = machine.body, state.shape[1], 0
    for j in range(n):
        v = 0.5 * (before[1, j] + state[V, j])
        budget = hidden[COULOMB, j, 0] + hidden[LOAD, j, 0] * abs(drive[j])
        if hidden[STRIBECK, j, 0] > 0.0:
            budget += hidden[STRIBECK, j, 0] * np.exp(-((v / hidden[STRIBECK, j, 1]) ** 2))
        if hidden[DRIFT, j, 0] > 0.0:
            budget += hidden[DRIFT, j, 0] * np.exp(-max(0.0, t) / hidden[DRIFT, j, 1])
        impulse[0, j] = budget * dt
        impulse[1, j] = -budget * dt
        count += _acts(state, impulse, body.rows, j)
    if count == 0:
        return
    v, slid = _impulses(state, impulse, body, count)
    for j in range(n):
        state[Q, j] += 0.5 * dt * (v[j] - state[V, j])
        state[V, j] = v[j]
        if impulse[1, j] < 0.0 and not slid[j]:  # it sticks, to the last bit
            state[V, j] = 0.0
            if before[1, j] == 0.0:
                state[Q, j] = before[0, j]
        low, high = body.rows[j, bodies.LOWER], body.rows[j, bodies.UPPER]
        state[Q, j] = max(low, min(high, state[Q, j]))  # a stop is where it is


@njit(cache=True, error_model="numpy", forceinline=True)
def _acts(state, impulse, rows, j):
    """Whether friction or a stop acts on a joint."""
    at = state[Q, j]
    return impulse[1, j] < 0.0 or at <= rows[j, bodies.LOWER] or at >= rows[j, bodies.UPPER]


@njit(cache=True, error_model="numpy")
def _impulses(state, impulse, body, count):
    """Velocities after the impulses, (n,), and which joints slide, (n,)."""
    n, rows = state.shape[1], body.rows
    acting, inverse, a = np.zeros(count, np.int64), np.zeros((count, n)), 0
    for j in range(n):
        if _acts(state, impulse, rows, j):
            acting[a], inverse[a, j] = j, 1.0
            bodies.solved(body.low, inverse[a])
            a += 1
    v, slid = state[V].copy(), np.ones(n, np.bool_)
    p, s = np.zeros(count), np.zeros(count)
    for _ in range(SWEEPS):
        change = 0.0
        for a in range(count):
            j = acting[a]
            own = inverse[a, j]
            free = p[a] - v[j] / own
            new = max(impulse[1, j], min(impulse[0, j], free))
            slid[j] = new != free
            step = new - p[a]
            p[a] = new
            push = s[a] - (v[j] + step * own) / own
            if state[Q, j] <= rows[j, bodies.LOWER]:
                push = max(0.0, push)
            elif state[Q, j] >= rows[j, bodies.UPPER]:
                push = min(0.0, push)
            else:
                push = 0.0
            step += push - s[a]
            s[a] = push
            for k in range(n):
                v[k] += inverse[a, k] * step
            change = max(change, abs(step) * own)
        if change < 1e-13:
            break
    return v, slid
