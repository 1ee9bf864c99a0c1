# SPDX-License-Identifier: Apache-2.0
"""Values of a robot that nobody knows exactly."""

from __future__ import annotations

import pytest

from loco_learning.gap.prediction import priors
from loco_learning.gap.prediction.loose import nominal_value
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description


@pytest.mark.parametrize(("robot", "speeds"), [("linear_axis", 0), ("servo_pendulum", 1)])
def test_every_moved_link_and_every_drive_is_in_doubt_once(robot, speeds):
    there = Model(robot).make_robot()
    names = [name for change in priors.values(there) for name in change]
    assert len(names) == len(set(names))
    assert sum(name.startswith("bodies.") for name in names) == 2 * len(there.joints)
    assert sum(name.endswith("no_load_speed") for name in names) == speeds


@pytest.mark.parametrize("index", [0, -1])
def test_a_change_is_a_robot_that_can_be_built_and_differs(index):
    there = Model("servo_pendulum").make_robot()
    change = {
        name: nominal_value(there, name) + spread
        for name, spread in priors.values(there)[index].items()
    }
    moved = Model("servo_pendulum", change).make_robot()
    if index == 0:
        ratio = Description(moved.urdf).mass() / Description(there.urdf).mass()
        assert 1.0 < ratio <= 1.0 + priors.MASS + 1e-9
    else:
        assert moved.drives != there.drives
