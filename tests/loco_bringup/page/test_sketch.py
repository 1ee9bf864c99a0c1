# SPDX-License-Identifier: Apache-2.0
"""A drawing holds the whole robot, and marks what a place names."""

import re
from dataclasses import replace

import pytest

from loco_bringup.page import sketch
from loco_sim.robot.robot import load


@pytest.mark.parametrize("name", ["hyq", "tigrillo", "servo_pendulum"])
def test_every_joint_is_a_line_inside_the_drawing(name):
    robot = load(name)
    text = sketch.drawing(robot, set(), "nothing")
    values = [float(v) for v in re.findall(r'[xy][12]="(.*?)"', text)]
    assert len(values) >= 4 * robot.urdf.count("<joint ")
    assert all(0.0 <= v <= sketch.WIDTH for v in values)
    assert 'class="here"' not in text


def test_a_link_that_carries_no_other_is_drawn_to_its_centre_of_mass():
    robot = load("servo_pendulum")
    link = '<robot name="pole"><link name="base"/><link name="pole"><inertial>%s</inertial></link>'
    joint = '<joint name="%s" type="revolute"><parent link="base"/><child link="pole"/></joint>'
    origin = '<origin xyz="0 0 -0.3"/><mass value="1"/>'
    pole = replace(robot, urdf=f"{link % origin}{joint % robot.joints[0]}</robot>")
    (up, down) = re.findall(r'y[12]="(.*?)"', sketch.drawing(pole, set(), "nothing"))[-2:]
    assert float(down) - float(up) > 0.5 * sketch.HEIGHT  # it hangs


def test_a_place_is_a_joint_a_link_or_a_pattern():
    robot = load("hyq")
    assert sketch.marked(robot, ["base_link"]) == {"base_link"}
    (knee,) = sketch.marked(robot, ["lf_kfe_joint"])
    assert knee in sketch.marked(robot, ["*_kfe_joint"])
    assert len(sketch.marked(robot, ["*_kfe_joint"])) == 4
    assert sketch.marked(robot, []) == sketch.marked(robot, ["nowhere"]) == set()
    assert sketch.drawing(robot, {knee}, "<knee>").count('class="here"') == 1
    assert "<knee>" not in sketch.drawing(robot, {knee}, "<knee>")
