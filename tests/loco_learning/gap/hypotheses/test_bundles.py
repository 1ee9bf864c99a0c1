# SPDX-License-Identifier: Apache-2.0
"""Laws of what is tried together."""

from collections import namedtuple

import numpy as np

from loco_learning.gap.hypotheses.bundles import batches
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_sim.effects.offers import Motion
from loco_sim.robot import robot

Channel = namedtuple("Channel", "signal name")


def made(fixed, name="tigrillo", led=False):
    plant = robot.load(name, {"fixed_base": True, "height": 1.0} if fixed else {})
    n = len(plant.joints)
    hypotheses = offer(plant, ("q",), Motion(np.full(n, -0.5), np.full(n, 0.5)))
    channels = [Channel("q", joint) for joint in plant.joints]
    return hypotheses, batches(plant, channels, hypotheses, fixed, led)


def test_every_hypothesis_is_tried_once():
    for fixed in (True, False):
        hypotheses, found = made(fixed)
        held = [h.key for bundle in found for h in bundle.hypotheses]
        assert sorted(held) == sorted(h.key for h in hypotheses)


def test_bundled_hypotheses_look_at_channels_of_their_own():
    _, found = made(True)
    assert max(len(bundle.hypotheses) for bundle in found) == 4
    for bundle in found:
        assert len({(h.effect, h.variant) for h in bundle.hypotheses}) == 1
        masks = [m for m in bundle.channels if m is not None]
        if len(masks) > 1:
            assert np.sum(masks, axis=0).max() == 1


def test_legs_of_a_free_base_are_tried_one_by_one():
    assert all(len(bundle.hypotheses) == 1 for bundle in made(False)[1])
    assert all(len(bundle.hypotheses) == 1 for bundle in made(True, "servo_pendulum")[1])


def test_quiet_joints_of_a_robot_that_is_led_are_asked_too():
    assert all(bundle.passes for bundle in made(True)[1])
    assert not any(bundle.passes for bundle in made(True, led=True)[1])
