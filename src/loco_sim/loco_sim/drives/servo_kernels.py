# SPDX-License-Identifier: Apache-2.0
"""Torque of the drives in `robot.servo`, from the rows of their parameters."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..robot.servo import IMPEDANCE

WANTED, GAIN, LIMIT, PASSIVE = range(4)  # rows of a law: see `impedance_laws`


@njit(cache=True, error_model="numpy", forceinline=True)
def rounded(x: float, step: float) -> float:
    """To the nearest multiple of a step; 0 leaves it alone."""
    return step * np.floor(x / step + 0.5) if step > 0.0 else x


@njit(cache=True, error_model="numpy", forceinline=True)
def clipped(x: float, limit: float) -> float:
    """Within +-limit."""
    return min(max(x, -limit), limit)


@njit(cache=True, error_model="numpy", forceinline=True)
def impedance_torque(
    q: float,
    dq: float,
    target: float,
    speed: float,
    extra: float,
    row: np.ndarray,
    swinging: bool,
) -> float:
    """Torque kp (target - q) + kd (speed - dq) + extra of a joint impedance [N·m].

    It is clipped to the effort limit of the joint.

    Source: thesis eq. (4.8), (4.9), with the signs of the author's code.

    Args:
        q: Joint position [rad].
        dq: Joint velocity [rad/s].
        target: Desired joint position [rad].
        speed: Desired joint velocity [rad/s].
        extra: Feed-forward torque [N·m].
        row: `ImpedanceDrive.row`.
        swinging: The leg of the joint swings: its gains are those of swing.
    """
    kp, kd = (row[3], row[4]) if swinging else (row[1], row[2])
    return clipped(kp * (target - q) + kd * (speed - dq) + extra, row[8])


@njit(cache=True, error_model="numpy")
def impedance_laws(q, command, drives, on, law):
    """Fill in what the torque of each impedance drive depends on, for any joint velocity v.

    It is clip(wanted - gain v, +-limit). Other drives are left alone.

    Args:
        q: Joint positions [rad], (n,).
        command: Command in the rows of `actuators.joint_torques`, (COMMANDS, n).
        drives: A row per joint, (n, 9).
        on: 1, or 0 for drives that are switched off.
        law: Rows wanted [N·m], gain [N·m·s/rad], limit [N·m], and another, (4, n).
    """
    for i in range(len(drives)):
        row = drives[i]
        if row[0] == IMPEDANCE:
            kp, kd = (row[3], row[4]) if command[3, i] > 0.0 else (row[1], row[2])
            wanted = kp * (command[0, i] - q[i]) + kd * command[1, i] + command[2, i]
            law[WANTED, i], law[GAIN, i], law[LIMIT, i] = on * wanted, on * kd, row[8]


@njit(cache=True, error_model="numpy", forceinline=True)
def share(q: float, target: float, row: np.ndarray) -> float:
    """Share of the voltage that the position loop of a servo asks for, in [-1, 1]."""
    return clipped(row[3] * (rounded(target, row[4]) - rounded(q, row[4])), 1.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def scaled(row: np.ndarray, factor: float) -> None:
    """Scale all that the motor of a servo gives, in place in its row."""
    row[1] *= factor
    row[2] *= factor
    row[8] *= factor


@njit(cache=True, error_model="numpy", forceinline=True)
def given(row: np.ndarray, asked: float, speed: float) -> float:
    """Torque that the motor of a servo gives at a share of its voltage and a speed [N·m]."""
    return clipped(row[1] * asked - row[2] * speed, row[8])


@njit(cache=True, error_model="numpy", forceinline=True)
def servo_torque(
    q: float,
    dq: float,
    target: float,
    row: np.ndarray,
    rotor: np.ndarray,
    dt: float,
    supply: float = 1.0,
    on: float = 1.0,
) -> float:
    """Torque of a servo on its joint [N·m] for the next physics step.

    The rotor is advanced with it, implicitly in its speed: stable at any step.

    Args:
        q: Joint position [rad].
        dq: Joint velocity [rad/s].
        target: Desired joint position [rad].
        row: `ServoParams.row`.
        rotor: Position [rad] and speed [rad/s] of the rotor, at the joint; changed in place.
        dt: Physics step [s].
        supply: Voltage over the nominal one; 0 short-circuits the motor.
        on: 1, or 0 for a motor that is disconnected.
    """
    stall, slope = row[1] * supply * on, row[2] * on
    inertia, stiff, damp, effort = row[5], row[6], row[7], row[8]
    push = stall * share(q, target, row)
    if inertia <= 0.0:
        return clipped(push - slope * dq, effort)
    gear = stiff * (rotor[0] - q) - damp * dq  # torque of a rotor that stops now
    give = damp + stiff * dt  # and what its speed adds
    speed = (inertia * rotor[1] + dt * (push - gear)) / (inertia + dt * (slope + give))
    if abs(push - slope * speed) > effort:
        most = clipped(push - slope * speed, effort)
        speed = (inertia * rotor[1] + dt * (most - gear)) / (inertia + dt * give)
    rotor[0] += dt * speed
    rotor[1] = speed
    return gear + give * speed
