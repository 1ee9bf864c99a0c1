# SPDX-License-Identifier: Apache-2.0
"""Laws of the coordinates of hypotheses."""

import math

import numpy as np
import pytest

from loco_sim.effects import EFFECTS
from loco_sim.effects.coordinates import Coordinate, assemble
from loco_sim.effects.offers import Motion
from loco_sim.effects.places import links
from loco_sim.robot import robot
from loco_sim.robot.description import Description

STRAIGHT = Coordinate("torque", 0.05, (1.0,), 0.0, 200.0, "N·m", strength=True)
CURVED = Coordinate("time", 0.1, (0.0,), 1e-3, 100.0, "s", logarithmic=True)


@pytest.mark.parametrize("c", [STRAIGHT, CURVED])
@pytest.mark.parametrize("x", [0.3, 1.0, 2.5])
def test_value_and_coordinate_are_inverse(c, x):
    assert c.inverse(c.value(x)) == pytest.approx(x)


def test_values_stay_in_their_bounds():
    assert STRAIGHT.value(-3.0) == 0.0
    assert CURVED.value(-100.0) == 1e-3
    assert CURVED.value(1e9) == 100.0
    assert STRAIGHT.clipped(-3.0) == 0.0


@pytest.mark.parametrize("c", [STRAIGHT, CURVED])
def test_a_coordinate_within_its_bounds_is_clipped_to_the_very_same_number(c):
    """A step that rounding turned round left the bounds: a size of 0 seemed to do nothing."""
    for x in np.linspace(0.01, 3.0, 300):
        assert c.clipped(x) == x


def test_one_unit_of_a_logarithm_is_a_factor_of_e():
    assert CURVED.value(1.0) / CURVED.value(0.0) == pytest.approx(math.e)


def test_vectors_are_put_together_from_their_axes():
    axes = [
        Coordinate("offset", 0.01, (1.0,), -1.0, 1.0, "m", True, False, direction)
        for direction in ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    ]
    assert assemble([*axes, STRAIGHT], [2.0, -1.0, 1.0]) == {
        "offset": [0.02, 0.0, -0.01],
        "torque": 0.05,
    }
    assert [c.label for c in axes] == ["offset.x", "offset.z"]


@pytest.mark.parametrize("name", ["hyq", "tigrillo"])
def test_a_payload_may_sit_anywhere_on_a_base_that_moves(name):
    loose, held = (robot.load(name, {"fixed_base": b, "height": 1.0}) for b in (False, True))
    hints = Motion(np.zeros(12), np.zeros(12))
    (first, *others) = EFFECTS["payload"].offers(loose, ("q",), hints)
    text = Description(loose.urdf)
    assert first.place in text.fixed_to(text.root_link())  # once, whatever is fixed together
    assert not {o.place for o in others} & set(text.fixed_to(text.root_link()))
    x = [1.0, 0.5, -0.5, 1.0]
    far = first.coordinates[1].high
    values = assemble(first.coordinates, x)
    assert values["position"] == pytest.approx([0.5 * far, -0.5 * far, far])
    assert far >= text.extent(first.place)
    assert first.place not in {o.place for o in EFFECTS["payload"].offers(held, ("q",), hints)}


@pytest.mark.parametrize("at_joint", [False, True])
def test_a_payload_may_sit_beside_the_centre_of_mass_of_a_link_that_turns(at_joint):
    """Along the line through it alone, a load at the tip of a bent link was a wrong centre.

    Inertias that people write by hand often have it in the joint, from where no line leads.
    """
    arm, place = robot.load("hyq", {"fixed_base": True, "height": 1.0}), [0.3, -0.2, 0.1]
    if at_joint:
        link, com = links(arm)[-1]
        moved = {f"bodies.{link}.{axis}": -v for axis, v in zip("xyz", com, strict=True)}
        arm = robot.load("hyq", {"fixed_base": True, "height": 1.0, **moved})
        assert np.linalg.norm(dict(links(arm))[link]) < 1e-9
    offers = EFFECTS["payload"].offers(arm, ("q",), Motion(np.zeros(12), np.zeros(12)))
    for link in {o.place for o in offers}:
        (_, *position) = max((o.coordinates for o in offers if o.place == link), key=len)
        x = [c.inverse(value) for c, value in zip(position, place, strict=True)]
        assert assemble(position, x)["position"] == pytest.approx(place)


def test_friction_that_fades_loses_a_ninth_at_the_speed_that_a_joint_reached():
    """If it loses less, it is Coulomb friction in these data; a speed not known changes nothing.

    On a Franka friction falls with the speed reached; with a bound there, it was explained by
    springs.
    """
    arm, fast = robot.load("hyq", {"fixed_base": True}), np.full(12, np.nan)
    fast[:2] = 0.02, 500.0
    fast[3:5] = 0.5, 4.0  # 1 rad/s is the largest usual velocity
    hints = Motion(np.zeros(12), np.zeros(12), fast=fast)
    offered = {o.place: o for o in EFFECTS["stribeck_friction"].offers(arm, ("q",), hints)}
    slow, quick, unknown = (offered[joint].coordinates[1] for joint in arm.joints[:3])
    assert slow.high == slow.value(99.0) == pytest.approx(0.06)
    assert math.exp(-((0.02 / slow.high) ** 2)) == pytest.approx(8 / 9, abs=0.01)
    assert all(slow.low < slow.value(x) <= slow.high for x in slow.start)
    assert quick == unknown and unknown.high == 100.0
    usual, above = (offered[joint].coordinates[1].high for joint in arm.joints[3:5])
    assert (usual, above) == (1.0, 4.0)


@pytest.mark.parametrize(
    ("direction", "label"),
    [((0.0, 0.0, 1.0), "at.z"), ((0.0, 0.0, -1.0), "at.-z"), ((0.6, 0.0, -0.8), "at")],
)
def test_a_distance_along_a_negative_axis_says_so(direction, label):
    assert Coordinate("at", 1.0, (0.0,), 0.0, 1.0, direction=direction).label == label
