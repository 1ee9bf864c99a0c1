# SPDX-License-Identifier: Apache-2.0
"""Trunk controller: virtual springs on the trunk, carried by the stance legs.

The wanted wrench w at the trunk is made of ground forces f on the n stance
feet, G f = w, and a force on a foot takes the joint torques tau = -J^T f of
its leg. More than one f makes the same w; the two mappings differ in which.

Source: the RCF controller as the author ran it (hyq_ml). Departures: height and its
velocity are means over all stance feet; the height wanted is that of the target's lowest foot; the weight is that
of the simulated robot (84.76 kg, author 75 kg).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .orientation import roll_pitch_yaw, rotation_base_to_horizontal, wrap_angle
from .params import Params, parameter
from .types import GaitTarget, RobotState, TrunkTorque

MAX_HEADING_ERROR = math.radians(45.0)
MAPPINGS = ("nullspace", "minimum_force")


@dataclass(frozen=True)
class TrunkParams(Params):
    """Gains of the virtual wrench on the trunk and how the legs share it.

    Source: gains of the author's option file (hyq_ml, hyq_sim_options.ini).
    """

    enabled: bool = parameter(True, "apply any torque at all")
    roll_kp: float = parameter(1000.0, "stiffness about x", "N·m/rad", low=0.0)
    roll_kd: float = parameter(150.0, "damping about x", "N·m·s/rad", low=0.0)
    pitch_kp: float = parameter(1000.0, "stiffness about y", "N·m/rad", low=0.0)
    pitch_kd: float = parameter(150.0, "damping about y", "N·m·s/rad", low=0.0)
    yaw_kp: float = parameter(100.0, "stiffness about z, if heading_hold", "N·m/rad", low=0.0)
    yaw_kd: float = parameter(100.0, "damping about z", "N·m·s/rad", low=0.0)
    height_kp: float = parameter(5000.0, "stiffness along z", "N/m", low=0.0)
    height_kd: float = parameter(800.0, "damping along z", "N·s/m", low=0.0)
    mass: float = parameter(84.76, "body weight the legs hold (author: 75)", "kg", low=0.0)
    gravity: float = parameter(9.81, "gravity the legs hold against", "m/s²", low=0.0)
    mapping: str = parameter("nullspace", "how the legs share the wrench", choices=MAPPINGS)
    heading_hold: bool = parameter(True, "keep the heading of the first tick")
    push_only: bool = parameter(True, "a foot is never asked to pull on the ground")
    min_stance_legs: int = parameter(2, "no torque with fewer legs in stance", low=1, high=4)


class TrunkController:
    """Virtual springs and dampers on height, roll, pitch and heading.

    Args:
        params: Gains and mapping.
    """

    def __init__(self, params: TrunkParams):
        from . import forces, kinematics  # loads numba

        self.params, self._mappings = params, forces
        self._lengths = kinematics.HYQ.lengths()
        self._turned_feet = kinematics.turned_feet
        self.reset()

    def reset(self) -> None:
        """Forget the heading; the next step sets it anew."""
        self._heading: float | None = None

    def step(self, state: RobotState, target: GaitTarget, stance: np.ndarray) -> TrunkTorque:
        """Torques of the legs that stand, (4,) bool, at the tick of `state`."""
        roll, pitch, yaw = roll_pitch_yaw(state.orientation)
        if self._heading is None:
            self._heading = yaw
        turned = wrap_angle(yaw - self._heading)
        tau, wrench = np.zeros((4, 3)), np.zeros(6)
        legs = np.flatnonzero(stance)
        if self.params.enabled and len(legs) >= self.params.min_stance_legs:
            R = rotation_base_to_horizontal(roll, pitch)
            spin = R @ state.angular_velocity
            q, dq = state.q.reshape(4, 3), state.dq.reshape(4, 3)
            feet, J, velocity = self._turned_feet(q, dq, R, spin, self._lengths)
            height, rise = -sum(feet[legs, 2]) / len(legs), -sum(velocity[legs, 2]) / len(legs)
            lift = self._lift(-min(target.foot_position[:, 2]), height, rise)
            wrench[2:] = lift, *self._moment(roll, pitch, turned, spin)
            forces = self._forces(wrench, feet[legs], J[legs])
            for leg, force in zip(legs, forces, strict=True):
                tau[leg] = -force @ J[leg]
        return TrunkTorque(state.tick, state.t, tau.ravel(), wrench, stance.copy())

    def _lift(self, wanted: float, height: float, rise: float) -> float:
        p = self.params
        return p.height_kp * (wanted - height) - p.height_kd * rise + p.mass * p.gravity

    def _moment(self, roll: float, pitch: float, turned: float, spin: np.ndarray) -> tuple:
        p = self.params
        turned = min(max(turned, -MAX_HEADING_ERROR), MAX_HEADING_ERROR)
        return (
            -p.roll_kp * roll - p.roll_kd * spin[0],
            -p.pitch_kp * pitch - p.pitch_kd * spin[1],
            -(p.yaw_kp * turned if p.heading_hold else 0.0) - p.yaw_kd * spin[2],
        )

    def _forces(self, wrench: np.ndarray, feet: np.ndarray, J: np.ndarray) -> np.ndarray:
        if self.params.mapping == "nullspace":
            forces = self._mappings.nullspace_forces(wrench, feet, J)
        else:
            forces = self._mappings.minimum_forces(wrench, feet)
        if self.params.push_only:
            np.maximum(forces[:, 2], 0.0, out=forces[:, 2])
        return forces
