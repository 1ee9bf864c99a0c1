# SPDX-License-Identifier: Apache-2.0
"""Compiled laws for the torques in a joint: drives, springs and hidden effects."""

from __future__ import annotations

import numpy as np
from numba import njit

from .slots import (
    ABSORBER,
    BACKLASH,
    BENT,
    BIAS,
    DEADBAND,
    DRAG,
    FADING,
    GAIN,
    HUM,
    HYSTERESIS,
    JUMP,
    LIMIT,
    LINE,
    LOOSE,
    LOOSE_V,
    MAXWELL,
    ONE_WAY,
    RIPPLE,
    RUBBER,
    RUBBER_A,
    SATURATION,
    SERVO,
    SPRING_ERROR,
    STIFFNESS,
    STOP,
    TORQUE,
    VISCOUS,
    WOUND,
    Q,
    V,
)


@njit(cache=True, error_model="numpy", forceinline=True)
def within(x, limit):
    """`x` clipped to ±`limit`."""
    return max(-limit, min(limit, x))


@njit(cache=True, error_model="numpy", forceinline=True)
def wanted(row, target, seen, speed, state, j, duration):
    """Commanded torque of an impedance or torque drive [N·m]; its integrator is advanced.

    Args:
        row: Constants of the drive.
        target: Target position, velocity and feed-forward torque, (3,).
        seen: Encoder position of the drive [rad].
        speed: Velocity of the joint [rad/s].
        state: State of the joints, (STATES, n).
        j: Index of the joint.
        duration: Time until the law is computed again [s].
    """
    if row[0] == TORQUE:
        return within(row[1] * target[2] + row[2] - row[3] * speed, row[8])
    error = target[0] - seen
    lag = row[5] * error + row[6] * target[1] - speed
    tau = row[1] * error + row[2] * lag + state[WOUND, j] + target[2]
    slope = row[3] * error + row[4] * lag
    if abs(tau) <= row[8] or slope * tau <= 0.0:  # it does not wind up
        state[WOUND, j] = within(state[WOUND, j] + duration * slope, row[7])
    return within(tau, row[8])


@njit(cache=True, error_model="numpy", forceinline=True)
def weakened(tau, speed, row, hidden, j, load, t):
    """Torque after limits, supply loss and torque constant of the drive [N·m].

    Args:
        tau: Commanded torque [N·m].
        speed: Velocity of motor or joint [rad/s].
        row: Constants of the drive.
        hidden: Constants of the hidden laws, (LAWS, n, 4).
        j: Index of the joint.
        load: Lost share of the supply voltage.
        t: Time [s].
    """
    max_torque = row[8]
    if hidden[LIMIT, j, 0] > 0.0:
        tau = within(tau, (1.0 - hidden[LIMIT, j, 0]) * max_torque)
    if hidden[LINE, j, 0] > 0.0 and tau * speed > 0.0:
        tau = within(tau, max_torque * max(0.0, 1.0 - hidden[LINE, j, 0] * abs(speed)))
    band = hidden[DEADBAND, j, 0]
    tau = 0.0 if abs(tau) <= band else tau - np.copysign(band, tau)
    tau *= max(0.0, 1.0 - load)
    error = hidden[GAIN, j, 0]
    if hidden[JUMP, j, 2] > 0.0:
        error += hidden[JUMP, j, 0] if t < hidden[JUMP, j, 2] else hidden[JUMP, j, 1]
    return tau * (1.0 + error)


@njit(cache=True, error_model="numpy", forceinline=True)
def gear(row, lead, closing, play):
    """Torque of a servo's elastic gear on its joint [N·m].

    Args:
        row: Constants of the drive.
        lead: Rotor position minus joint position [rad].
        closing: Rate of `lead` [rad/s].
        play: Total backlash of the gear [rad].
    """
    if play > 0.0:
        half_play = 0.5 * play
        if abs(lead) <= half_play:
            return 0.0
        side = 1.0 if lead > 0.0 else -1.0
        push = row[6] * (abs(lead) - half_play) + row[7] * side * closing
        return side * max(0.0, push)  # tooth flanks cannot pull
    return row[6] * lead + row[7] * closing


@njit(cache=True, error_model="numpy", forceinline=True)
def spring(row, q):
    """Torque of a spring of the robot, without its damper [N·m]."""
    if row[0] == 1.0:
        return row[1] * (row[3] - q)
    if row[0] == 2.0:
        a, b = row[4], row[5]
        length = np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(q))
        return row[1] * (row[3] - length) * (a * b * np.sin(q) / length)
    return 0.0


