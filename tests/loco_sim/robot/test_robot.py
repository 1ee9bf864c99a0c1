# SPDX-License-Identifier: Apache-2.0
"""Robots are read from their folders and checked against their URDF."""

from importlib import resources

import numpy as np
import pytest
import yaml
from tests.quadrupeds import joint_limits

from loco_control.exceptions import LocoError, MissingFileError, NameUnknownError, ParameterError
from loco_control.legs.geometry import LegGeometry
from loco_control.legs.kinematics import foot_position
from loco_control.names import FEET, JOINTS
from loco_sim.bolted.loop import Bolted, needs_engine
from loco_sim.robot import frames, robot
from loco_sim.robot.description import Description
from loco_workshop.make_urdf import hyq as hyq_urdf

ONE_JOINT = """<robot name="bench"><link name="world_link"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="world_link"/><child link="arm"/>
<axis xyz="0 1 0"/><limit effort="3" velocity="9" lower="-1" upper="1"/></joint></robot>"""


@pytest.fixture
def folder(tmp_path):
    """Function that writes a robot folder and gives its path."""

    def make(urdf=ONE_JOINT, text=None, **values):
        (tmp_path / "bench.urdf").write_text(urdf)
        listed = {"urdf": "bench.urdf", "joints": ["elbow"], "fixed_base": True, **values}
        (tmp_path / "robot.yaml").write_text(text or yaml.safe_dump(listed))
        return tmp_path

    return make


def test_hyq_has_the_joints_and_feet_of_the_controllers(hyq):
    assert hyq.joints == JOINTS
    assert hyq.feet == FEET
    assert set(hyq.effort) == {150.0}
    assert "hyq" in robot.names()


def test_hyq_weighs_what_the_model_of_its_makers_weighs(hyq):
    assert Description(hyq.urdf).mass() == pytest.approx(84.756, abs=1e-9)


def test_hyq_stands_on_the_foot_centres_of_the_gait(hyq):
    feet = np.array([[x, y, -0.6] for x in (0.375, -0.375) for y in (0.28, -0.28)])
    np.testing.assert_allclose(foot_position(hyq.standing), feet, atol=1e-6)


def test_the_joint_limits_of_hyq_are_those_of_the_kinematics(hyq):
    import xml.etree.ElementTree as ET

    limits = {
        j.get("name"): (float(j.find("limit").get("lower")), float(j.find("limit").get("upper")))
        for j in ET.fromstring(hyq.urdf).findall("joint")
        if j.find("limit") is not None
    }
    low, high = joint_limits(LegGeometry())
    np.testing.assert_allclose([limits[j] for j in JOINTS], np.stack([low, high], axis=1))


def test_the_urdfs_of_hyq_are_those_that_their_module_writes():
    assets = resources.files("loco_sim") / "assets"
    for name, written in (("hyq", hyq_urdf.write()), ("hyq_leg", hyq_urdf.write_leg())):
        file = assets / name / f"{name}.urdf"
        assert file.read_text() == written, "run loco_workshop.make_urdf.hyq"


def test_the_urdf_follows_the_leg_geometry():
    longer = LegGeometry(thigh_length=0.4)
    assert hyq_urdf.write(longer) != hyq_urdf.write()
    assert 'xyz="0.4 0 0"' in hyq_urdf.write(longer)


def test_any_robot_can_be_read_from_a_folder(folder):
    bench = robot.load(folder(fixed_base=True, height=0.2, fall={"roll": 1.0}))
    assert bench.joints == ("elbow",)
    assert bench.feet == ()
    assert bench.fixed_base
    assert bench.height == 0.2
    assert bench.fall.roll == 1.0
    np.testing.assert_array_equal(bench.standing, [0.0])
    np.testing.assert_array_equal(bench.effort, [3.0])


@pytest.mark.parametrize(("stated", "base"), [({}, 1.0), ({"height": 0.2}, 0.2)])
def test_a_bolted_robot_hangs_above_the_ground_unless_a_height_is_stated(folder, stated, base):
    ball = '<origin xyz="0 0 -0.5"/><geometry><sphere radius="0.4"/></geometry>'
    urdf = ONE_JOINT.replace("</link>", f"<collision>{ball}</collision></link>", 1)
    bench = robot.load(folder(urdf, drives={"*": {"kind": "torque"}}, **stated))
    assert bench.height == base
    assert bool(needs_engine(bench)) == bool(stated)


