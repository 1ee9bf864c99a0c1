# SPDX-License-Identifier: Apache-2.0
"""Commands of driven joints reach their joints, torques as torques."""

import numpy as np
import pytest

from loco_sim.plant.joint_commands import JointCommands
from loco_sim.robot import robot


def test_values_go_to_the_driven_joints_and_nowhere_else():
    tigrillo = robot.load("tigrillo")
    q, dq = np.arange(1.0, 5.0), np.arange(5.0, 9.0)
    command, trunk = JointCommands(tigrillo)(7, 0.07, q, dq)
    assert trunk is None
    assert (command.tick, command.t) == (7, 0.07)
    passive = np.setdiff1d(np.arange(len(tigrillo.joints)), tigrillo.driven)
    np.testing.assert_array_equal(command.q[tigrillo.driven], q)
    np.testing.assert_array_equal(command.dq[tigrillo.driven], dq)
    assert not command.q[passive].any() and not command.dq[passive].any()


@pytest.mark.parametrize("name", robot.names())
def test_a_torque_drive_gets_its_value_as_a_torque(name):
    made = robot.load(name)
    q = np.full(len(made.driven), 0.3)
    _, trunk = JointCommands(made)(0, 0.0, q, 0.0 * q)
    kinds = {type(drive).__name__ for drive in made.drives.values()}
    assert (trunk is not None) == ("TorqueDrive" in kinds)
    if trunk is not None:
        np.testing.assert_array_equal(trunk.tau[made.driven], q)
