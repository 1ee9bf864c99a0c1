# SPDX-License-Identifier: Apache-2.0
"""Places at which effects are sought."""

import numpy as np
import pytest

from loco_sim.effects import EFFECTS
from loco_sim.effects.offers import Motion
from loco_sim.effects.places import bodies, links
from loco_sim.robot import robot as robots
from loco_sim.robot.description import Description


@pytest.mark.parametrize("name", ["hyq", "hyq_leg", "tigrillo", "linear_axis"])
def test_each_link_that_moves_belongs_to_one_body_which_is_the_heaviest(name):
    robot = robots.load(name)
    text = Description(robot.urdf)
    of = dict.fromkeys(text.fixed_to(text.root_link()), text.root_link())
    for joint in robot.joints:
        of |= dict.fromkeys(text.fixed_to(text.child(joint)), text.child(joint))
    chosen = bodies(robot)
    assert len({of[link] for link in chosen}) == len(chosen)
    for link, _ in links(robot):
        (mine,) = (body for body in chosen if of[body] == of[link])
        assert text.mass_of(mine) >= text.mass_of(link)


def test_the_centre_of_mass_of_fixed_links_is_offered_once():
    robot = robots.load("tigrillo")  # its trunk has two parts, its feet are fixed to shanks
    offers = EFFECTS["com_offset"].offers(robot, ("q",), Motion(np.zeros(8), np.ones(8)))
    assert [offer.place for offer in offers] == bodies(robot)
    assert len(links(robot)) > len(offers) == 9
