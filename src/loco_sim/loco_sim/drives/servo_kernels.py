# SPDX-License-Identifier: Apache-2.0
"""Torque of the drives of `robot.servo`, from parameter rows."""

from __future__ import annotations

import numpy as np

from ..jit import inlined, kernel
from ..robot.servo import (
    AVERAGED,
    EFFORT,
    IMPEDANCE,
    INTEGRAL_LIMIT,
    PERIOD,
    SPEED_FEED,
)

DEMAND, GAIN, LIMIT, PASSIVE = range(4)  # rows of the array `law` of `impedance_laws`
# Columns of the state of a drive: position and speed of the rotor of a servo [rad, rad/s];
# torque of the integrator [N·m]; the held output, the sum of the outputs computed since the last
# sample, and their number (0: no output is held yet).
ROTOR, SPIN, INTEGRAL, IN_FORCE, TOTAL, COUNT = range(6)
MEMORY = 6
ROUNDING = 1e-6  # tolerance of the sampling instant against rounding, share of a period


@inlined
def rounded(x: float, step: float) -> float:
    """`x` rounded to the nearest multiple of `step`; unchanged for step 0."""
    return step * np.floor(x / step + 0.5) if step > 0.0 else x


@inlined
def clipped(x: float, limit: float) -> float:
    """`x` limited to [-limit, limit]."""
    return min(max(x, -limit), limit)


@inlined
def due(step: int, dt: float, period: float) -> bool:
    """Whether a drive samples at a physics step: the first at or after each period."""
    if period <= dt:
        return True
    return np.floor(step * dt / period + ROUNDING) > np.floor((step - 1) * dt / period + ROUNDING)


@inlined
def in_force(command: float, row: np.ndarray, memory: np.ndarray, sample: bool) -> float:
    """Active torque or duty cycle: the held value between samples, else the current or mean one.

    Args:
        command: Torque or duty cycle from the control law at this step.
        row: Constants of the drive.
        memory: State of the drive, (MEMORY,).
        sample: Whether the drive samples now: `due`.
    """
    if row[PERIOD] <= 0.0:
        return command
    if memory[COUNT] > 0.0 and not sample:
        return memory[IN_FORCE]
    return memory[TOTAL] / memory[COUNT] if row[AVERAGED] > 0.0 and memory[COUNT] > 0.0 else command


@inlined
def hold(command: float, row: np.ndarray, memory: np.ndarray, sample: bool) -> float:
    """Return `in_force`, and store it for the next steps."""
    value = in_force(command, row, memory, sample)
    if sample or memory[COUNT] == 0.0:
        memory[TOTAL] = memory[COUNT] = 0.0
    memory[IN_FORCE] = value
    memory[TOTAL] += command
    memory[COUNT] += 1.0
    return value


@inlined
def errors(
    q: float, target: float, speed: float, row: np.ndarray, swinging: bool
) -> tuple[float, float, float]:
    """Position error [rad], desired velocity [rad/s] and damping [N·m·s/rad] of an impedance."""
    error = target - q
    speed_target = row[SPEED_FEED] * speed + row[7] * error
    return error, speed_target, row[4] if swinging else row[2]


@inlined
def integrate(
    tau: float, error: float, speed_error: float, row: np.ndarray, memory: np.ndarray, time: float
) -> None:
    """Advance the integrator of an impedance, with anti-windup at the torque limit.

    Args:
        tau: Torque before limiting [N·m].
        error: Position error [rad].
        speed_error: Velocity error [rad/s].
        row: `ImpedanceDrive.row`.
        memory: State of the drive, (MEMORY,); changed.
        time: Duration for which the errors apply [s].
    """
    rate = row[5] * error + row[6] * speed_error
    if abs(tau) > row[EFFORT] and rate * tau > 0.0:
        return
    memory[INTEGRAL] = clipped(memory[INTEGRAL] + time * rate, row[INTEGRAL_LIMIT])