def test_an_unknown_robot_lists_those_that_exist():
    with pytest.raises(NameUnknownError, match="available: hyq"):
        robot.load("hyqq")


def test_a_folder_without_a_robot_is_missing(tmp_path):
    with pytest.raises(MissingFileError, match="robot.yaml"):
        robot.load(tmp_path)


def test_a_missing_urdf_is_named(folder):
    with pytest.raises(MissingFileError, match="nowhere.urdf"):
        robot.load(folder(urdf=ONE_JOINT, text="urdf: nowhere.urdf\njoints: [elbow]\n"))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"joints": ["knee"]}, "knee"),
        ({"feet": ["toe"]}, "toe"),
        ({"colour": "red"}, "colour"),
        ({"fall": {"yaw": 1.0}}, "yaw"),
    ],
)
def test_names_that_do_not_exist_are_refused(folder, values, message):
    with pytest.raises(NameUnknownError, match=message):
        robot.load(folder(**values))


@pytest.mark.parametrize(
    "change",
    [{"standing": [0.0, 1.0]}, {"text": "urdf: [\n"}, {"text": "- a\n"}, {"fall": {"roll": -1.0}}],
)
def test_values_that_do_not_fit_are_refused(folder, change):
    with pytest.raises(ParameterError):
        robot.load(folder(**change))


FINGER = """<link name="tip"><inertial><mass value="0.2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="wrist" type="{kind}"><parent link="arm"/><child link="tip"/>
<origin xyz="0.1 0 0.2" rpy="0.3 0 0.5"/><axis xyz="0 0.6 0.8"/>
<limit effort="3" velocity="9" lower="-1" upper="1"/></joint></robot>"""
DRIVE = {"kind": "impedance", "kp": 10.0, "kd": 1.0}


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("joints", [["elbow"], ["wrist", "elbow"]])
def test_a_locked_joint_stays_where_it_is_as_a_part_of_its_link(folder, kind, joints):
    urdf = ONE_JOINT.replace("</robot>", FINGER.format(kind=kind))
    both = {"urdf": urdf, "joints": joints, "standing": [0.4] * len(joints),
            "drives": {"*": DRIVE}, "height": 2.0}  # fmt: skip
    free = robot.load(folder(**{**both, "joints": ["wrist", "elbow"], "standing": [0.4, 0.4]}))
    fixed = robot.load(folder(**both, locked={"wrist": 0.7}))
    assert (fixed.joints, list(fixed.drives), list(fixed.effort)) == (("elbow",), ["elbow"], [3.0])
    assert fixed.standing == [0.4] and fixed.mass == free.mass
    q = np.linspace(-1.0, 1.0, 5)[:, None]
    moved = frames.link_frames(free, np.hstack([np.full_like(q, 0.7), q]))["tip"]
    for got, wanted in zip(frames.link_frames(fixed, q)["tip"], moved, strict=True):
        assert np.allclose(got, wanted, atol=1e-9)
    assert not needs_engine(fixed)
    whole = Bolted(free).inertia(np.array([0.7, 0.4]))
    assert Bolted(fixed).inertia(np.array([0.4]))[0, 0] == pytest.approx(whole[1, 1], rel=1e-9)


def test_what_follows_a_locked_joint_is_locked_too(folder):
    urdf = ONE_JOINT.replace("</robot>", FINGER.format(kind="revolute"))
    follows = '<mimic joint="elbow" multiplier="2" offset="0.1"/></joint></robot>'
    made = folder(urdf=urdf.replace("</joint></robot>", follows), joints=["elbow", "wrist"])
    values = yaml.safe_load((made / "robot.yaml").read_text())
    (made / "robot.yaml").write_text(yaml.safe_dump({**values, "locked": {"elbow": 0.3}}))
    fixed = robot.load(made)
    assert fixed.joints == () and not Description(fixed.urdf).joint_types()
    free = robot.load(folder(urdf=urdf, joints=["elbow", "wrist"]))
    got = frames.link_frames(fixed, np.zeros((1, 0)))["tip"]
    wanted = frames.link_frames(free, np.array([[0.3, 0.7]]))["tip"]
    for a, b in zip(got, wanted, strict=True):
        assert np.allclose(a, b, atol=1e-9)


