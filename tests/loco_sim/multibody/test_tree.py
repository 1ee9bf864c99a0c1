# SPDX-License-Identifier: Apache-2.0
"""Links that are fixed to each other are one body, whatever the description looks like."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_sim.multibody import tree
from loco_sim.robot import robot
from loco_sim.robot.description import Description
from loco_sim.robot.frames import origin_of

from ..trees import random_urdf

SEEDS = range(6)


def built(urdf: str, joints: tuple[str, ...], free: bool = False):
    return tree.build(Description(urdf), joints, free)


@pytest.mark.parametrize("seed", SEEDS)
def test_no_mass_is_lost_and_joints_come_after_those_that_carry_them(seed):
    urdf, joints = random_urdf(seed)
    made, order, frames = built(urdf, joints, free=True)
    description = Description(urdf)
    links = {link: description.mass_of(link) for link in description.links()}
    assert made.body[:, tree.MASS].sum() == pytest.approx(sum(links.values()))
    assert np.all(made.kin[:, 0] < np.arange(len(made.kin)))
    assert sorted(order) == list(range(len(joints) + len(tree.FREE)))
    assert set(frames) == set(links)
    bodies = np.zeros(len(made.kin))
    for link, frame in frames.items():
        bodies[frame.body] += links[link]
    assert made.body[:, tree.MASS] == pytest.approx(bodies)


@pytest.mark.parametrize("seed", SEEDS)
def test_axes_have_length_1_and_turns_are_turns(seed):
    made, _, frames = built(*random_urdf(seed))
    axes = made.body[:, tree.AXIS : tree.AXIS + 3]
    assert np.linalg.norm(axes, axis=1) == pytest.approx(1.0)
    turns = [*made.body[:, tree.TURN : tree.TURN + 9].reshape(-1, 3, 3)]
    for turn in [*turns, *(frame.turn for frame in frames.values())]:
        assert turn @ turn.T == pytest.approx(np.eye(3), abs=1e-9)
        assert np.linalg.det(turn) == pytest.approx(1.0)


def test_two_halves_that_are_fixed_together_are_the_whole():
    """A rod of 2 kg is two of 1 kg, end to end: the same mass, centre and inertia."""

    def link(name: str, mass: float, at: float, side: float) -> str:
        return (
            f'<link name="{name}"><inertial><origin xyz="{at} 0 0"/><mass value="{mass}"/><inertia '
            f'ixx="0.001" iyy="{side}" izz="{side}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    def joint(name: str, kind: str, parent: str, child: str, at: float) -> str:
        return (
            f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{at} 0 0"/><axis xyz="0 1 0"/></joint>'
        )

    swing = '<robot name="r"><link name="base"/>' + joint("j", "continuous", "base", "rod", 0.0)
    whole = swing + link("rod", 2.0, 0.5, 2.0 / 12.0) + "</robot>"
    rod = link("rod", 1.0, 0.25, 0.25 / 12.0)
    more = link("more", 1.0, 0.25, 0.25 / 12.0)
    halves = swing + rod + more + joint("glue", "fixed", "rod", "more", 0.5) + "</robot>"
    one, two = (built(urdf, ("j",))[0].body[0] for urdf in (whole, halves))
    inertia = slice(tree.INERTIA + 4, tree.INERTIA + 9)  # about y and z; ixx is per link
    assert two[tree.MASS] == one[tree.MASS] == 2.0
    assert two[tree.COM : tree.COM + 3] == pytest.approx(one[tree.COM : tree.COM + 3])
    assert two[inertia] == pytest.approx(one[inertia])


def test_a_joint_that_is_not_listed_or_moves_nothing_is_refused():
    urdf, joints = random_urdf(0)
    with pytest.raises(ParameterError, match="must list all that move, and no others: joint_1"):
        built(urdf, joints[1:])
    name = "link_5"
    massless = re.sub(rf'(<link name="{name}">.*?<mass value=)"[^"]*"', r'\1"0"', urdf, flags=re.S)
    with pytest.raises(ParameterError, match="what joint joint_5 moves has no inertia"):
        built(massless, joints)
    odd = re.sub(rf'(<link name="{name}">.*?ixx=)"[^"]*"', r'\1"9"', urdf, flags=re.S)
    with pytest.raises(ParameterError, match="what joint joint_5 moves has no inertia"):
        built(odd, joints)


def test_rotors_belong_to_their_joints_whatever_the_order():
    plant = robot.load("hyq_leg")
    made, order, _ = built(plant.urdf, plant.joints)
    rotors = {joint: 0.1 * k for k, joint in enumerate(plant.joints, start=1)}
    felt = tree.geared(made, order, plant.joints, rotors).body[:, tree.ARMATURE]
    assert [rotors[plant.joints[i]] for i in order] == felt.tolist()
    assert not made.body[:, tree.ARMATURE].any()


@pytest.mark.parametrize(
    "rpy", [(0.3, 0.0, 0.0), (0.0, 0.3, 0.0), (0.0, 0.0, 0.3), (0.4, -1.1, 2.7)]
)
def test_angles_of_a_urdf_turn_about_fixed_axes_roll_first(rpy):
    def turn(axis: int, angle: float) -> np.ndarray:
        made, (a, b) = np.eye(3), [(axis + 1) % 3, (axis + 2) % 3]
        made[a, a] = made[b, b] = np.cos(angle)
        made[b, a], made[a, b] = np.sin(angle), -np.sin(angle)
        return made

    joint = ET.fromstring(f'<joint><origin xyz="1 2 3" rpy="{" ".join(map(str, rpy))}"/></joint>')
    found, place = origin_of(joint)
    assert place.tolist() == [1.0, 2.0, 3.0]
    assert found == pytest.approx(turn(2, rpy[2]) @ turn(1, rpy[1]) @ turn(0, rpy[0]))
    assert origin_of(ET.Element("joint"))[0].tolist() == np.eye(3).tolist()