@inlined
def impedance_torque(
    q: float,
    dq: float,
    command: np.ndarray,
    row: np.ndarray,
    memory: np.ndarray,
    time: float,
) -> float:
    """Torque of a joint impedance [N·m], within its effort limit; its integrator is advanced.

    Without integrator and position gain it is kp (target - q) + kd (speed - dq) + extra.

    Source: thesis eq. (4.8), (4.9), with the signs of the author's code.

    Args:
        q: Joint position [rad].
        dq: Joint velocity [rad/s].
        command: Desired position and velocity, feed-forward torque, and a value above 0 to select
            the gains of swing, (COMMANDS,).
        row: `ImpedanceDrive.row`.
        memory: State of the drive, (MEMORY,); its integrator is changed.
        time: Time until the next sample [s]; with 0 the integrator is not changed.
    """
    swinging = command[3] > 0.0
    error, speed, kd = errors(q, command[0], command[1], row, swinging)
    kp = row[3] if swinging else row[1]
    tau = kp * error + kd * (speed - dq) + command[2]
    if row[5] > 0.0 or row[6] > 0.0:
        tau += memory[INTEGRAL]
        integrate(tau, error, speed - dq, row, memory, time)
    return clipped(tau, row[EFFORT])


@kernel
def impedance_laws(state, command, drives, memory, dt, on, law):
    """Coefficients of the torque of each continuous impedance as a function of joint velocity v.

    It is clip(wanted - gain v, +-limit). Rows of other drives are not changed.

    Args:
        state: Joint positions, then velocities [rad, rad/s], (2 n,).
        command: Command as in `actuators.drive_torques`, (COMMANDS, n).
        drives: A row per joint, (n, COLUMNS).
        memory: State of the drives, (n, MEMORY); integrators are changed.
        dt: Physics step [s].
        on: 1, or 0 for drives that are switched off.
        law: Rows wanted [N·m], gain [N·m·s/rad], limit [N·m], and passive (not set here), (4, n).
    """
    n = len(drives)
    for i in range(n):
        row = drives[i]
        if row[0] == IMPEDANCE and row[PERIOD] <= 0.0:
            swinging, dq = command[3, i] > 0.0, state[n + i]
            kp = row[3] if swinging else row[1]
            error, speed, kd = errors(state[i], command[0, i], command[1, i], row, swinging)
            torque = kp * error + kd * speed + command[2, i]
            if row[5] > 0.0 or row[6] > 0.0:
                torque += memory[i, INTEGRAL]
                integrate(torque - kd * dq, error, speed - dq, row, memory[i], on * dt)
            law[DEMAND, i], law[GAIN, i], law[LIMIT, i] = on * torque, on * kd, row[EFFORT]


@inlined
def share(q: float, target: float, row: np.ndarray) -> float:
    """Duty cycle commanded by the position loop of a servo, in [-1, 1]."""
    return clipped(row[3] * (rounded(target, row[4]) - rounded(q, row[4])), 1.0)


@inlined
def scaled(row: np.ndarray, factor: float) -> None:
    """Scale the torque of a servo's motor, in place in its parameter row."""
    row[1] *= factor
    row[2] *= factor
    row[8] *= factor


@inlined
def motor_torque(row: np.ndarray, duty: float, speed: float) -> float:
    """Motor torque of a servo at a duty cycle and a rotor speed [N·m]."""
    return clipped(row[1] * duty - row[2] * speed, row[8])


@inlined
def servo_torque(
    q: float,
    dq: float,
    duty: float,
    row: np.ndarray,
    rotor: np.ndarray,
    dt: float,
    supply: float = 1.0,
    on: float = 1.0,
) -> float:
    """Torque of a servo on its joint [N·m] for the next physics step.

    The rotor is advanced implicitly in its speed, stable for any step.

    Args:
        q: Joint position [rad].
        dq: Joint velocity [rad/s].
        duty: Duty cycle commanded by its position loop, from `share`.
        row: `ServoParams.row`.
        rotor: Position [rad] and speed [rad/s] of the rotor, at the joint; changed in place.
        dt: Physics step [s].
        supply: Voltage / nominal voltage [-]; 0 short-circuits the motor.
        on: 1, or 0 for a motor that is disconnected.
    """
    stall, slope = row[1] * supply * on, row[2] * on
    inertia, stiff, damp, effort = row[5], row[6], row[7], row[8]
    push = stall * duty
    if inertia <= 0.0:
        return clipped(push - slope * dq, effort)
    gear = stiff * (rotor[0] - q) - damp * dq  # torque for zero rotor speed
    give = damp + stiff * dt  # derivative with respect to rotor speed
    speed = (inertia * rotor[1] + dt * (push - gear)) / (inertia + dt * (slope + give))
    if abs(push - slope * speed) > effort:
        limited_torque = clipped(push - slope * speed, effort)
        speed = (inertia * rotor[1] + dt * (limited_torque - gear)) / (inertia + dt * give)
    rotor[0] += dt * speed
    rotor[1] = speed
    return gear + give * speed
