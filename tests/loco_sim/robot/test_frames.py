# SPDX-License-Identifier: Apache-2.0
"""Forward kinematics from any URDF: that of HyQ is the known one, turns are rotations."""

from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.legs.kinematics import foot_position
from loco_sim.robot import robot as robots
from loco_sim.robot.frames import feet_in_base, turns

SLIDE = """
<robot name="slide"><link name="base"/><link name="arm"/><link name="tip"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="arm"/>
  <origin xyz="0 0 1" rpy="0 0 1.5707963267948966"/><axis xyz="1 0 0"/></joint>
<joint name="end" type="fixed"><parent link="arm"/><child link="tip"/><origin xyz="0 1 0"/></joint>
</robot>
"""


def test_the_feet_of_hyq_are_where_its_own_kinematics_says():
    q = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 12))
    feet = [foot_position(row) for row in q]
    np.testing.assert_allclose(feet_in_base(robots.load("hyq"), q), feet, atol=1e-9)


def test_a_slide_moves_along_its_axis_in_the_turned_frame():
    robot = SimpleNamespace(urdf=SLIDE, joints=("slide",), feet=("tip",))
    places = feet_in_base(robot, np.array([[0.0], [0.5]]))
    np.testing.assert_allclose(places[:, 0], [[-1.0, 0.0, 1.0], [-1.0, 0.5, 1.0]], atol=1e-12)
    assert feet_in_base(SimpleNamespace(**{**vars(robot), "feet": ()}), np.zeros((3, 1))).shape == (
        3, 0, 3,
    )  # fmt: skip


@pytest.mark.parametrize("axis", [(1.0, 0.0, 0.0), (0.3, -2.0, 0.7)])
def test_turns_are_rotations_about_their_axis(axis):
    axis = np.array(axis)
    found = turns(axis, np.array([0.0, 0.4, -3.0]))
    np.testing.assert_allclose(found[0], np.eye(3), atol=1e-15)
    np.testing.assert_allclose(found @ axis, np.tile(axis, (3, 1)), atol=1e-12)
    np.testing.assert_allclose(
        found @ found.transpose(0, 2, 1), np.tile(np.eye(3), (3, 1, 1)), atol=1e-12
    )
    np.testing.assert_allclose(np.trace(found, axis1=1, axis2=2), 1 + 2 * np.cos([0, 0.4, -3.0]))
