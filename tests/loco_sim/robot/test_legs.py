# SPDX-License-Identifier: Apache-2.0
"""Legs are read from any URDF: the closed form agrees with the URDF's own kinematics."""

import numpy as np
import pytest
import yaml

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.gait import similarity
from loco_control.gait.generator import TargetGenerator
from loco_control.legs.geometry import FRONT, HYQ, KNEE, LEFT
from loco_control.legs.kinematics import foot_position, joint_position
from loco_control.names import LEGS
from loco_sim.robot import robot as robots
from loco_sim.robot.frames import feet_in_base
from loco_sim.robot.legs import swung_mass

NAMES = ("a1", "aliengo", "laikago", "mini_cheetah", "spirit40", "vision60")
BODY = """<inertial><mass value="9"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = '<robot name="box"><link name="base">{body}</link>{legs}</robot>'
LEG = """
<link name="{n}_a">{body}</link><link name="{n}_b">{body}</link><link name="{n}_c">{body}</link>
<link name="{n}_foot"/>
<joint name="{n}_haa" type="continuous"><parent link="base"/><child link="{n}_a"/>
  <origin xyz="{x} {y} 0"/><axis xyz="{axis}"/></joint>
<joint name="{n}_hfe" type="continuous"><parent link="{n}_a"/><child link="{n}_b"/>
  <axis xyz="0 1 0"/></joint>
<joint name="{n}_kfe" type="continuous"><parent link="{n}_b"/><child link="{n}_c"/>
  <origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/></joint>
<joint name="{n}_end" type="fixed"><parent link="{n}_c"/><child link="{n}_foot"/>
  <origin xyz="0 0 -0.3"/></joint>
