# SPDX-License-Identifier: Apache-2.0
"""Limits that the plant keeps whatever the controllers say.

The limits are those of the URDF times a factor, so that a healthy run never meets them:
its bytes are the same with and without. References are brought back to them; joints
that move faster or take more power than they allow make the plant stop.
"""

from __future__ import annotations

import dataclasses
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass

import numpy as np
from numba import njit

from loco_control.params import Params, parameter
from loco_control.types import MotionCommand, RobotState, TrunkTorque

from .robot import Robot
from .servo import TorqueDrive

KINDS = ("position", "velocity", "rate", "torque")


@dataclass(frozen=True)
class SafetyParams(Params):
    """How far beyond the limits of the URDF a run may go."""

    enabled: bool = parameter(True, "keep the limits")
    position: float = parameter(
        0.0, "position references may leave the joint's range by this much", "rad", 0.0, 10.0
    )
    velocity: float = parameter(
        4.0, "largest velocity reference, over the joint's velocity limit", "-", 0.1, 1e6
    )
    rate: float = parameter(
        20.0, "fastest change of a position reference, over the velocity limit", "-", 0.1, 1e6
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
        5, "ticks in a row beyond overspeed or power before the robot is stopped", "ticks", 1, 1000
    )


class Safety:
    """Limits of one robot.

    Args:
        robot: Whose URDF says the limits; joints without any have none.
        params: How far beyond they reach.
        dt: Control period [s].

    Attributes:
        limited: How many commands each kind of limit has changed.
    """

    def __init__(self, robot: Robot, params: SafetyParams, dt: float):
        self._params, self._joints, self._dt = params, robot.joints, dt
        lower, upper, speed = _limits(robot)
        effort = np.array(robot.effort, dtype=float)
        driven = np.zeros(len(robot.joints), dtype=bool)
        driven[robot.driven if len(robot.driven) else slice(None)] = True
        torque = [isinstance(robot.drives.get(j), TorqueDrive) for j in robot.joints]
        free = ~driven | np.array(torque, dtype=bool)  # without a position reference
        self._low = np.where(free, -np.inf, lower - params.position)
        self._high = np.where(free, np.inf, upper + params.position)
        self._speed = np.where(free, np.inf, params.velocity * speed)
        self._step = np.where(free, np.inf, params.rate * speed * dt)
        self._torque = params.torque * effort
        self._overspeed = np.where(driven, params.overspeed * speed, np.inf)
        self._power = np.where(driven, params.power * effort * speed, np.inf)
        self.limited = dict.fromkeys(KINDS, 0)
        self._none = np.zeros(len(robot.joints))
        self.reset()

    def reset(self) -> None:
        """Forget the command before, so that the next one may be anywhere."""
        self._before: np.ndarray | None = None
        self._beyond = 0

    def resume(self, state: RobotState) -> None:
        """The next command is compared with what is measured, not with the one before."""
        self._before, self._beyond = state.q, 0

    def limit(
        self, command: MotionCommand, trunk: TrunkTorque | None
    ) -> tuple[MotionCommand, TrunkTorque | None]:
        """The command within the limits; the same objects if it was.

        Values that are not finite are left as they are: the plant refuses them.

        Args:
            command: Joint references.
            trunk: Feed-forward torque.
        """
        before = command.q if self._before is None else self._before
        tau = self._none if trunk is None else trunk.tau
        bounds = self._low, self._high, self._speed, self._step, self._torque
        if _within(command.q, command.dq, tau, before, *bounds):
            self._before = command.q
            return command, trunk
        q = self._clip("rate", command.q, before - self._step, before + self._step)
        q = self._clip("position", q, self._low, self._high)
        dq = self._clip("velocity", command.dq, -self._speed, self._speed)
        tau = self._clip("torque", tau, -self._torque, self._torque)
        self._before = np.where(np.isfinite(q), q, before)
        limited = None if trunk is None else dataclasses.replace(trunk, tau=tau)
        return dataclasses.replace(command, q=q, dq=dq), limited

    def _clip(self, kind: str, values: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        clipped = np.clip(values, low, high)
        self.limited[kind] += bool(np.any((values < low) | (values > high)))
        return clipped

    def trip(self, state: RobotState) -> str:
        """Why the robot must stop now, "" if it need not."""
        worst = _beyond(state.dq, state.tau, self._overspeed, self._power)
        self._beyond = self._beyond + 1 if worst >= 0 else 0
        if self._beyond < self._params.trip_ticks:
            return ""
        speed, power = state.dq[worst], abs(state.dq[worst] * state.tau[worst])
        joint = self._joints[worst]
        if abs(speed) > self._overspeed[worst]:
            return f"{joint} moves at {speed:.3g} rad/s, more than {self._overspeed[worst]:.3g}"
        return f"{joint} takes {power:.4g} W, more than {self._power[worst]:.4g}"


def _limits(robot: Robot) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lower and upper position [rad] and velocity limit [rad/s] of each joint, (n,) each."""
    found = {}
    for joint in ElementTree.fromstring(robot.urdf).iter("joint"):
        limit = joint.find("limit")
        said = {} if limit is None else limit.attrib
        ranged = joint.get("type") != "continuous" and {"lower", "upper"} <= said.keys()
        low, high = (said["lower"], said["upper"]) if ranged else ("-inf", "inf")
        speed = float(said.get("velocity", 0.0)) or np.inf  # 0 is how URDFs say nothing
        found[joint.get("name")] = (float(low), float(high), speed)
    lower, upper, speed = np.array([found[name] for name in robot.joints], dtype=float).T
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
def _beyond(dq, tau, speed, power):
    """First joint that moves too fast or takes too much power, -1 if none does."""
    for i in range(len(dq)):
        if abs(dq[i]) > speed[i] or abs(dq[i] * tau[i]) > power[i]:
            return i
    return -1
