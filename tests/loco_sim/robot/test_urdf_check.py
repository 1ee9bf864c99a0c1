# SPDX-License-Identifier: Apache-2.0
"""A URDF that the engine would crash on or misread is refused in one line that names it."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import yaml

from loco_control.exceptions import ParameterError
from loco_control.types import MotionCommand
from loco_sim.mesh_files import mesh_path
from loco_sim.params import SimParams
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot, urdf_check
from loco_sim.world.world import World, make_world

from ...quadrupeds import DATA

BOX = '<box size="0.1 0.1 0.1"/>'
BODY = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    "</inertial><collision><geometry>" + BOX + "</geometry></collision>"
)
GOOD = f"""<robot name="two">
<link name="trunk">{BODY}</link>
<link name="arm">{BODY}</link>
<joint name="elbow" type="revolute"><parent link="trunk"/><child link="arm"/>
<origin xyz="0 0 -0.2" rpy="0 0 0"/><axis xyz="0 1 0"/>
<limit effort="3" velocity="9" lower="-1" upper="1"/></joint>
</robot>"""
BARE = '<link name="tip"/><joint name="end" type="fixed"><parent link="arm"/><child link="tip"/>'
WITH_TIP = GOOD.replace("</robot>", f"{BARE}</joint></robot>")
SECOND = '<joint name="wrist" type="{}"><parent link="{}"/><child link="{}"/></joint></robot>'


def added(text):
    return "</robot>", f"{text}</robot>"


HOSTILE = {  # what is replaced by what, and words of the message
    "not XML": ("</link>", "", "is not XML"),
    "not a robot": (GOOD, "<sdf/>", "starts with <robot>"),
    "xacro": (
        '<robot name="two">',
        '<robot name="two" xmlns:x="http://www.ros.org/wiki/xacro"><x:property name="a"/>',
        "is xacro",
    ),
    "no link": (GOOD, "<robot/>", "no <link>"),
    "link named twice": ('"arm"', '"trunk"', "2 links are named 'trunk'"),
    "joint named twice": (
        *added('<joint name="elbow" type="fixed"><parent link="arm"/></joint>'),
        "2 joints are named 'elbow'",
    ),
    "link without a name": ('<link name="arm">', "<link>", "a <link> has no name"),
    "unknown parent": ('parent link="trunk"', 'parent link="torso"', "'elbow'.*parent 'torso'"),
    "unknown child": ('child link="arm"', 'child link="hand"', "'elbow'.*child 'hand'"),
    "no child": ('<child link="arm"/>', "", "'elbow' has no <child"),
    "its own parent": ('parent link="trunk"', 'parent link="arm"', "'elbow'.*'arm' its own parent"),
    "two parents": ("</robot>", SECOND.format("fixed", "trunk", "arm"), "'arm' has two parents"),
    "ring": ("</robot>", SECOND.format("fixed", "arm", "trunk"), "'trunk', 'arm' carry each other"),
    "two roots": (*added(f'<link name="far">{BODY}</link>'), "'trunk', 'far' hang on nothing"),
    "floating joint": ("revolute", "floating", "'elbow' is of type 'floating'"),
    "no type": (' type="revolute"', "", "'elbow' is of type None"),
    "mass NaN": ('mass value="1"', 'mass value="nan"', "'trunk': its mass .* 'nan'"),
    "mass negative": ('mass value="1"', 'mass value="-1"', "'trunk': its mass .* '-1'"),
    "mass infinite": ('mass value="1"', 'mass value="inf"', "'trunk': its mass .* 'inf'"),
    "mass a word": ('mass value="1"', 'mass value="heavy"', "'trunk': its mass .* 'heavy'"),
    "mass of a star": ('mass value="1"', 'mass value="1e300"', "'trunk': its mass .* '1e300'"),
    "mass that only Python reads": ('mass value="1"', 'mass value="1_0"', "its mass .* '1_0'"),
    "no inertia": (BODY, BODY[: BODY.index("<inertia ")] + BODY[BODY.index("</inertial>") :],
                   "'trunk': its <inertial> has no <inertia>"),
    "no axis": ('axis xyz="0 1 0"', 'axis x="0 1 0"', "'elbow': the axis None"),
    "damping infinite": ("<limit", '<dynamics damping="inf"/><limit', "'elbow': damping .* 'inf'"),
    "inertia NaN": ('ixx="0.1"', 'ixx="nan"', "'trunk': ixx of its inertia"),
    "inertia negative": ('iyy="0.1"', 'iyy="-0.1"', "'trunk': its inertia is not positive"),
    "inertia of no body": ('izz="0.1"', 'izz="0.3"', "exceeds the sum of the others"),
    "off-diagonal too large": ('ixy="0"', 'ixy="0.2"', "'trunk': its inertia is not positive"),
    "moves without mass": (f'"arm">{BODY}', '"arm">', "'arm' moves but has no mass"),
    "floats without mass": (f'"trunk">{BODY}', '"trunk">', "'trunk' is the root"),
    "effort a word": ('effort="3"', 'effort="strong"', "'elbow': effort .* 'strong'"),
    "effort negative": ('effort="3"', 'effort="-3"', "'elbow': effort .* '-3'"),
    "velocity NaN": ('velocity="9"', 'velocity="nan"', "'elbow': velocity"),
    "limits no numbers": ('lower="-1"', 'lower="low"', "'elbow': its limits 'low'"),
    "no limits": ('<limit effort="3" velocity="9" lower="-1" upper="1"/>', "",
                  "'elbow' is of type 'revolute' and needs a <limit>"),
    "limits crossed": ('lower="-1"', 'lower="2"', "lower limit 2 is above its upper limit 1"),
    "axis of no length": ('axis xyz="0 1 0"', 'axis xyz="0 0 0"', "'elbow': an axis of length 0"),
    "axis of two numbers": ('axis xyz="0 1 0"', 'axis xyz="0 1"', "'elbow': the axis '0 1'"),
    "origin NaN": ('xyz="0 0 -0.2"', 'xyz="0 0 nan"', "'elbow': xyz '0 0 nan'"),
    "box of no size": ("0.1 0.1 0.1", "0.1 0 0.1", "'trunk': size of its box"),
    "no geometry": (BOX, "", "'trunk': its <collision> needs a <geometry>"),
    "missing mesh": (BOX, '<mesh filename="a.stl"/>', "no mesh file 'a.stl'"),
    "mesh of a name too long": (BOX, f'<mesh filename="{"9" * 400}"/>', "no mesh file '999"),
    "unknown mesh": (BOX, '<mesh filename="r.urdf"/>', "of kind '.urdf'"),
    "cut mesh": (BOX, '<mesh filename="cut.stl"/>', "cut.stl is cut off"),
    "missing package": (
        BOX, '<mesh filename="package://p/a.stl"/>', "package://p/a.stl"
    ),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """Function that writes a robot folder with a URDF and gives its path."""
    (tmp_path / "cut.stl").write_bytes(bytes(80) + (9).to_bytes(4, "little") + bytes(50))

    def make(urdf):
        (tmp_path / "r.urdf").write_text(urdf)
        (tmp_path / "robot.yaml").write_text(
            yaml.safe_dump({"urdf": "r.urdf", "joints": ["elbow"]})
        )
        return tmp_path

    return make


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_urdf_is_refused_in_one_line_that_names_it(folder, name):
    old, new, words = HOSTILE[name]
    assert old in GOOD
    with pytest.raises(ParameterError) as caught:
        robot.load(folder(GOOD.replace(old, new, 1)))
    message = str(caught.value)
    assert re.search(words, message)
    assert "r.urdf" in message
    assert "\n" not in message


def test_the_good_one_is_simulated(folder):
    path = folder(GOOD)
    (path / "robot.yaml").write_text(
        yaml.safe_dump({"urdf": "r.urdf", "joints": ["elbow"], "drives": {"*": {"kind": "torque"}}})
    )
    with Simulation(robot=str(path)) as plant:
        assert plant.step(MotionCommand(0, 0.0, np.zeros(1), np.zeros(1))).t > 0.0


def test_a_mass_matrix_without_inverse_is_one_error_of_ours(folder, monkeypatch):
    monkeypatch.setattr(World, "joint_inertia", lambda self, q: np.zeros((1, 1)))
    path = folder(GOOD)
    values = {"urdf": "r.urdf", "joints": ["elbow"], "drives": {"*": {"kind": "torque"}}}
    (path / "robot.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(ParameterError, match="masses and inertias too far apart"):
        Simulation(robot=str(path))


def test_how_many_more_problems_there_are_is_said(folder):
    with pytest.raises(ParameterError, match=r"\(and 1 more\)"):
        robot.load(folder(GOOD.replace('mass value="1"', 'mass value="-1"')))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_masses_of_dust_are_placeholders_unless_one_link_weighs_something(folder, share):
    """An exporter writes 1e-9 kg where no part has a material; a small tip may weigh as little."""
    urdf = GOOD.replace('mass value="1"', 'mass value="1e-9"')
    if share:
        assert robot.load(folder(urdf.replace("1e-9", "1", 1))).joints == ("elbow",)
        return
    with pytest.raises(ParameterError, match="weighs 1e-09 kg: its masses are placeholders"):
        robot.load(folder(urdf))


def test_links_fixed_to_others_need_neither_mass_nor_inertia(folder):
    made = robot.load(folder(WITH_TIP))
    assert made.joints == ("elbow",)


def test_a_link_without_inertia_weighs_nothing_in_the_engine(folder):
    """The engine alone would give it 1 kg and 1 kg m²."""
    felt = []
    for urdf in (GOOD, WITH_TIP):
        world = make_world(robot.load(folder(urdf)), SimParams(), 0.001)
        world.rebuild([0.0], height=1.0)
        felt.append(float(world.joint_inertia([0.0])[0, 0]))
        world.close()
    assert felt[0] == pytest.approx(felt[1], rel=1e-9)


def test_a_mesh_of_a_package_is_found_above_the_urdf(tmp_path, monkeypatch):
    mesh = tmp_path / "ant_description" / "meshes" / "leg.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_bytes(b"")
    (tmp_path / "ant_description" / "package.xml").write_text("<package/>")
    (tmp_path / "ant_description" / "urdf").mkdir()
    inside = tmp_path / "ant_description" / "urdf"
    assert mesh_path("package://ant_description/meshes/leg.stl", inside) == mesh
    assert mesh_path("package://another_name/meshes/leg.stl", inside) == mesh
    assert mesh_path("package://ant_description/meshes/arm.stl", inside) is None
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    shared = tmp_path / "share" / "bee" / "wing.stl"
    shared.parent.mkdir(parents=True)
    shared.write_bytes(b"")
    assert mesh_path("package://bee/wing.stl", Path("/")) == shared
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain" / "leg.stl").write_bytes(b"")
    found = mesh_path("package://fly/leg.stl", tmp_path / "plain")
    assert found == tmp_path / "plain" / "leg.stl"
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    assert mesh_path("package://ant_description/meshes/leg.stl", Path("/")) == mesh


@pytest.mark.parametrize(
    ("tensor", "words"),
    [
        ([1.0, 0.0, 0.0, 1.0, 0.0, 2.0], ""),  # a thin plate: the limit of what a body can have
        ([1.0, 0.0, 0.0, 1.0, 0.0, 2.1], "exceeds the sum"),
        ([0.0, 0.0, 0.0, 1.0, 0.0, 1.0], ""),  # a rod
        ([0.0] * 6, "no inertia"),
        ([-1.0, 0.0, 0.0, -1.0, 0.0, -1.0], "negative"),
        ([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0], "negative"),
        ([1.0, 0.0, 0.0, 2.0, 0.0, 4.0], "inertia 1, 2 and 4 kg"),
        ([-2e-9, 0.0, 0.0, 1e-3, 0.0, 1e-3], "not positive"),  # of small bodies, too
        ([1e-3, 0.0, 0.0, 1e-3, 0.0, 2.1e-3], "exceeds the sum"),
    ],
)
def test_what_a_tensor_lacks_to_be_that_of_a_body(tensor, words):
    fault = urdf_check.inertia_fault(tensor)
    assert (words in fault) if words else fault == ""


@pytest.mark.parametrize("name", ["a1/a1", "aliengo/aliengo", "r2d2", "franka_panda/panda"])
def test_robots_of_others_pass(name):
    path = DATA / f"{name}.urdf"
    assert list(urdf_check.problems(ET.parse(path).getroot(), path.parent)) == []


def told(urdf, folder=Path(), bolted=False):
    """Problems of a text, as one."""
    return "; ".join(urdf_check.problems(urdf_check.parse(urdf), folder, bolted))


ZERO = 'ixx="0" iyy="0" izz="0"'


def test_a_link_that_moves_needs_inertia_one_that_is_fixed_does_not():
    some = 'ixx="0.1" iyy="0.1" izz="0.1"'
    moving = GOOD.replace(f"{some} ixy", f"{ZERO} ixy")
    assert told(moving).count("it has mass but no inertia") == 2
    tip = f'<link name="tip">{BODY.replace(some, ZERO)}</link>'
    fixed = WITH_TIP.replace('<link name="tip"/>', tip)
    assert told(fixed) == ""
    wrong = fixed.replace(ZERO, 'ixx="-0.1" iyy="0.1" izz="0.1"')
    assert "'tip'" in told(wrong) and "a moment of -0.1 kg" in told(wrong)


@pytest.mark.parametrize("said", ["", '<mass value="nan"/>', "<mass/>", '<mass value="heavy"/>'])
def test_what_has_no_mass_that_is_a_number_weighs_nothing(said):
    link = ET.fromstring(f"<link><inertial>{said}</inertial></link>")
    assert urdf_check.mass_of(link) == 0.0
    assert urdf_check.mass_of(ET.fromstring("<link/>")) == 0.0


def test_moments_may_be_negative_by_what_is_rounded_off():
    share = urdf_check.ROUNDING
    assert urdf_check.inertia_fault([-share, 0.0, 0.0, 1.0, 0.0, 1.0]) == ""
    fault = urdf_check.inertia_fault([-2.0 * share, 0.0, 0.0, 1.0, 0.0, 1.0])
    assert fault.endswith("a moment of -2e-06 kg·m²")


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('<sphere radius="0"/>', ""),  # a toe
        ('<sphere radius="-1"/>', "radius of its sphere must be above 0, got '-1'"),
        ('<sphere radius="wide"/>', "radius of its sphere"),
        ('<box size="1 0 1"/>', "size of its box"),
        ('<cylinder radius="0" length="1"/>', "radius of its cylinder"),
    ],
)
def test_only_a_sphere_may_be_a_point(body, words):
    found = told(GOOD.replace(BOX, body, 1))
    assert (words in found) if words else found == ""


@pytest.mark.parametrize("scale", ["1 0 1", "1 1", "a b c"])
def test_a_mesh_has_three_scales_that_are_not_0(tmp_path, scale):
    (tmp_path / "foot.stl").write_bytes(stl(1))
    mesh = f'<mesh filename="foot.stl" scale="{scale}"/>'
    assert told(GOOD.replace(BOX, mesh, 1), tmp_path).count(f"the scale {scale!r}") == 1


def stl(triangles, header=b"", short=0):
    """A binary file, `short` bytes too short."""
    data = header.ljust(80) + triangles.to_bytes(4, "little") + bytes(50 * triangles)
    return data[: len(data) - short]


ASCII = b"solid foot\n facet normal 0 0 1\n vertex 0 0 0 vertex 1 0 0 vertex 0 1 0\n endfacet\n"


@pytest.mark.parametrize(
    ("content", "whole"),
    [
        (stl(1), True),
        (stl(300), True),
        (stl(1, b"solid of some program"), True),  # only texts have facets
        (stl(1, b"made of facets"), True),
        (stl(1, short=1), False),
        (stl(300, short=50), False),
        (stl(0), False),
        (b"", False),
        (ASCII + b"endsolid foot\n", True),
        (ASCII, False),
    ],
)
def test_a_mesh_that_is_cut_off_is_refused(tmp_path, content, whole):
    (tmp_path / "foot.stl").write_bytes(content)
    found = told(GOOD.replace(BOX, '<mesh filename="foot.stl"/>', 1), tmp_path)
    assert found == "" if whole else "foot.stl" in found and ("is cut off" in found or "no f" in found)


LEAST, MOST = f"{urdf_check.SMALLEST!r}", f"{urdf_check.LARGEST!r}"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('mass value="1"', f'mass value="{LEAST}"', ""),
        ('mass value="1"', f'mass value="{MOST}"', ""),
        ('mass value="1"', 'mass value="0.9e-12"', "its mass must be"),
        ('mass value="1"', 'mass value="1.1e9"', "its mass must be"),
        ('ixx="0.1" iyy="0.1" izz="0.1"', f'ixx="{MOST}" iyy="{MOST}" izz="{MOST}"', ""),
        ('ixx="0.1"', 'ixx="1.1e9"', "ixx of its inertia must be"),
        ('lower="-1" upper="1"', 'lower="0.5" upper="0.5"', ""),
        ('lower="-1" upper="1"', 'lower="0.6" upper="0.5"', "is above its upper limit"),
        ('effort="3"', 'effort="inf"', ""),
        ('effort="3"', 'effort="-1"', "effort must be a number of at least 0"),
        ("<axis", f'<dynamics damping="{MOST}"/><axis', ""),
        ("<axis", '<dynamics damping="inf"/><axis', "damping must be a number"),
        ("<axis", '<dynamics friction="-1"/><axis', "friction must be a number"),
        ('axis xyz="0 1 0"', 'axis xyz="0 1e-8 0"', ""),
        ('origin xyz="0 0 -0.2"', f'origin xyz="0 0 {MOST}"', ""),
        ('origin xyz="0 0 -0.2"', 'origin xyz="0 0 1.1e9"', "of an origin is not three numbers"),
        ('axis xyz="0 1 0"', 'axis xyz="0 1e-10 0"', "points nowhere"),
    ],
)
def test_limits_belong_to_what_is_allowed(old, new, words):
    assert old in GOOD
    found = told(GOOD.replace(old, new, 1))
    assert (words in found) if words else found == ""


def test_one_link_is_a_robot_and_one_problem_is_not_more():
    assert told(f'<robot name="stone"><link name="stone">{BODY}</link></robot>') == ""
    assert told("<robot/>") == "there is no <link>"
    with pytest.raises(ParameterError) as caught:
        urdf_check.check("<robot/>", Path(), "r.urdf")
    assert str(caught.value) == "r.urdf: there is no <link>"


def test_a_root_without_mass_is_for_a_robot_that_is_bolted():
    rootless = GOOD.replace(BODY, "", 1)
    assert "is not bolted but has no mass" in told(rootless)
    assert told(rootless, bolted=True) == ""
    urdf_check.check(rootless, Path(), "r.urdf", bolted=True)
    with pytest.raises(ParameterError, match="r.urdf: link 'trunk' is the root"):
        urdf_check.check(rootless, Path(), "r.urdf")
