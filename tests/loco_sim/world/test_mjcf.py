# SPDX-License-Identifier: Apache-2.0
"""A robot in MuJoCo's format is the same robot as a URDF: places, masses, meshes, couplings."""

import mujoco
import numpy as np
import pytest
import trimesh

from loco_control.exceptions import ParameterError
from loco_sim.foreign.tidy import Tidied
from loco_sim.new_robot.make import make
from loco_sim.robot import robot as robots
from loco_sim.robot.frames import _frame, numbers, origin_of

GEOM = '<geom type="capsule" fromto="0 0 0 0.1 0 -0.3" size="0.02"/>'
ARM = f"""<mujoco model="arm"><compiler angle="radian"/><worldbody><geom type="plane" size="1 1 1"/>
<body name="upper" pos="0 0.1 1" euler="0.3 0.2 0.1">
<joint name="yaw" axis="0 0 1" pos="0.05 0 0" range="-1 1" limited="true"/>
<joint name="pitch" axis="0 1 0" pos="0 0.02 0.03" ref="0.4"/>
{GEOM}
<body name="fore" pos="0.1 0 -0.3" quat="0.9 0.1 0.2 0.3">
<joint name="rail" type="slide" axis="1 0 1" ref="0.05" range="-0.1 0.2" limited="true"/>{GEOM}
<body name="tool" pos="0 0 -0.3"><geom type="box" size="0.1 0.02 0.03" pos="0.02 0 0"/></body>
<body name="wrist" pos="0 0 -0.2"><joint name="roll" axis="1 0 0"/>{GEOM}</body>
</body></body></worldbody>MORE</mujoco>"""
DOG = f"""<mujoco><compiler angle="radian"/><worldbody><body name="trunk" pos="0 0 1">
<freejoint/>{GEOM}
<body name="leg"><joint name="hip" axis="0 1 0" armature="0.02" damping="0.3" stiffness="5"
springref="0.2"/>{GEOM}</body></body>
<body name="ball" pos="1 0 0"><freejoint/><geom size="0.1"/></body></worldbody>MORE</mujoco>"""


def tidied(folder, text, more=""):
    path = folder / "robot.xml"
    path.write_text(text.replace("MORE", more))
    return path, Tidied(path)


def joint_of(made, name):
    return next(j for j in made.root.findall("joint") if j.get("name") == name)


@pytest.mark.parametrize("seed", range(3))
def test_links_are_where_mujoco_has_them(tmp_path, seed):
    path, made = tidied(tmp_path, ARM)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = np.random.default_rng(seed).uniform(-1.0, 1.0, model.nq)
    mujoco.mj_forward(model, data)
    q = {model.joint(j).name: data.qpos[j : j + 1] for j in range(model.njnt)}
    parent = {j.find("child").get("link"): j for j in made.root.findall("joint")}
    for name in ("upper", "fore", "tool", "wrist"):
        turn, origin = _frame(name, parent, q, 1, {})
        inertial = made.link(name).find("inertial")
        com = origin[0] + turn[0] @ numbers(inertial.find("origin"), "xyz", "")
        np.testing.assert_allclose(com, data.body(name).xipos, atol=1e-8)
        assert float(inertial.find("mass").get("value")) == pytest.approx(model.body(name).mass[0])


