# SPDX-License-Identifier: Apache-2.0
"""Trunk controller: virtual springs and dampers on the trunk, realised by the stance legs.

The desired wrench w on the trunk is produced by ground forces f on the n stance
feet, G f = w, and a force on a foot requires the joint torques tau = -J^T f of
its leg. Several f produce the same w; the two mappings select different ones.

Source: the RCF controller as the author ran it (hyq_ml). Departures: height and its
velocity are means over all stance feet; the desired height is that of the target's
lowest foot; the weight is that of the simulated robot (84.76 kg, author 75 kg).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..legs.geometry import HYQ
from ..params import Params, parameter
from ..types import GaitTarget, RobotState, TrunkTorque
from .mpc import MpcParams, MpcTrunk

MAPPINGS = ("nullspace", "minimum_force")


@dataclass(frozen=True)
class TrunkParams(Params):
    """Gains of the virtual wrench on the trunk and its distribution to the legs.

    Source: gains of the author's option file (hyq_ml, hyq_sim_options.ini).
    """

    enabled: bool = parameter(True, "whether the trunk controller is on")
    roll_kp: float = parameter(1000.0, "stiffness about x", "N·m/rad", low=0.0)
    roll_kd: float = parameter(150.0, "damping about x", "N·m·s/rad", low=0.0)
    pitch_kp: float = parameter(1000.0, "stiffness about y", "N·m/rad", low=0.0)
    pitch_kd: float = parameter(150.0, "damping about y", "N·m·s/rad", low=0.0)
    yaw_kp: float = parameter(100.0, "stiffness about z, if heading_hold", "N·m/rad", low=0.0)
    yaw_kd: float = parameter(100.0, "damping about z", "N·m·s/rad", low=0.0)
    height_kp: float = parameter(5000.0, "stiffness along z", "N/m", low=0.0)
    height_kd: float = parameter(800.0, "damping along z", "N·s/m", low=0.0)
    mass: float = parameter(84.76, "mass that the legs carry (author: 75)", "kg", low=0.0)
    gravity: float = parameter(9.81, "gravity of the weight compensation", "m/s²", low=0.0)
    mapping: str = parameter(
        "nullspace",
        "distribution of the wrench to legs; mpc: planned forces instead",
        choices=(*MAPPINGS, "mpc"),
    )
    heading_hold: bool = parameter(True, "hold the initial heading, or that after a turn")
    push_only: bool = parameter(True, "feet never pull on the ground")
    min_stance_legs: int = parameter(2, "no torque with fewer legs in stance", low=1, high=4)
    mpc: MpcParams = parameter(MpcParams(), "predictive control, with the mapping mpc")


class TrunkController:
    """Virtual springs and dampers on height, roll, pitch and heading.

    Args:
        params: Gains and mapping.
        legs: Geometry, columns named by `legs.geometry.COLUMNS`, (4, 16); default HyQ's.
    """

    def __init__(self, params: TrunkParams, legs: np.ndarray | None = None):
        from . import kernels as stance_kernels  # loads numba

        self.params, self._kernels = params, stance_kernels
        self._legs = HYQ if legs is None else legs
        self._gains = np.array([getattr(params, name) for name in stance_kernels.GAINS])
        self._mpc = None
        if params.mapping == "mpc":
            self._mpc = MpcTrunk(params.mpc, params.mass, params.gravity, self._legs)
        fewest = params.min_stance_legs if params.enabled else 5  # more legs than exist: disabled
        self._options = (fewest, params.mapping == "nullspace", params.push_only)
        self.reset()

    def reset(self) -> None:
        """Discard the desired heading; the next step sets it to the current heading."""
        self._heading: float | None = None
        if self._mpc:
            self._mpc.reset()

    def step(self, state: RobotState, target: GaitTarget, stance: np.ndarray) -> TrunkTorque:
        """Torques of the legs in `stance`, (4,) bool, at the tick of `state`."""
        rate = self._kernels.turning_rate(target.foot_position, target.foot_velocity, target.stance)
        held = self.params.heading_hold and rate == 0.0  # at the end of a turn, where it is
        if self._heading is None or not held:
            self._heading = self._kernels.roll_pitch_yaw(state.orientation)[2]
        if self._mpc and stance.sum() >= self._options[0]:
            tau, wrench = self._mpc.step(state, target, (self._heading, rate), stance)
            return TrunkTorque(state.tick, state.t, tau, wrench, stance.copy())
        tau, wrench = self._kernels.trunk_torque(
            *(state.q, state.dq, state.orientation, state.angular_velocity),
            *(target.foot_position, (self._heading, rate), stance),
            *(self._gains, self._options, self._legs),
        )
        return TrunkTorque(state.tick, state.t, tau, wrench, stance.copy())