@njit(cache=True, error_model="numpy", forceinline=True)
def elastic(state, j, row, rest, hidden):
    """Torque of the robot's spring and of hidden effects parallel to the drive [N·m].

    Args:
        state: State of the joints, (STATES, n).
        j: Index of the joint.
        row: Constants of the joint's spring.
        rest: Rest position of the joint [rad].
        hidden: Constants of the hidden laws.
    """
    q, v = state[Q, j], state[V, j]
    tau = -row[2] * v
    if row[0] > 0.0:
        torque = (1.0 + hidden[SPRING_ERROR, j, 0]) * spring(row, q - hidden[SPRING_ERROR, j, 2])
        lost, level = hidden[SATURATION, j, 0], hidden[SATURATION, j, 1]
        if lost > 0.0 and abs(torque) > level:
            torque = np.sign(torque) * (level + (1.0 - lost) * (abs(torque) - level))
        tau += torque
    x = q - rest
    tau -= hidden[STIFFNESS, j, 0] * (x - hidden[STIFFNESS, j, 1])
    tau -= hidden[STIFFNESS, j, 2] * x**3
    tau += stop(x, v, hidden[STOP, j])
    tau -= hidden[HYSTERESIS, j, 0] * state[BENT, j]
    tau -= hidden[MAXWELL, j, 0] * state[FADING, j]
    return tau


@njit(cache=True, error_model="numpy", forceinline=True)
def stop(x, v, row):
    """Torque of a soft one-sided stop at row[0] from the rest position; it only repels [N·m]."""
    if row[1] <= 0.0:
        return 0.0
    side = 1.0 if row[0] > 0.0 else -1.0
    depth = side * x - abs(row[0])
    if depth <= 0.0:
        return 0.0
    return -side * max(0.0, row[1] * depth + row[2] * side * v)


@njit(cache=True, error_model="numpy", forceinline=True)
def strange(state, j, hidden, t):
    """Torque of laws that are not in the registry, and of viscous friction [N·m]."""
    q, v = state[Q, j], state[V, j]
    tau = -hidden[VISCOUS, j, 0] * v - hidden[DRAG, j, 0] * v * abs(v)
    tau -= hidden[ONE_WAY, j, 0] * max(0.0, v)
    if hidden[RIPPLE, j, 0] != 0.0:
        tau += hidden[RIPPLE, j, 0] * np.sin(hidden[RIPPLE, j, 1] * q + hidden[RIPPLE, j, 2])
    tau += hidden[BIAS, j, 0] + hidden[HUM, j, 0] * np.sin(
        hidden[HUM, j, 1] * t + hidden[HUM, j, 2]
    )
    if hidden[ABSORBER, j, 2] > 0.0:
        lead, closing = state[LOOSE, j] - q, state[LOOSE_V, j] - v
        tau += hidden[ABSORBER, j, 0] * lead + hidden[ABSORBER, j, 1] * closing
    if hidden[RUBBER, j, 0] != 0.0:
        strain = 0.0
        for k in range(3):
            strain += state[RUBBER_A + k, j] * (1.0, 2.0, 4.0)[k] / 7.0
        tau -= hidden[RUBBER, j, 0] * (strain + hidden[RUBBER, j, 2] * np.tanh(strain) ** 3)
    return tau


@njit(cache=True, error_model="numpy", forceinline=True)
def memories(state, rate, j, hidden):
    """Compute the rates of the internal states of hysteresis, relaxation, absorber and rubber."""
    v = state[V, j]
    if hidden[HYSTERESIS, j, 0] != 0.0:
        rate[BENT, j] = (v - abs(v) * state[BENT, j]) / hidden[HYSTERESIS, j, 1]
    if hidden[MAXWELL, j, 0] != 0.0:
        rate[FADING, j] = v - state[FADING, j] / hidden[MAXWELL, j, 1]
    if hidden[ABSORBER, j, 2] > 0.0:
        lead, closing = state[LOOSE, j] - state[Q, j], state[LOOSE_V, j] - v
        pull = hidden[ABSORBER, j, 0] * lead + hidden[ABSORBER, j, 1] * closing
        rate[LOOSE, j], rate[LOOSE_V, j] = state[LOOSE_V, j], -pull / hidden[ABSORBER, j, 2]
    if hidden[RUBBER, j, 0] != 0.0:
        for k in range(3):  # a small, a medium and a large stroke
            stroke = hidden[RUBBER, j, 1] * (0.3, 1.0, 4.0)[k]
            deflection = state[RUBBER_A + k, j]
            rate[RUBBER_A + k, j] = (v - abs(v) * deflection * abs(deflection)) / stroke


@njit(cache=True, error_model="numpy", forceinline=True)
def play_of(hidden, j, kind):
    """Backlash of a servo's gear [rad]; 0 for other drives, whose backlash is a state."""
    return hidden[BACKLASH, j, 0] if kind == SERVO else 0.0