"""


def box(folder, axis="1 0 0", forward=1.0, **changes):
    """A robot of boxes with one HAA axis for all legs; its legs may be changed."""
    places = {leg: (forward * f, s) for leg, f, s in zip(LEGS, FRONT, LEFT, strict=True)}
    legs = (
        LEG.format(n=n, body=BODY, axis=axis, x=0.3 * x, y=0.2 * y) for n, (x, y) in places.items()
    )
    (folder / "box.urdf").write_text(URDF.format(body=BODY, legs="".join(legs)))
    parts = {leg: {k: f"{leg}_{k}" for k in ("haa", "hfe", "kfe", "foot")} for leg in places}
    for leg, change in changes.items():
        parts[leg] = {**parts[leg], **change}
    joints = [parts[leg][k] for leg in parts for k in ("haa", "hfe", "kfe")]
    (folder / "robot.yaml").write_text(f"urdf: box.urdf\njoints: {joints}\nlegs: {parts}\n")
    return folder


@pytest.mark.parametrize("name", NAMES)
def test_the_closed_form_is_the_forward_kinematics_of_the_urdf(name, quadruped):
    robot = robots.load(quadruped(name))
    q = np.random.default_rng(0).uniform(-3.0, 3.0, (40, 12))
    closed = np.array([foot_position(row, robot.legs) for row in q])
    # Laikago's axes are written with five digits of pi / 2.
    np.testing.assert_allclose(closed, feet_in_base(robot, q), atol=1e-5)


def test_hyq_read_from_its_urdf_is_the_reference_to_the_last_bit():
    robot = robots.load("hyq")
    lengths = np.r_[:8, 10:16]  # all but the range of the knee, which the URDF rounds
    np.testing.assert_array_equal(robot.legs[:, lengths], HYQ[:, lengths])
    np.testing.assert_allclose(robot.legs, HYQ, atol=1e-8)


@pytest.mark.parametrize("name", NAMES)
def test_standing_and_steps_are_within_the_limits_of_the_joints(name, quadruped):
    robot = robots.load(quadruped(name))
    size = similarity.size_of(robot.legs, robot.mass)
    gait = similarity.control_defaults(robot.legs, size)["gait"]
    generator = TargetGenerator(gait, 0.004, robot.legs)  # raises when a step is out of reach
    np.testing.assert_allclose(generator.standing, robot.standing)
    urdf = robots.Description(robot.urdf)
    low, high = np.array([urdf.limits(joint) for joint in robot.joints]).T
    assert (low < robot.standing).all() and (robot.standing < high).all()


def test_joints_feet_and_pose_come_in_the_order_of_the_legs_whatever_the_file_says(quadruped):
    plain = robots.load(quadruped("mini_cheetah"))
    shuffled = [plain.joints[i] for i in np.random.default_rng(1).permutation(12)]
    pose = dict(zip(shuffled, np.linspace(-0.3, 0.3, 12).tolist(), strict=True))
    values = yaml.safe_load((plain.folder / "robot.yaml").read_text())
    values |= {"joints": shuffled, "standing": list(pose.values())}
    (plain.folder / "robot.yaml").write_text(yaml.safe_dump(values))
    robot = robots.load(plain.folder)
    assert shuffled != list(plain.joints) == list(robot.joints)
    assert robot.feet == plain.feet == ("toe_fl", "toe_fr", "toe_hl", "toe_hr")
    assert dict(zip(robot.joints, robot.standing, strict=True)) == pose


def test_a_pose_says_which_way_a_free_knee_bends(quadruped):
    robot = robots.load(quadruped("mini_cheetah"))
    np.testing.assert_array_equal(robot.legs[:, KNEE], -1.0)
    feet = foot_position(robot.standing, robot.legs)
    forwards = robot.legs.copy()
    forwards[:, KNEE] = 1.0
    pose = joint_position(feet, forwards)
    text = (robot.folder / "robot.yaml").read_text()
    (robot.folder / "robot.yaml").write_text(text + f"standing: {pose.tolist()}\n")
    np.testing.assert_array_equal(robots.load(robot.folder).legs[:, KNEE], 1.0)


def test_what_is_no_such_leg_is_refused_in_one_message(tmp_path):
    assert robots.load(box(tmp_path)).legs.shape == (4, 16)
    with pytest.raises(ParameterError, match=r"leg lf: joint lf_haa must turn about x .* \[0\.0, "):
        robots.load(box(tmp_path, axis="0 0 1"))
    with pytest.raises(ParameterError, match=r"hip of leg lf must be ahead of that of lh"):
        robots.load(box(tmp_path, forward=-1.0))
    with pytest.raises(ParameterError, match=r"leg rf: rf_b does not hang on rh_haa"):
        robots.load(box(tmp_path, rf={"haa": "rh_haa"}, rh={"haa": "rf_haa"}))
    with pytest.raises(ParameterError, match=r"thigh and shank .* `foot` is the link at the end"):
        robots.load(box(tmp_path, lh={"foot": "lh_c"}))


def test_names_that_are_missing_or_unknown_are_named(tmp_path):
    with pytest.raises(NameUnknownError, match="no_joint"):
        robots.load(box(tmp_path, lf={"hfe": "no_joint"}))
    with pytest.raises(NameUnknownError, match="toe"):
        robots.load(box(tmp_path, lf={"toe": "lf_foot"}))
    path = box(tmp_path)
    text = (path / "robot.yaml").read_text()
    (path / "robot.yaml").write_text(text.replace("'foot': 'rh_foot'", ""))
    with pytest.raises(ParameterError, match=r"legs\.rh needs foot too"):
        robots.load(path)
    (path / "robot.yaml").write_text(text.replace("joints: ['lf_haa'", "joints: ['lf_end'"))
    with pytest.raises(ParameterError, match="joints must be those of legs"):
        robots.load(path)


def test_what_the_file_leaves_out_is_hyqs_at_the_size_of_the_robot(quadruped, tmp_path):
    hyq, own = robots.load("hyq"), ("standing", "drives", "fall")
    text = yaml.safe_load((hyq.folder / "robot.yaml").read_text())
    values = {key: value for key, value in text.items() if key not in own}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(values))
    (tmp_path / "hyq.urdf").write_text(hyq.urdf)
    bare = robots.load(tmp_path)
    assert bare.drives == hyq.drives and bare.fall == hyq.fall
    np.testing.assert_allclose(bare.standing, hyq.standing, atol=1e-6)  # rounded in the file
    a1 = robots.load(quadruped("a1"), {"drives.FL_hip_joint.kp": 3.0})
    assert a1.drives["FL_hip_joint"].kp == 3.0 < a1.drives["FR_hip_joint"].kp
    given = robots.load(
        quadruped("aliengo", fall={"height": 0.1}, drives={"*": {"kind": "torque"}})
    )
    assert given.fall.height == 0.1 and given.fall.roll == 10.0
    assert {type(drive).__name__ for drive in given.drives.values()} == {"TorqueDrive"}


def test_the_legs_that_hang_on_hyq_are_those_that_its_gains_were_made_for():
    hyq = robots.load("hyq")
    legs = swung_mass(robots.Description(hyq.urdf), hyq.joints)
    assert legs == pytest.approx(robots.HYQ_LEGS, rel=1e-9)
