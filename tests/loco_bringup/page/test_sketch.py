# SPDX-License-Identifier: Apache-2.0
"""A drawing holds the whole robot, and marks what a place names."""

import re

import pytest

from loco_bringup.page import sketch
from loco_sim.robot.robot import load


@pytest.mark.parametrize("name", ["hyq", "tigrillo", "servo_pendulum"])
def test_every_joint_is_a_line_inside_the_drawing(name):
    robot = load(name)
    text = sketch.drawing(robot, set(), "nothing")
    values = [float(v) for v in re.findall(r'[xy][12]="(.*?)"', text)]
    assert len(values) == 4 * robot.urdf.count("<joint ")
    assert all(0.0 <= v <= sketch.WIDTH for v in values)
    assert 'class="here"' not in text


def test_a_place_is_a_joint_a_link_or_a_pattern():
    robot = load("hyq")
    assert sketch.marked(robot, ["base_link"]) == {"base_link"}
    (knee,) = sketch.marked(robot, ["lf_kfe_joint"])
    assert knee in sketch.marked(robot, ["*_kfe_joint"])
    assert len(sketch.marked(robot, ["*_kfe_joint"])) == 4
    assert sketch.marked(robot, []) == sketch.marked(robot, ["nowhere"]) == set()
    assert sketch.drawing(robot, {knee}, "<knee>").count('class="here"') == 1
    assert "<knee>" not in sketch.drawing(robot, {knee}, "<knee>")
