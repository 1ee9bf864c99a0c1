# SPDX-License-Identifier: Apache-2.0
"""What the robot's sensors and the ground truth say about the state of the world."""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from math import isfinite

import numpy as np

from loco_control.exceptions import DivergedError
from loco_control.types import GroundTruth, RobotState

from .geometry import Rotation, Triple, roll_pitch, rotate_back, rotation_matrix
from .robot import FallLimits
from .world import Base


def specific_force(
    rotation: Rotation, before: Triple, after: Triple, period: float, gravity: Triple
) -> Triple:
    """What an accelerometer at the base origin reads, mean over a period: Rᵀ (dv/dt - g).

    Args:
        rotation: Base to world.
        before: Velocity of the base origin at the start, in world [m/s].
        after: At the end.
        period: Between the two [s].
        gravity: Acceleration of gravity, in world [m/s²].

    Returns:
        Specific force in the base frame [m/s²]: (0, 0, +g) at rest.
    """
    (ax, ay, az), (bx, by, bz), (gx, gy, gz) = before, after, gravity
    change = (bx - ax) / period - gx, (by - ay) / period - gy, (bz - az) / period - gz
    return rotate_back(rotation, change)


def robot_state(
    tick: int,
    t: float,
    joints: tuple[Sequence[float], Sequence[float]],
    tau: Sequence[float],
    grf: Sequence[float],
    base: Base,
    acceleration: Triple,
    rotation: Rotation,
    threshold: float,
) -> RobotState:
    """Fresh `RobotState` from plain numbers.

    Args:
        tick: Control periods since reset.
        t: Time [s].
        joints: Positions [rad] and velocities [rad/s], each (n,).
        tau: Torque [N·m], (n,).
        grf: Ground reaction forces, x y z of each foot in turn, world [N], (3 m,).
        base: State of the base.
        acceleration: Specific force, base frame [m/s²].
        rotation: Base to world, as in `base`.
        threshold: Force above which a foot counts as in contact [N].
    """
    n, m = len(tau), len(grf)
    gyro = rotate_back(rotation, base.angular_velocity)
    # One buffer and slices of it: making an array costs more than filling it.
    numbers = (*joints[0], *joints[1], *tau, *grf, *base.orientation, *gyro, *acceleration)
    values = np.frombuffer(array("d", numbers))
    touches = [x * x + y * y + z * z > threshold * threshold
               for x, y, z in zip(grf[::3], grf[1::3], grf[2::3], strict=True)]  # fmt: skip
    imu = 3 * n + m
    return RobotState(
        tick=tick,
        t=t,
        q=values[:n],
        dq=values[n : 2 * n],
        tau=values[2 * n : 3 * n],
        grf=values[3 * n : imu].reshape(-1, 3),
        orientation=values[imu : imu + 4],
        angular_velocity=values[imu + 4 : imu + 7],
        linear_acceleration=values[imu + 7 :],
        contact=np.array(touches, dtype=bool),
    )


def ground_truth(tick: int, t: float, base: Base) -> GroundTruth:
    """Fresh `GroundTruth`, velocities turned into the base frame."""
    rotation = rotation_matrix(base.orientation)
    velocity = rotate_back(rotation, base.velocity)
    spin = rotate_back(rotation, base.angular_velocity)
    values = np.frombuffer(array("d", (*base.position, *base.orientation, *velocity, *spin)))
    return GroundTruth(tick, t, values[:3], values[3:7], values[7:10], values[10:])


def fall_reason(base: Base, rotation: Rotation, limits: FallLimits) -> str | None:
    """Why the robot counts as fallen, or None. Source: the author's hyq_ml, hyq/physics.py."""
    height = base.position[2]
    if height < limits.height:
        return f"base height {height:.3f} m is below {limits.height:g} m"
    roll, pitch = roll_pitch(rotation)
    if abs(roll) > limits.roll:
        return f"roll {roll:.3f} rad is beyond {limits.roll:g} rad"
    if abs(pitch) > limits.pitch:
        return f"pitch {pitch:.3f} rad is beyond {limits.pitch:g} rad"
    return None


def check_finite(t: float, *values: Sequence[float]) -> None:
    """Raise when any number is not finite.

    Raises:
        DivergedError: The physics has diverged.
    """
    if not isfinite(sum(map(sum, values))):
        raise DivergedError(
            f"the simulated state is not finite at t = {t:.3f} s: gains too large for the "
            "physics rate, or an effect out of proportion"
        )
