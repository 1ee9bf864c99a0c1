# SPDX-License-Identifier: Apache-2.0
"""Safety limits that the plant enforces independently of the controllers.

The limits are those of the URDF times a factor, so that a normal run never reaches them and
is bit-identical with and without them. References are clipped to the limits; a joint that
exceeds the limits of speed or power stops the plant.
"""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np
from numba import njit

from loco_control.params import Params, parameter
from loco_control.types import MotionCommand, RobotState, TrunkTorque

from ..robot.robot import Robot
from ..robot.servo import TorqueDrive

LIMIT_TYPES = ("position", "velocity", "rate", "acceleration", "jerk", "torque")


@dataclass(frozen=True)
class SafetyParams(Params):
    """Margins by which a run may exceed the limits of the URDF."""

    enabled: bool = parameter(True, "whether limits are applied")
    position: float = parameter(
        0.0, "distance by which references may exceed the joint's range", "rad", 0.0, 10.0
    )
    velocity: float = parameter(
        4.0, "largest velocity reference, over the joint's velocity limit", "-", 0.1, 1e6
    )
    rate: float = parameter(
        20.0, "fastest change of a position reference, over the velocity limit", "-", 0.1, 1e6
    )
    acceleration: float = parameter(
        0.0, "largest acceleration of a position reference; 0: no limit", "rad/s²", 0.0, 1e9
    )
    jerk: float = parameter(
        0.0, "largest jerk of a position reference; 0: no limit", "rad/s³", 0.0, 1e12
    )
    torque: float = parameter(
        2.0, "largest feed-forward torque, over the joint's effort limit", "-", 0.1, 1e6
    )
    overspeed: float = parameter(
        2.5, "measured velocity that stops the robot, over the velocity limit", "-", 0.1, 1e6
    )
    power: float = parameter(
        1.5, "measured power that stops the robot, over effort times velocity limit", "-", 0.1, 1e6
    )
    trip_ticks: int = parameter(
        5, "consecutive ticks above overspeed or power that stop the robot", "ticks", 1, 1000
    )