def test_energy_of_a_turning_body_is_that_of_mujoco(tmp_path):
    """Inertias are in the right frame: kinetic energy of one joint's motion, by both."""
    path, made = tidied(tmp_path, ARM)
    model = mujoco.MjModel.from_xml_path(str(path))
    for name in ("upper", "wrist"):
        body = model.body(name)
        turn = np.zeros(9)
        mujoco.mju_quat2Mat(turn, body.iquat)
        turn = turn.reshape(3, 3)
        expected = turn @ np.diag(body.inertia) @ turn.T
        tensor = made.link(name).find("inertial/inertia")
        ours = [float(tensor.get(key)) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")]
        np.testing.assert_allclose(ours, expected[np.triu_indices(3)], rtol=1e-6, atol=1e-12)


def test_ranges_axes_and_efforts_are_read(tmp_path):
    more = (
        '<actuator><motor joint="yaw" gear="5" ctrllimited="true" ctrlrange="-2 1"/>'
        '<position joint="rail" kp="10" forcelimited="true" forcerange="-7 7"/>'
        '<general joint="roll"/></actuator>'
    )
    made = tidied(tmp_path, ARM, more)[1]
    assert joint_of(made, "yaw").find("limit").attrib == {
        "lower": "-1", "upper": "1", "effort": "10"
    }  # fmt: skip
    assert joint_of(made, "rail").find("limit").get("effort") == "7"
    assert joint_of(made, "rail").get("type") == "prismatic"
    assert joint_of(made, "roll").find("limit").get("effort") is None
    assert joint_of(made, "pitch").get("type") == "continuous"
    assert made.rotors.idle == {"pitch"}


def test_rotors_and_springs_are_read_and_loose_bodies_are_named(tmp_path):
    made = tidied(tmp_path, DOG)[1]
    assert made.rotors.armature == {"hip": 0.02}
    assert made.rotors.springs == {"hip": (5.0, 0.2)}
    assert float(joint_of(made, "hip").find("dynamics").get("damping")) == 0.3
    assert [e.get("name") for e in made.root.findall("link")] == ["trunk", "leg"]
    assert any("no part of the robot" in note and "ball" in note for note in made.notes)


def test_an_equality_of_joints_is_a_mimic(tmp_path):
    more = '<equality><joint joint1="roll" joint2="yaw" polycoef="0.1 -2 0 0 0"/></equality>'
    mimic = joint_of(tidied(tmp_path, ARM, more)[1], "roll").find("mimic")
    assert mimic.attrib == {"joint": "yaw", "multiplier": "-2", "offset": "0.1"}


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            '<equality><connect body1="wrist" body2="upper" anchor="0 0 0"/></equality>',
            "closed chain",
        ),
        ('<equality><weld body1="wrist" body2="upper"/></equality>', "closed chain"),
        (
            '<tendon><fixed name="cord"><joint joint="yaw" coef="1"/></fixed></tendon>',
            "the tendon: cord",
        ),
    ],
)
def test_what_no_urdf_has_is_named(tmp_path, more, words):
    assert any(words in note for note in tidied(tmp_path, ARM, more)[1].notes)


def asset(folder, text='<mesh name="rod" file="rod.stl" scale="0.5 1 2"/>'):
    geom = '<geom type="mesh" mesh="rod" pos="0.1 0 0" euler="0.5 0.2 0"/>'
    arm = ARM.replace(GEOM, geom, 1).replace("<worldbody>", f"<asset>{text}</asset><worldbody>")
    return tidied(folder, arm)