@pytest.mark.parametrize(("factor", "angle"), [(2.0, 0.7), (-1.0, -0.2)])
def test_what_follows_a_listed_joint_and_is_not_listed_is_held_where_it_stands(
    folder, factor, angle
):
    urdf = ONE_JOINT.replace("</robot>", FINGER.format(kind="revolute"))
    follows = f'<mimic joint="elbow" multiplier="{factor}" offset="0.1"/></joint></robot>'
    led = urdf.replace("</joint></robot>", follows)
    values = {"standing": [0.3], "drives": {"elbow": DRIVE}, "height": 2.0}
    bench, held = (robot.load(folder(urdf=text, **values, **locked))
                   for text, locked in ((led, {}), (urdf, {"locked": {"wrist": angle}})))  # fmt: skip
    assert bench.joints == ("elbow",) and not needs_engine(bench)
    chosen = robot.load(folder(urdf=led, **values, locked={"wrist": 0.0}))
    q = np.array([[0.3]])
    got, wanted, another = (frames.link_frames(x, q)["tip"] for x in (bench, held, chosen))
    assert all(map(np.allclose, got, wanted)) and not all(map(np.allclose, got, another))


@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
@pytest.mark.parametrize("factor", [1.0, -2.0])
def test_the_leader_moves_the_inertia_of_a_joint_that_follows_it_and_is_held(folder, kind, factor):
    """As the second finger of a gripper: of a motion (1, k) the inertia is M11 + k² M22."""
    finger = FINGER.format(kind=kind).replace('"arm"/><child', '"world_link"/><child')
    urdf = ONE_JOINT.replace("</robot>", finger)
    led = urdf.replace(
        "</joint></robot>", f'<mimic joint="elbow" multiplier="{factor}"/></joint></robot>'
    )
    values = {"drives": {"elbow": DRIVE}, "height": 2.0}
    held = robot.load(folder(led, dynamics={"elbow": {"armature": 0.03}}, **values))
    both = robot.load(folder(urdf, **{**values, "joints": ["elbow", "wrist"]}))
    first, second = np.diag(Bolted(both).inertia(np.zeros(2)))
    wanted = first + 0.03 + factor**2 * second
    assert Bolted(held).inertia(np.zeros(1))[0, 0] == pytest.approx(wanted, rel=1e-9)


def test_a_mesh_that_is_missing_matters_only_to_a_robot_that_may_touch_something(folder):
    mesh = '<collision><geometry><mesh filename="package://a/b.stl"/></geometry></collision></link>'
    urdf = ONE_JOINT.replace("</link>", mesh)
    drives = {"*": {"kind": "torque"}}
    hangs = robot.load(folder(urdf, drives=drives))
    plain = robot.load(folder(ONE_JOINT, drives=drives))
    assert not needs_engine(hangs) and hangs.mass == plain.mass and "<mesh" not in hangs.urdf
    with pytest.raises(ParameterError, match="no mesh file"):
        robot.load(folder(urdf, drives=drives, feet=["arm"]))


@pytest.mark.parametrize(("written", "limit"), [("0", np.inf), ("0.0", np.inf), ("3", 3.0)])
def test_a_drive_with_an_effort_limit_of_0_has_no_limit(folder, written, limit):
    urdf = ONE_JOINT.replace('effort="3"', f'effort="{written}"')
    assert robot.load(folder(urdf, drives={"elbow": DRIVE})).effort == [limit]
    passive = robot.load(folder(urdf))
    assert passive.effort == [float(written)]  # nothing drives it


@pytest.mark.parametrize(
    ("locked", "message"),
    [({"toe": 0.0}, "toe"), ({"elbow": "x"}, "position"), (["elbow"], "position")],
)
def test_what_cannot_be_locked_is_one_line(folder, locked, message):
    with pytest.raises(LocoError, match=message):
        robot.load(folder(locked=locked))


def test_the_joint_of_a_leg_cannot_be_locked(tmp_path, hyq):
    for file in hyq.folder.iterdir():
        (tmp_path / file.name).write_bytes(file.read_bytes())
    text = (tmp_path / "robot.yaml").read_text()
    (tmp_path / "robot.yaml").write_text(f"{text}\nlocked: {{{JOINTS[0]}: 0.0}}\n")
    with pytest.raises(ParameterError, match=f"{JOINTS[0]} is a joint of a leg"):
        robot.load(tmp_path)