class Safety:
    """Limits of one robot.

    Args:
        robot: Robot with the limits in its URDF; joints without limits are not limited.
        params: Margins beyond the limits.
        dt: Control period [s].

    Attributes:
        limited: Number of commands changed, by kind of limit.
    """

    def __init__(self, robot: Robot, params: SafetyParams, dt: float):
        self._params, self._joints, self._dt = params, robot.joints, dt
        lower, upper, speed = _limits(robot)
        effort = np.array(robot.effort, dtype=float)
        driven = np.zeros(len(robot.joints), dtype=bool)
        driven[robot.driven if len(robot.driven) else slice(None)] = True
        torque = [isinstance(robot.drives.get(j), TorqueDrive) for j in robot.joints]
        free = ~driven | np.array(torque, dtype=bool)  # joints without a position reference
        self._low = np.where(free, -np.inf, lower - params.position)
        self._high = np.where(free, np.inf, upper + params.position)
        self._speed = np.where(free, np.inf, params.velocity * speed)
        self._step = np.where(free, np.inf, params.rate * speed * dt)
        self._bend = np.where(free | (params.acceleration == 0.0), np.inf, params.acceleration)
        self._jerk = np.where(free | (params.jerk == 0.0), np.inf, params.jerk)
        self._smooth = bool(params.acceleration or params.jerk)
        self._torque = params.torque * effort
        self._overspeed = np.where(driven, params.overspeed * speed, np.inf)
        self._power = np.where(driven, params.power * effort * speed, np.inf)
        self.limited = dict.fromkeys(LIMIT_TYPES, 0)
        self._none = np.zeros(len(robot.joints))
        self.reset()

    def reset(self) -> None:
        """Discard the previous command, so that the next one is not limited in rate."""
        self._past: tuple[np.ndarray, ...] | None = None
        self._trip_count = 0

    def resume(self, state: RobotState) -> None:
        """Limit the rate of the next command relative to the measured state."""
        self._past, self._trip_count = (state.q,) * 3, 0

    def limit(
        self, command: MotionCommand, trunk: TrunkTorque | None
    ) -> tuple[MotionCommand, TrunkTorque | None]:
        """The command clipped to the limits; the same objects if it was within them.

        Values that are not finite are not changed: the plant refuses them.

        Args:
            command: Joint references.
            trunk: Feed-forward torque.
        """
        before, second, third = self._past or (command.q,) * 3
        tau = self._none if trunk is None else trunk.tau
        bounds = self._low, self._high, self._speed, self._step, self._torque
        if not self._smooth and _within(command.q, command.dq, tau, before, *bounds):
            self._past = (command.q, before, second)
            return command, trunk
        q = self._clip("rate", command.q, before - self._step, before + self._step)
        if self._smooth:
            linear, dt = 2.0 * before - second, self._dt
            curved = linear + (before - 2.0 * second + third)
            q = self._clip("jerk", q, curved - self._jerk * dt**3, curved + self._jerk * dt**3)
            q = self._clip("acceleration", q, linear - self._bend * dt**2,
                           linear + self._bend * dt**2)  # fmt: skip
        q = self._clip("position", q, self._low, self._high)
        dq = self._clip("velocity", command.dq, -self._speed, self._speed)
        tau = self._clip("torque", tau, -self._torque, self._torque)
        self._past = (np.where(np.isfinite(q), q, before), before, second)
        limited = None if trunk is None else dataclasses.replace(trunk, tau=tau)
        return dataclasses.replace(command, q=q, dq=dq), limited

    def _clip(self, kind: str, values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        clipped = np.clip(values, low, high)
        self.limited[kind] += bool(np.any((values < low) | (values > high)))
        return clipped

    def trip(self, state: RobotState) -> str:
        """Reason to stop the robot now, "" if there is none; NaN readings are a reason."""
        index = _exceeding_joint(state.dq, state.tau, self._overspeed, self._power)
        self._trip_count = self._trip_count + 1 if index >= 0 else 0
        if self._trip_count < self._params.trip_ticks:
            return ""
        joint, speed, tau = self._joints[index], state.dq[index], state.tau[index]
        if not (np.isfinite(speed) and np.isfinite(tau)):
            return f"{joint} measures {speed:.3g} rad/s and {tau:.3g} N·m"
        if abs(speed) > self._overspeed[index]:
            return f"{joint} moves at {speed:.3g} rad/s, more than {self._overspeed[index]:.3g}"
        return f"{joint} takes {abs(speed * tau):.4g} W, more than {self._power[index]:.4g}"


def _limits(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper position [rad] and velocity limit [rad/s] of each joint, (n,) each."""
    limits = {}
    for joint in ElementTree.fromstring(robot.urdf).iter("joint"):
        limit = joint.find("limit")
        attributes = {} if limit is None else limit.attrib
        ranged = joint.get("type") != "continuous" and {"lower", "upper"} <= attributes.keys()
        low, high = (attributes["lower"], attributes["upper"]) if ranged else ("-inf", "inf")
        speed = float(attributes.get("velocity", 0.0)) or np.inf  # 0 means no limit in a URDF
        limits[joint.get("name")] = (float(low), float(high), speed)
    lower, upper, speed = np.array([limits[name] for name in robot.joints], dtype=float).T
    return lower, upper, speed


@njit(cache=True)
def _within(q, dq, tau, before, low, high, speed, step, torque):  # noqa: PLR0913 (a kernel)
    for i in range(len(q)):
        if not low[i] <= q[i] <= high[i] or abs(dq[i]) > speed[i]:
            return False
        if abs(q[i] - before[i]) > step[i] or abs(tau[i]) > torque[i]:
            return False
    return True


@njit(cache=True)
def _exceeding_joint(dq, tau, speed, power):
    """First joint that exceeds speed or power or has NaN readings; -1 if none."""
    for i in range(len(dq)):
        exceeds = abs(dq[i]) > speed[i] or abs(dq[i] * tau[i]) > power[i]
        if exceeds or not np.isfinite(dq[i] * tau[i]):
            return i
    return -1