def test_a_mesh_is_where_mujoco_has_it(tmp_path):
    solid = trimesh.creation.cone(radius=0.1, height=0.4)
    solid.apply_translation([0.3, 0.1, 0.2])
    solid.export(tmp_path / "rod.stl")
    path, made = asset(tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    geom = int(np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_MESH))[0])
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    theirs = model.mesh_vert @ turn.reshape(3, 3).T + model.geom_pos[geom]
    shape = made.link("upper").find("collision")
    way, at = origin_of(shape)
    scale = numbers(shape.find("geometry/mesh"), "scale", "")
    ours = (solid.vertices * scale) @ way.T + at
    anchor = np.array([0.0, 0.02, 0.03])  # the link's frame is at its last joint
    np.testing.assert_allclose(ours.min(axis=0) + anchor, theirs.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(ours.max(axis=0) + anchor, theirs.max(axis=0), atol=1e-6)


@pytest.mark.parametrize("content", [None, b"version https://git-lfs\n"])
def test_a_mesh_that_is_not_there_is_named(tmp_path, content):
    if content:
        (tmp_path / "rod.stl").write_bytes(content)
    inertia = '<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>'
    text = ARM.replace('<joint name="yaw"', f'{inertia}<joint name="yaw"')
    geom = '<geom type="mesh" mesh="rod"/>'
    text = text.replace(GEOM, geom, 1)
    text = text.replace("<worldbody>", '<asset><mesh file="rod.stl"/></asset><worldbody>')
    made = tidied(tmp_path, text)[1]
    assert "without a shape, as its mesh is not there: upper (rod.stl)" in made.notes


def test_a_mass_that_follows_from_a_mesh_that_is_not_there_is_said(tmp_path):
    text = ARM.replace(GEOM, '<geom type="mesh" mesh="rod"/>')
    text = text.replace("<worldbody>", '<asset><mesh file="rod.stl"/></asset><worldbody>')
    with pytest.raises(ParameterError, match="follows from a mesh, and that file is not there"):
        tidied(tmp_path, text)


@pytest.mark.parametrize(
    ("option", "gravity"),
    [
        ("", None),
        ('<option gravity="0 0 -9.80665"/>', None),
        ('<option gravity="0 0 -1.62"/>', 1.62),
        ('<option gravity="0 0 0"/>', 0.0),
        ('<option><flag gravity="disable"/></option>', 0.0),
    ],
)
def test_a_robot_weighs_what_it_weighs_in_its_file(tmp_path, option, gravity):
    text = ARM.replace("<worldbody>", f"{option}<worldbody>").replace("MORE", "")
    (tmp_path / "robot.xml").write_text(text)
    result = make(tmp_path / "robot.xml", tmp_path / "out")
    expected = 9.81 if gravity is None else gravity
    assert robots.load(result.folder).sim.gravity == pytest.approx(expected)
    told = [value for key, value, _ in result.rows if key == "gravity"]
    assert told == ([] if gravity is None else [f"{gravity:g} m/s²"])


def test_gravity_that_does_not_point_down_is_told(tmp_path):
    text = ARM.replace("<worldbody>", '<option gravity="0 3 -9"/><worldbody>')
    notes = tidied(tmp_path, text)[1].notes
    assert any("read as downwards" in note for note in notes)


@pytest.mark.parametrize(("kv", "is_lowered"), [(150.0, True), (1.0, False)])
def test_damping_of_an_actuator_that_the_steps_do_not_allow_is_told(tmp_path, kv, is_lowered):
    more = "".join(
        f'<position joint="{j}" kp="2000" kv="{kv}"/>' for j in ("yaw", "pitch", "rail", "roll")
    )
    path, _ = tidied(tmp_path, ARM, f"<actuator>{more}</actuator>")
    result = make(path, tmp_path / "out")
    text = next(value for key, value, _ in result.rows if key == "gains")
    kept = all(d.kd == pytest.approx(kv) for d in robots.load(result.folder).drives.values())
    assert ("lowered, from 150 in the file" in text) is is_lowered is not kept


def test_a_body_without_mass_is_one_line_of_mujoco(tmp_path):
    with pytest.raises(ParameterError, match="MuJoCo: .*mass"):
        tidied(tmp_path, ARM.replace(GEOM, "", 1).replace(GEOM, "", 1).replace(GEOM, "", 1))


@pytest.mark.parametrize(
    ("actuator", "gains", "effort"),
    [
        (
            '<position joint="roll" kp="300" forcelimited="true" forcerange="-6 6"/>',
            (300.0, 0.0),
            6,
        ),
        ('<position joint="roll" kp="5" kv="0.3" gear="10"/>', (500.0, 30.0), None),
        ('<motor joint="roll" gear="3" ctrllimited="true" ctrlrange="-40 40"/>', None, 120),
        ('<velocity joint="roll" kv="4"/>', None, None),
    ],
)
def test_gains_and_limits_of_actuators_are_read(tmp_path, actuator, gains, effort):
    made = tidied(tmp_path, ARM, f"<actuator>{actuator}</actuator>")[1]
    assert made.rotors.gains.get("roll") == (None if gains is None else pytest.approx(gains))
    found = joint_of(made, "roll").find("limit").get("effort")
    assert (None if found is None else float(found)) == effort


@pytest.mark.parametrize("kind", ["motor", "muscle"])
def test_an_actuator_that_drives_no_joint_is_named(tmp_path, kind):
    more = (
        '<tendon><fixed name="cord"><joint joint="yaw" coef="1"/></fixed></tendon>'
        f'<actuator><{kind} name="puller" tendon="cord"/></actuator>'
    )
    notes = tidied(tmp_path, ARM, more)[1].notes
    assert any("without the actuator" in note and "puller" in note for note in notes)


@pytest.mark.parametrize(("kp", "used"), [(2000.0, True), (1e-3, False)])
def test_a_robot_has_the_gains_of_its_actuators_if_they_hold_it(tmp_path, kp, used):
    more = "".join(
        f'<position joint="{joint}" kp="{kp}"/>' for joint in ("yaw", "pitch", "rail", "roll")
    )
    path, _ = tidied(tmp_path, ARM, f"<actuator>{more}</actuator>")
    result = make(path, tmp_path / "out")
    drives = robots.load(result.folder).drives
    assert all((drive.kp == pytest.approx(kp)) == used for drive in drives.values())
    assert any("are not used" in note for note in result.notes) != used
