# SPDX-License-Identifier: Apache-2.0
"""Fallback controllers for the safe state, used when commands fail: hold, sit down, damp.

Damping is the last stage and, by default, the only one. Optionally a robot holds its posture for
a time, or sits down, before it is damped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.legs.kinematics import foot_position, joint_position
from loco_control.params import Params, parameter
from loco_control.types import MotionCommand, RobotState, TrunkTorque

from ..robot.robot import Robot


@dataclass(frozen=True)
class FallbackParams(Params):
    """Stages of the safe state in sequence; the last, damping, has no time limit."""

    hold: float = parameter(0.0, "hold the measured posture first", "s", 0.0, 3600.0)
    sit: float = parameter(0.0, "then sit down within this time, 0 for not at all", "s", 0.0, 60.0)
    height: float = parameter(
        0.6, "height of the base over the feet when sitting, over that of standing", "-", 0.3, 1.0
    )


class Fallback:
    """Commands of the safe state of one robot.

    Args:
        robot: The robot; None for a plant without a robot, which is damped.
        params: Durations of the stages.
        dt: Control period [s].

    Raises:
        ParameterError: The robot cannot sit down: ``robot.yaml`` lists no legs, or the legs cannot
            fold that far.
    """

    def __init__(self, robot: Robot | None, params: FallbackParams, dt: float):
        self._hold, self._sit = round(params.hold / dt), round(params.sit / dt)
        self._low = _sitting(robot, params.height) if self._sit else None
        self.reset()

    def reset(self) -> None:
        """Reset after valid commands; the next failure begins with the first stage."""
        self._ticks, self._first = 0, None

    @property
    def stage(self) -> str:
        """Stage of the next command: ``hold``, ``sit`` or ``damp``."""
        if self._ticks < self._hold:
            return "hold"
        return "sit" if self._ticks < self._hold + self._sit else "damp"

    def command(self, state: RobotState) -> tuple[MotionCommand, TrunkTorque]:
        """Command of the next tick.

        Holding and sitting use the gains of stance. In damping, the reference of each joint is
        its measured position at zero velocity, so that it yields slowly.

        Args:
            state: Newest measurement.
        """
        if self._first is None:
            self._first = state.q
        stage, zero = self.stage, state.q * 0.0
        q, stance = state.q, state.contact
        if stage != "damp":
            stance = np.ones_like(state.contact)
            q = self._first
        if stage == "sit":
            share = (self._ticks - self._hold + 1) / self._sit
            q = q + (share * share * (3.0 - 2.0 * share)) * (self._low - q)
        self._ticks += 1
        return (
            MotionCommand(state.tick, state.t, q, zero),
            TrunkTorque(state.tick, state.t, zero, zero[:6], stance),
        )


def _sitting(robot: Robot | None, height: float) -> np.ndarray:
    """Joint positions [rad], (n,), with the feet under the hips at a share of the height."""
    if robot is None or robot.legs is None:
        name = "this plant" if robot is None else robot.name
        raise ParameterError(
            f"{name} cannot sit down: its robot.yaml lists no legs; set fallback.sit to 0"
        )
    feet = foot_position(robot.standing, robot.legs)
    feet[:, 2] *= height
    try:
        return joint_position(feet, robot.legs)
    except ParameterError as error:
        raise ParameterError(
            f"{robot.name} cannot sit at {height:g} of its standing height, raise "
            f"fallback.height: {error}"
        ) from None
