# SPDX-License-Identifier: Apache-2.0
"""A URDF can be read and edited by name, and point masses add up as in mechanics."""

import math

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_sim.robot.description import Description, add_point_mass

BENCH = """<robot name="bench">
  <link name="stand"><inertial><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0.1 0 0" rpy="0 0 1"/><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><mesh filename="arm.stl"/></geometry></visual></link>
  <link name="tip"/>
  <joint name="elbow" type="revolute"><parent link="stand"/><child link="arm"/>
    <dynamics damping="0.2"/><limit effort="3" velocity="1" lower="-1" upper="1"/></joint>
  <joint name="wheel" type="continuous"><parent link="arm"/><child link="tip"/></joint>
</robot>"""


def inertia_of(masses, points):
    """Mass, centre and inertia of point masses, straight from the definitions."""
    masses, points = np.array(masses), np.array(points, dtype=float)
    centre = masses @ points / masses.sum()
    arms = points - centre
    arms_of = zip(masses, arms, strict=True)
    tensor = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in arms_of)
    return masses.sum(), centre, tensor


def test_adding_a_point_mass_agrees_with_the_definition_of_inertia():
    rng = np.random.default_rng(1)
    masses, points = rng.uniform(0.1, 2.0, 5), rng.standard_normal((5, 3))
    body = inertia_of(masses[:4], points[:4])
    got = add_point_mass(*body, masses[4], points[4])
    for mine, exact in zip(got, inertia_of(masses, points), strict=True):
        np.testing.assert_allclose(mine, exact, atol=1e-12)


def test_adding_nothing_changes_no_bit():
    com, inertia = np.array([0.1, 0.2, 0.3]), np.diag([1.0, 2.0, 2.5])
    mass, new_com, new_inertia = add_point_mass(3.3, com, inertia, 0.0, np.ones(3))
    assert mass == 3.3
    np.testing.assert_array_equal(new_com, com)
    np.testing.assert_array_equal(new_inertia, inertia)


def test_a_description_answers_by_name():
    bench = Description(BENCH)
    assert bench.links() == ["stand", "arm", "tip"]
    assert bench.root_link() == "stand"
    assert bench.efforts() == {"elbow": 3.0, "wheel": math.inf}
    assert bench.damping("elbow") == 0.2
    assert bench.damping("wheel") == 0.0
    assert bench.mass() == 3.0


def test_a_mass_on_a_link_is_in_the_text():
    bench = Description(BENCH)
    bench.add_mass("stand", 2.0, (0.0, 0.0, 1.0))
    again = Description(bench.text())
    assert again.mass() == 5.0
    assert 'xyz="0.0 0.0 0.5"' in bench.text()


def test_meshes_are_found_from_the_folder_only_when_asked(tmp_path):
    assert 'filename="arm.stl"' in Description(BENCH).text()
    assert str(tmp_path / "arm.stl") in Description(BENCH).text(tmp_path)


def test_an_unknown_name_lists_those_that_exist():
    with pytest.raises(NameUnknownError, match="available: elbow, wheel"):
        Description(BENCH).damping("knee")


def test_a_link_without_inertia_cannot_be_given_more():
    with pytest.raises(ParameterError, match="tip"):
        Description(BENCH).add_mass("tip", 1.0, (0.0, 0.0, 0.0))


TURNED = """<robot name="r"><link name="a"><inertial>
<origin xyz="0.1 0 0" rpy="0 0 1.5707963267948966"/><mass value="2"/>
<inertia ixx="1" iyy="2" izz="2.5" ixy="0.1" ixz="0" iyz="0"/></inertial></link>
</robot>"""  # a quarter turn about z: x becomes y


def test_an_inertia_along_turned_axes_is_turned_into_those_of_the_link():
    description = Description(TURNED)
    inertia = description.inertia_of("a")
    np.testing.assert_allclose(
        inertia, [[2.0, -0.1, 0.0], [-0.1, 1.0, 0.0], [0.0, 0.0, 2.5]], atol=1e-12
    )
    assert "rpy" not in description.text()  # so that nobody turns it again
    np.testing.assert_array_equal(Description(description.text()).inertia_of("a"), inertia)


@pytest.mark.parametrize("axis", [(0, 1, 0), (1, 1, 0), (0.3, -0.2, 0.9)])
def test_an_armature_counts_in_full_about_its_axis_whatever_that_is(axis):
    joint = '<link name="b"/><joint name="j" type="continuous"><parent link="b"/><child link="a"/>'
    text = f'{joint}<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/></joint></robot>'
    description = Description(TURNED.replace("</robot>", text))
    before = description.inertia_of("a")
    description.add_armature("j", 0.5)
    along = np.array(axis) / np.linalg.norm(axis)
    added = description.inertia_of("a") - before
    assert along @ added @ along == pytest.approx(0.5, rel=1e-9)
    assert np.linalg.eigvalsh(added)[0] > 0.0


@pytest.mark.parametrize("text", ["<robot", "<model/>"])
def test_what_is_not_a_urdf_is_refused(text):
    with pytest.raises(ParameterError):
        Description(text)


def test_the_engine_hears_nothing_of_contacts_in_the_urdf(tmp_path):
    urdf = "<robot name='r'><link name='a'><contact><friction_anchor/></contact></link></robot>"
    description = Description(urdf)
    assert "friction_anchor" in description.text()
    assert "contact" not in description.text(tmp_path)
