# SPDX-License-Identifier: Apache-2.0
"""A family is one law in several joints, each with a size of its own."""

from __future__ import annotations

from loco_learning.gap.fitting.screen import Screened
from loco_learning.gap.hypotheses.families import by_law, restrict
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_sim.effects import from_list
from loco_sim.effects.coordinates import Coordinate

JOINTS = ("hip", "knee", "ankle")


def screened(effect, place, share, x=(1.0,), **more):
    size = Coordinate("torque", 0.2, (1.0,), 0.0, 10.0, "N·m", strength=True)
    shape = Coordinate("velocity", 0.1, (0.0,), 1e-4, 100.0, "rad/s", logarithmic=True)
    free = (size, shape)[: len(x)]
    return Screened(Hypothesis(effect, place, (("joint", place),), free), share, x, **more)


def test_a_family_has_a_size_per_joint_and_is_a_list_of_effects():
    found = [screened("coulomb_friction", j, 0.2, (k + 1.0,)) for k, j in enumerate(JOINTS)]
    ((family, x),) = by_law(found, JOINTS)
    assert (family.place, x, len(family.coordinates)) == ("*", (1.0, 2.0, 3.0), 3)
    assert [c.label for c in family.coordinates] == [f"torque {j}" for j in JOINTS]
    specs = [term.spec for term in family.terms(x)]
    assert [(e.joint, e.torque) for e in from_list(specs)] == [
        ("hip", 0.2), ("knee", 0.4), ("ankle", 0.6000000000000001),
    ]  # fmt: skip


def test_shapes_are_those_of_each_joint():
    found = [screened("stribeck_friction", j, 0.2, (1.0, k * 1.0)) for k, j in enumerate(JOINTS)]
    ((family, x),) = by_law(found, JOINTS)
    speeds = [term.params["velocity"] for term in family.terms(x)]
    assert speeds[0] < speeds[1] < speeds[2]


def test_families_are_of_kinds_that_more_than_one_joint_may_show():
    one = [screened("coulomb_friction", "hip", 0.9), screened("coulomb_friction", "knee", 0.001)]
    assert by_law(one, JOINTS) == []
    dead = [screened("coulomb_friction", j, 0.2, dead=j != "hip") for j in JOINTS]
    assert by_law(dead, JOINTS) == []
    both = [screened("coulomb_friction", j, 0.1) for j in JOINTS]
    both += [screened("viscous_friction", j, 0.2) for j in JOINTS[:2]]
    ranked = by_law(both, JOINTS)
    assert [f.effect for f, _ in ranked] == ["viscous_friction", "coulomb_friction"]
    assert ranked[0][0].joints == JOINTS[:2]
    enough = by_law(both, JOINTS, 0.35)  # the other explains 0.3 in all joints together
    assert [f.effect for f, _ in enough] == ["viscous_friction"]


def test_a_family_in_fewer_joints_keeps_their_sizes_and_ends_in_the_effect_alone():
    found = [screened("coulomb_friction", j, 0.2, (k + 1.0,)) for k, j in enumerate(JOINTS)]
    ((family, x),) = by_law(found, JOINTS)
    offered = [one.hypothesis for one in found]
    two, at = restrict(family, x, ("hip", "ankle"), offered, JOINTS)
    assert (two.joints, two.place, at) == (("hip", "ankle"), "hip ankle", (1.0, 3.0))
    assert [t.spec for t in two.terms(at)] == [family.terms(x)[i].spec for i in (0, 2)]
    one, at = restrict(family, x, ("knee",), offered, JOINTS)
    assert (one, at) == (offered[1], (2.0,))
