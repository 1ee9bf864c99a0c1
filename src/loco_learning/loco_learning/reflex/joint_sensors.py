# SPDX-License-Identifier: Apache-2.0
"""Sensors of a joint reflex: angles of passive joints, angular velocity and tilt of the base."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.orientation import roll_pitch_yaw


def passive_joints(robot: Any) -> np.ndarray:
    """Indices of the joints without a drive, (p,)."""
    return np.setdiff1d(np.arange(len(robot.joints)), robot.driven)


def sensor_kinds(robot: Any) -> tuple[str, ...]:
    """Kind of each element of `sensor_vector`, joint, gyro or tilt, (k,)."""
    return ("joint",) * len(passive_joints(robot)) + ("gyro",) * 3 + ("tilt",) * 2


def sensor_vector(state: Any, robot: Any, passive: np.ndarray | None = None) -> np.ndarray:
    """Sensors of a robot in one vector, (k,), k = passive joints + 5.

    Args:
        state: State with `q` (n,) [rad], `angular_velocity` (3,) [rad/s], `orientation` (4,).
        robot: Robot with `joints` and `driven`.
        passive: Result of `passive_joints(robot)`, if already computed.

    Returns:
        Angles of the passive joints [rad], gyro x y z [rad/s], roll and pitch [rad]. Yaw is
        left out: a gait does not depend on the heading of the robot.
    """
    passive = passive_joints(robot) if passive is None else passive
    p = len(passive)
    values = np.empty(p + 5)
    values[:p] = state.q[passive]
    values[p : p + 3] = state.angular_velocity
    values[p + 3 :] = roll_pitch_yaw(state.orientation)[:2]
    return values


def columns(
    name: str, requested: Sequence[str], available: Sequence[str], what: str, robot: Any
) -> list[int]:
    """Column indices of joints in a recording.

    Args:
        name: Name of the recording, for the message.
        requested: Joints of the robot.
        available: Joints of the columns.
        what: Meaning of the columns, for the message.
        robot: Robot with `name`.

    Raises:
        ParameterError: The recording lacks a joint.
    """
    missing = [joint for joint in requested if joint not in available]
    if missing:
        raise ParameterError(
            f"{name} has no {what} of {', '.join(missing)}, joints of robot {robot.name!r}; "
            f"it has {', '.join(available) or 'none'}"
        )
    return [available.index(joint) for joint in requested]
