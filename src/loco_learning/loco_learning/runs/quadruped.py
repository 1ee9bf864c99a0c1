# SPDX-License-Identifier: Apache-2.0
"""Defaults of an experiment with a walking robot: HyQ's values, scaled to the robot's size."""

from __future__ import annotations

from loco_control.exceptions import ParameterError
from loco_control.gait import similarity
from loco_control.params import Params
from loco_sim.robot.robot import Robot

from ..params import LearnerParams

# Parameters of the learner that scale: forces, and times in ticks; lengths of phases do not.
LEARNER = ("grf_scale", "grf_threshold", "memory", "window")


def defaults(robot: Robot) -> dict[str, Params]:
    """Gait, trunk, stance and learner for a robot with legs, by the names of an experiment.

    Raises:
        ParameterError: The robot has no legs.
    """
    if robot.legs is None:
        raise ParameterError(
            f"robot {robot.name!r} lists no legs in its robot.yaml: a gait needs to know which "
            "joints are haa, hfe and kfe of each leg (a target of oscillators does not)"
        )
    size = similarity.size_of(robot.legs, robot.mass)
    learner = similarity.scaled(LearnerParams(), size, LEARNER)
    return {**similarity.control_defaults(robot.legs, size), "learner": learner}
