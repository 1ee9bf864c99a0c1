# SPDX-License-Identifier: Apache-2.0
"""A robot without physics: states at rest and runs of the target generator."""

import numpy as np
import pytest

from loco_control.gait.generator import GaitParams, TargetGenerator
from loco_control.legs.kinematics import joint_position
from loco_control.orientation import quaternion
from loco_control.types import RobotState

DT = 0.004
FEET = np.array(
    [[0.375, 0.28, -0.6], [0.375, -0.28, -0.6], [-0.375, 0.28, -0.6], [-0.375, -0.28, -0.6]]
)


@pytest.fixture
def standing():
    """Joint positions of the nominal stance [rad], (12,)."""
    return joint_position(FEET)


@pytest.fixture
def state_at(standing):
    """Function that makes a state at rest on the nominal stance, with changes."""

    def make(tick=0, roll=0.0, pitch=0.0, yaw=0.0, **changes):
        fields = {
            "q": standing,
            "dq": np.zeros(12),
            "tau": np.zeros(12),
            "grf": np.zeros((4, 3)),
            "orientation": quaternion(roll, pitch, yaw),
            "angular_velocity": np.zeros(3),
            "linear_acceleration": np.array([0.0, 0.0, 9.81]),
            "contact": np.ones(4, dtype=bool),
        }
        return RobotState(tick=tick, t=tick * DT, **{**fields, **changes})

    return make


@pytest.fixture
def targets(state_at):
    """Function that runs a gait, by default without standing first, for a time [s]."""

    def run(duration, **gait):
        generator = TargetGenerator(GaitParams(**{"start_time": 0.0, **gait}), DT)
        return [generator.step(state_at(tick)) for tick in range(round(duration / DT))]

    return run
