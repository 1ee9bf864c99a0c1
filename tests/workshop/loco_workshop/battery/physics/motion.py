# SPDX-License-Identifier: Apache-2.0
"""Simulation of a machine: rigid bodies by an engine; compiled drives, springs, hidden laws.

Numba caches the compiled code of this file until the file changes. After a change of `laws` or
of the numbers in `slots`, increase `LAWS_OF` here; otherwise runs use the old laws.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from . import laws
from .engine import Engine, apply_force, take_step
from .slots import (
    ACTUATION_DELAY,
    BACKLASH,
    BENT,
    COMMAND_DELAY,
    COULOMB,
    DRIFT,
    FADING,
    FREE,
    LAG,
    LAGGED,
    LOAD,
    LOOSE,
    LOOSE_V,
    MOTOR,
    MOTOR_V,
    OFFSET,
    ROTOR,
    ROTOR_V,
    RUBBER_A,
    RUBBER_C,
    SAG,
    SERIES,
    SERVO,
    SPOT,
    STATES,
    STRIBECK,
    Q,
    V,
)

LAWS_OF = 5  # version of `laws` and `slots`, see above
LINE = 4096  # longest torque delay [steps]
EARLY = 1e-6  # tolerance of an instant of sampling against rounding, share of a period


class Packed(NamedTuple):
    """Constants of a machine of n joints."""

    drives: np.ndarray  # (n, slots.DRIVE)
    springs: np.ndarray  # (n, slots.SPRING)
    rest: np.ndarray  # reference positions of hidden springs and stops [rad], (n,)
    damping: np.ndarray  # viscous damping of the joints [N·m·s/rad], (n,)


class Memory(NamedTuple):
    """State of a machine except its rigid bodies."""

    state: np.ndarray  # (STATES, n)
    rate: np.ndarray  # time derivatives of the states over the last step, (STATES, n)
    target: np.ndarray  # position, velocity, feed-forward, (3, n)
    asked: np.ndarray  # torque by the law of a drive, of the last sample if it samples [N·m], (n,)
    held: np.ndarray  # as `asked`, but late if torques are delayed [N·m], (n,)
    through: np.ndarray  # 1 if the motor touches a flank of its backlash, else 0, (n,)
    drive: np.ndarray  # torque of drives and springs on the joints [N·m], (n,)
    line: np.ndarray  # ring buffer of delayed torques [N·m], (LINE, n)
    gap: np.ndarray  # position, speed and initialised flag of a motor in its backlash, (3, n)


class Port(NamedTuple):
    """Arrays of the engine; see `Engine`."""

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    friction: np.ndarray


class Body(NamedTuple):
    """Index of the body on which a push or cable acts, with `places` and `turns` of `Engine`."""

    number: int
    places: np.ndarray
    turns: np.ndarray


def simulate(
    engine: Engine,
    packed: Packed,
    command: np.ndarray,
    hidden: np.ndarray,
    outside: np.ndarray,
    start: np.ndarray,
    times: tuple[int, int, float, int],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Simulated positions and torques of a machine that follows commands.

    Args:
        engine: Bodies of the machine.
        packed: Constants of the machine.
        command: Position, velocity, feed-forward at each tick, (ticks, 3, n).
        hidden: Constants of the hidden laws, (LAWS, n, 4).
        outside: Body or -1, kind (0 push, 1 cable), point (3), force or anchor (3),
            start time or stiffness, stop time or length, (10,).
        start: Joint positions [rad], (n,).
        times: Ticks for which the first command is held before the record begins, steps per
            tick, step [s], steps between two rows of the result.

    Returns:
        Readings of the encoders and true velocities at every row, (rows, n) each, and the mean
        torque over the period before each tick, (ticks, n).
    """
    settle, steps, dt, every = times
    n, ticks = len(start), len(command)
    total = ticks * steps
    positions, speed = np.zeros((total // every + 1, n)), np.zeros((total // every + 1, n))
    torque, summed = np.zeros((ticks, n)), np.zeros(n)
    memory = _memory(n, start)
    engine.q[:] = start
    port = Port(engine.q, engine.v, engine.a, engine.tau, engine.friction)
    link = max(0, int(outside[0]))
    body = Body(engine.bodies[link], engine.places, engine.turns)
    _run(packed, command, hidden, outside, (*times, total), memory, port, body, engine.pointers,
         positions, speed, torque, summed)  # fmt: skip
    torque[0] = torque[1] if ticks > 1 else memory.drive
    return positions, speed, torque


@njit(cache=True, error_model="numpy")
def _run(
    packed, command, hidden, outside, times, memory, port, body, engine, seen, speed, torque, summed
):
    """Time loop of `simulate`, which calls the engine's steps."""
    settle, steps, dt, every, total = times
    late = hidden[COMMAND_DELAY, 0, 0]
    for step in range(-settle * steps, total + 1):
        if step % steps == 0:
            for j in range(len(summed)):
                if 0 < step < total:
                    torque[step // steps, j] = summed[j] / steps
                summed[j] = 0.0
        if step >= 0 and step % every == 0:
            encode(seen[step // every], speed[step // every], memory.state, port, hidden, dt)
        t = (step + 0.5) * dt  # time of the positions; commands change at whole steps
        tick = min(max(0, int((t - late) // (steps * dt))), len(command) - 1)
        torques(packed, hidden, memory, port, command[tick], step, dt)
        if outside[0] >= 0.0:
            _outside(engine, body, port.tau, outside, t)
        for j in range(len(summed)):
            summed[j] += memory.drive[j]
        take_step(engine[0], engine[1])


def _memory(n: int, start: np.ndarray) -> Memory:
    state = np.zeros((STATES, n))
    state[[Q, ROTOR, MOTOR, LOOSE]] = start
    return Memory(
        state, np.zeros((STATES, n)), np.zeros((3, n)), np.zeros(n), np.zeros(n), np.ones(n),
        np.zeros(n), np.zeros((LINE, n)), np.zeros((3, n)),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def _outside(engine, body, tau, outside, t):
    """Add the torques of a push or a cable."""
    at, force = outside[2:5], outside[5:8].copy()  # a force, or an anchor
    point = body.places[body.number].copy()
    for j in range(3):
        for k in range(3):
            point[j] += body.turns[body.number, 3 * j + k] * at[k]
    if outside[1] == 0.0:
        if not outside[8] <= t < outside[9]:
            return
    else:
        force -= point
        length = np.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
        if length <= outside[9]:
            return
        force *= outside[8] * (length - outside[9]) / length
    none = np.zeros(3)
    apply_force(
        engine[0], engine[1], force.ctypes.data, none.ctypes.data, point.ctypes.data, body.number,
        tau.ctypes.data,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def encode(q, v, state, port, hidden, dt):
    """Compute encoder readings at whole steps; with series elasticity those of the motor."""
    for j in range(len(q)):
        soft = hidden[SERIES, j, 0] > 0.0
        v[j] = state[MOTOR_V, j] if soft else port.v[j]
        q[j] = (state[MOTOR, j] if soft else port.q[j]) - 0.5 * dt * v[j]


@njit(cache=True, error_model="numpy")
def torques(packed, hidden, memory, port, command, step, dt):
    """Compute torques and dry friction of the joints for the next step, written to `port`.

    Args:
        packed: Constants of the machine.
        hidden: Constants of the hidden laws, (LAWS, n, 4).
        memory: State, updated in place.
        port: Arrays of the engine.
        command: Commanded position, velocity and feed-forward torque, (3, n).
        step: Index of the step, 0 at the start of the record.
        dt: Step [s].
    """
    state, rate, target, drives = memory.state, memory.rate, memory.target, packed.drives
    n, t = state.shape[1], (step + 0.5) * dt
    for j in range(n):
        _remember(state, rate, port, hidden, j, dt)
        state[Q, j] = port.q[j]
        state[V, j] = port.v[j] + 0.5 * dt * port.a[j]
        for k in (ROTOR_V, MOTOR_V):
            state[k, j] += 0.5 * dt * rate[k, j]  # at the time of positions
        for k in range(3):
            target[k, j] = command[k, j]
        target[0, j] += hidden[OFFSET, j, 0]
        if drives[j, 0] != FREE:
            _ask(memory, drives[j], j, hidden[SERIES, j, 0] > 0.0, port.a[j], step, dt)
    _hold_late(packed, hidden, memory, step, dt)
    for j in range(n):
        memory.through[j] = 1.0
        if hidden[BACKLASH, j, 0] > 0.0 and drives[j, 0] != SERVO and drives[j, 0] != FREE:
            want = _asked(state, j, packed, hidden, memory.held, 0.0, t)
            memory.through[j] = _in_play(memory.gap, j, want, state[V, j], hidden[BACKLASH, j], dt)
    load = _load(state, packed, hidden, memory.held, t)
    for j in range(n):
        before = rate[ROTOR_V, j], rate[MOTOR_V, j]
        driving = _drive(j, packed, hidden, memory, load, t, dt)
        memory.drive[j] = driving
        tau = driving + laws.elastic(state, j, packed.springs[j], packed.rest[j], hidden)
        tau += laws.strange(state, j, hidden, t) - packed.damping[j] * state[V, j]
        port.tau[j] = tau
        port.friction[j] = _budget(state[Q, j], state[V, j], driving, hidden, j, t)
        state[ROTOR_V, j] += dt * (rate[ROTOR_V, j] - 0.5 * before[0])  # half a step later
        state[MOTOR_V, j] += dt * (rate[MOTOR_V, j] - 0.5 * before[1])
        state[ROTOR, j] += dt * state[ROTOR_V, j]
        state[MOTOR, j] += dt * state[MOTOR_V, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _remember(state, rate, port, hidden, j, dt):
    """Integrate the internal states of the hidden laws to the time of positions (midpoint)."""
    before = state[BENT, j], state[FADING, j], state[LOOSE, j], state[LOOSE_V, j]
    wound = state[RUBBER_A, j], state[RUBBER_A + 1, j], state[RUBBER_C, j]
    state[V, j] = port.v[j]
    state[Q, j] = port.q[j] - dt * port.v[j]
    for part in (0.5, 1.0):
        laws.memories(state, rate, j, hidden)
        state[Q, j] = port.q[j] - 0.5 * dt * port.v[j]
        state[BENT, j] = before[0] + part * dt * rate[BENT, j]
        state[FADING, j] = before[1] + part * dt * rate[FADING, j]
        state[LOOSE, j] = before[2] + part * dt * rate[LOOSE, j]
        state[LOOSE_V, j] = before[3] + part * dt * rate[LOOSE_V, j]
        for k in range(3):
            state[RUBBER_A + k, j] = wound[k] + part * dt * rate[RUBBER_A + k, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _budget(q, v, drive, hidden, j, t):
    """Dry friction of a joint [N·m]."""
    budget = hidden[COULOMB, j, 0] + hidden[LOAD, j, 0] * abs(drive)
    if hidden[STRIBECK, j, 0] > 0.0:
        budget += hidden[STRIBECK, j, 0] * np.exp(-((v / hidden[STRIBECK, j, 1]) ** 2))
    if hidden[DRIFT, j, 0] > 0.0:
        budget += hidden[DRIFT, j, 0] * np.exp(-max(0.0, t) / hidden[DRIFT, j, 1])
    if hidden[SPOT, j, 0] > 0.0:
        away = (q - hidden[SPOT, j, 1]) / hidden[SPOT, j, 2]
        budget += hidden[SPOT, j, 0] * np.exp(-away * away)
    return budget


@njit(cache=True, error_model="numpy", forceinline=True)
def _rounded(x, step):
    return step * np.floor(x / step + 0.5) if step > 0.0 else x


@njit(cache=True, error_model="numpy", forceinline=True)
def _ask(memory, row, j, soft, acceleration, step, dt):
    """Torque that a drive asks for; a sampled drive computes it once per period, at whole steps."""
    state, target = memory.state, memory.target
    position = state[MOTOR, j] if soft else state[Q, j]
    speed = state[MOTOR_V, j] if soft else state[V, j]
    duration = dt
    if row[9] > 0.0:
        if np.floor(step * dt / row[9] + EARLY) <= np.floor((step - 1) * dt / row[9] + EARLY):
            return
        duration = row[9]
        position -= 0.5 * dt * speed
        speed -= 0.5 * dt * (memory.rate[MOTOR_V, j] if soft else acceleration)
    if row[0] == SERVO:
        error = _rounded(target[0, j], row[4]) - _rounded(position, row[4])
        memory.asked[j] = row[1] * laws.within(row[3] * error, 1.0)
    else:
        memory.asked[j] = laws.wanted(row, target[:, j], position, speed, state, j, duration)


@njit(cache=True, error_model="numpy", forceinline=True)
def _hold_late(packed, hidden, memory, step, dt):
    """Delayed torques: append the current one to the buffer, read the one that acts now."""
    drives, line = packed.drives, memory.line
    for j in range(len(drives)):
        memory.held[j] = memory.asked[j]
        delay = hidden[ACTUATION_DELAY, j, 0]
        if delay <= 0.0 or drives[j, 0] == SERVO or drives[j, 0] == FREE:
            continue
        line[step % LINE, j] = memory.asked[j]
        delay_steps = int(delay / dt)
        part = delay / dt - delay_steps
        due, before = line[(step - delay_steps) % LINE, j], line[(step - delay_steps - 1) % LINE, j]
        memory.held[j] = (1.0 - part) * due + part * before


@njit(cache=True, error_model="numpy", forceinline=True)
def _in_play(gap, j, want, v, row, dt):
    """1 if the motor touches a flank of its backlash, 0 if it moves freely in it."""
    half_play = 0.5 * row[0]
    if gap[2, j] == 0.0:
        gap[2, j], gap[1, j] = 1.0, v
        gap[0, j] = half_play if want > 0.0 else -half_play
    pushes = (gap[0, j] >= half_play and want > 0.0) or (gap[0, j] <= -half_play and want < 0.0)
    if pushes:
        gap[1, j] = v
        return 1.0
    gap[0, j] += dt * (gap[1, j] - v) + 0.5 * dt * dt * want / row[1]
    gap[1, j] += dt * want / row[1]
    if abs(gap[0, j]) >= half_play:
        gap[0, j] = half_play if gap[0, j] > 0.0 else -half_play
        gap[1, j] = v
    return 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def _asked(state, j, machine, hidden, held, load, t):
    """Torque of a drive other than a servo with a rotor [N·m]."""
    row = machine.drives[j]
    speed = state[MOTOR_V, j] if hidden[SERIES, j, 0] > 0.0 else state[V, j]
    tau = held[j]
    if row[0] == SERVO:
        tau = laws.within(tau - row[2] * speed, row[8])
    return laws.weakened(tau, speed, row, hidden, j, load, t)


@njit(cache=True, error_model="numpy", forceinline=True)
def _load(state, machine, hidden, held, t):
    """Lost share of the supply voltage due to the load of all drives."""
    sag = hidden[SAG, 0, 0]
    if sag == 0.0:
        return 0.0
    drives, total, count = machine.drives, 0.0, 0
    for j in range(state.shape[1]):
        if drives[j, 0] == FREE:
            continue
        if drives[j, 0] == SERVO and drives[j, 5] > 0.0:
            tau = laws.within(held[j] - drives[j, 2] * state[ROTOR_V, j], drives[j, 8])
        else:
            tau = _asked(state, j, machine, hidden, held, 0.0, t)
        total += abs(tau) / drives[j, 8]
        count += 1
    return sag * total / max(1, count)


@njit(cache=True, error_model="numpy", forceinline=True)
def _drive(j, machine, hidden, memory, load, t, dt):
    """Torque of a drive on its joint [N·m]; also computes the rates of rotor, motor and lag."""
    row, held = machine.drives[j], memory.held
    state, rate = memory.state, memory.rate
    if row[0] == FREE:
        return 0.0
    soft = hidden[SERIES, j, 0] > 0.0
    position = state[MOTOR, j] if soft else state[Q, j]
    speed = state[MOTOR_V, j] if soft else state[V, j]
    if row[0] == SERVO and row[5] > 0.0:
        motor = laws.within(held[j] - row[2] * state[ROTOR_V, j], row[8])
        motor = laws.weakened(motor, state[ROTOR_V, j], row, hidden, j, load, t)
        play = laws.play_of(hidden, j, row[0])
        tau = laws.gear(row, state[ROTOR, j] - position, state[ROTOR_V, j] - speed, play)
        rate[ROTOR, j], rate[ROTOR_V, j] = state[ROTOR_V, j], (motor - tau) / row[5]
    else:
        tau = _asked(state, j, machine, hidden, held, load, t)
        if hidden[LAG, j, 0] > 0.0:
            share = 0.5 * dt / hidden[LAG, j, 0]  # trapezoidal; `rate` is the previous torque
            both = share * (tau + rate[LAGGED, j]) + (1.0 - share) * state[LAGGED, j]
            rate[LAGGED, j], state[LAGGED, j] = tau, both / (1.0 + share)
            tau = state[LAGGED, j]
        tau *= memory.through[j]
    if soft:
        twist = (state[MOTOR, j] - state[Q, j]) / hidden[SERIES, j, 0]
        twist += hidden[SERIES, j, 2] * (state[MOTOR_V, j] - state[V, j])
        rate[MOTOR, j] = state[MOTOR_V, j]
        rate[MOTOR_V, j] = (tau - twist) / hidden[SERIES, j, 1]
        tau = twist
    return tau
