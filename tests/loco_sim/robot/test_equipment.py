# SPDX-License-Identifier: Apache-2.0
"""Sections of a robot.yaml: patterns, what wins, contacts from depth and masses from weighing."""

from pathlib import Path

import numpy as np
import pytest

from loco_control.exceptions import LocoError
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.bolted.loop import Bolted
from loco_sim.export.portable import portable
from loco_sim.new_robot import gains
from loco_sim.new_robot.make import make
from loco_sim.plant.model import Model
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import equipment, robot
from loco_sim.robot.description import Description
from loco_sim.robot.equipment import BodyParams, ContactParams

JOINTS, LINKS = ("left_hip", "left_knee", "right_hip", "right_knee"), ("base", "foot")
PATH = Path("robot.yaml")
BODY = (
    '<link name="{}"><inertial><origin xyz="0.2 0 0"/><mass value="{}"/>'
    '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = '<joint name="{0}_{1}" type="{2}"><parent link="{0}"/><child link="{1}"/></joint>'
ARM = (
    "<robot name='arm'>"
    + BODY.format("arm", 2.0) + BODY.format("tool", 0.5) + BODY.format("hand", 0.3)
    + JOINT.format("arm", "tool", "fixed") + JOINT.format("tool", "hand", "revolute")
    + "</robot>"
)  # fmt: skip


def expanded(**values):
    return equipment.expanded(values, JOINTS, LINKS, PATH)


def test_a_later_entry_adds_to_and_wins_over_an_earlier_one():
    springs = expanded(
        springs={"*_knee": {"stiffness": 1.0, "damping": 2.0}, "left_knee": {"stiffness": 3.0}}
    )["springs"]
    assert springs == {
        "left_knee": {"stiffness": 3.0, "damping": 2.0},
        "right_knee": {"stiffness": 1.0, "damping": 2.0},
    }


@pytest.mark.parametrize("section", ["drives", "springs", "contacts", "masses", "bodies"])
def test_a_pattern_that_names_nothing_is_refused(section):
    with pytest.raises(LocoError, match="available"):
        expanded(**{section: {"*_elbow": {}}})


def test_an_override_changes_one_value_and_leaves_the_file_alone():
    values = expanded(springs={"*_knee": {"stiffness": 1.0, "damping": 2.0}})
    equipment.override(values, {"springs.left_*.stiffness": 9.0, "sim.friction": 0.3}, LINKS)
    assert values["springs"]["left_knee"] == {"stiffness": 9.0, "damping": 2.0}
    assert values["springs"]["right_knee"]["stiffness"] == 1.0
    assert values["sim"] == {"friction": 0.3}


def test_an_override_may_add_to_a_section_of_sensors():
    values = expanded()
    equipment.override(values, {"sensors.imu.gyro_noise": 0.1}, LINKS)
    assert values["sensors"] == {"imu": {"gyro_noise": 0.1}}


def test_a_contact_sinks_in_by_its_depth_under_its_load():
    stiffness, damping = ContactParams(depth=0.002).softness(0.25)
    assert 0.25 * 9.81 / stiffness == pytest.approx(0.002)
    assert damping == pytest.approx(2.0 * (stiffness * 0.25) ** 0.5)
    assert ContactParams().softness(0.25) == (0.0, 0.0)


def test_a_link_is_weighed_with_what_hangs_on_it():
    described = Description((robot.ASSETS / "tigrillo" / "tigrillo.urdf").read_text())
    equipment.set_masses(described, {"front_body": 0.9, "lf_foot": 0.01, "lf_upper_leg": 0.1})
    weights = {name: described.mass_of(name) for name in described.below("front_body")}
    assert weights["lf_foot"] == pytest.approx(0.01)
    assert sum(weights[name] for name in described.below("lf_upper_leg")) == pytest.approx(0.1)
    assert sum(weights.values()) == pytest.approx(0.9)
    before = Description((robot.ASSETS / "tigrillo" / "tigrillo.urdf").read_text())
    factor = weights["front_body"] / before.mass_of("front_body")
    scaled = factor * before.inertia_of("front_body")
    assert described.inertia_of("front_body") == pytest.approx(scaled)


def test_joints_can_be_given_damping_and_armature():
    plain = robot.load("servo_pendulum")
    changed = robot.load(
        "servo_pendulum", {"dynamics.pivot.damping": 0.1, "dynamics.*.armature": 0.01}
    )
    before, after = Description(plain.urdf), Description(changed.urdf)
    assert (before.damping("pivot"), after.damping("pivot")) == (0.002, 0.1)
    assert (plain.armature, changed.armature) == ({}, {"pivot": 0.01})
    assert robot.load("servo_pendulum", {"dynamics.pivot.armature": 0.0}).armature == {}
    with pytest.raises(LocoError, match="elbow"):
        robot.load("servo_pendulum", {"dynamics.elbow.damping": 0.1})


def test_a_body_takes_with_it_what_is_fixed_to_it():
    described = Description(ARM)
    inertia = described.inertia_of("tool")[0, 0]
    equipment.set_bodies(described, {"arm": BodyParams(mass=2.0, inertia=0.5, x=0.1)})
    assert described.fixed_to("arm") == ["arm", "tool"]
    assert [described.mass_of(link) for link in ("arm", "tool", "hand")] == [4.0, 1.0, 0.3]
    assert described.inertia_of("tool")[0, 0] == pytest.approx(inertia)  # twice the mass, half
    (arm, *_) = described.elements("link")
    at = [float(v) for v in arm.find("inertial/origin").get("xyz").split()]
    assert at == pytest.approx([0.3, 0.0, 0.0])


def test_gains_that_a_draft_guessed_are_uncertain_unless_a_pattern_says_how_much():
    drives = {"a": {"kind": "impedance", "kp": 50.0, "kd": 2.0},
              "b": {"kind": "impedance", "kp": 0.0, "kd": 1.0}, "c": {"kind": "torque"}}  # fmt: skip
    values = {"drives": drives, "springs": {}, "guessed": ["control_rate", "drives"]}
    kp, kd = equipment.GUESSED["kp"], equipment.GUESSED["kd"]
    assert equipment.uncertain(values, [], PATH) == pytest.approx(
        {"drives.a.kp": 50.0 * kp, "drives.a.kd": 2.0 * kd, "drives.b.kd": kd}
    )
    known = {**values, "uncertain": {"drives.a.*": "1%"}}
    assert equipment.uncertain(known, [], PATH)["drives.a.kp"] == pytest.approx(0.5)
    assert equipment.uncertain({**values, "guessed": ["control_rate"]}, [], PATH) == {}


def test_uncertain_values_are_named_by_patterns_in_their_own_units():
    values = {
        "drives": {"j1": {"kind": "torque"}, "j2": {"kind": "torque"}},
        "springs": {},
        "uncertain": {"bodies.arm.[xyz]": 0.02, "drives.*.bias": 0.3},
    }
    found = equipment.uncertain(values, ["arm", "hand"], PATH)
    assert found == {
        **dict.fromkeys(("bodies.arm.x", "bodies.arm.y", "bodies.arm.z"), 0.02),
        **dict.fromkeys(("drives.j1.bias", "drives.j2.bias"), 0.3),
    }
    values["drives"]["j2"]["gain"] = 2.0
    shares = {**values, "uncertain": {"drives.*.gain": "3%", "bodies.arm.mass": "5 %"}}
    assert equipment.uncertain(shares, ["arm"], PATH) == pytest.approx(
        {"drives.j1.gain": 0.03, "drives.j2.gain": 0.06, "bodies.arm.mass": 0.05}
    )
    equipment.override(values, {"uncertain.bodies.*.mass": "2%"}, ["arm"])
    assert equipment.uncertain(values, ["arm"], PATH)["bodies.arm.mass"] == pytest.approx(0.02)
    for wrong in ({"drives.*.colour": 1.0}, {"drives.*.bias": 0.0}, {"drives.*.bias": "much"}):
        with pytest.raises(LocoError, match=next(iter(wrong)).replace("*", ".")):
            equipment.uncertain({**values, "uncertain": wrong}, ["arm"], PATH)


@pytest.mark.parametrize("where", ["urdf", "robot.yaml"])
@pytest.mark.parametrize("engine", ["pybullet", "mujoco", "bolted"])
@pytest.mark.parametrize(
    ("torque", "angle"), [(0.8, 0.0), (1.2, 0.2 / 0.05 * 1e-6 * 200 * 201 / 2)]
)
def test_a_joint_rubs_with_the_friction_of_the_description(tmp_path, where, engine, torque, angle):
    """1 N·m of dry friction and 0.05 kg·m²: the rest accelerates the joint, in 200 steps."""
    rubs = "friction: 1.0" if where == "robot.yaml" else "friction: -1.0"
    inertia = '<inertia ixx=".01" iyy=".01" izz=".01" ixy="0" ixz="0" iyz="0"/>'
    (tmp_path / "a.urdf").write_text(
        f'<robot name="a"><link name="b"><inertial><mass value="1"/>{inertia}</inertial></link>'
        f'<link name="l"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>{inertia}</inertial>'
        '</link><joint name="j" type="continuous"><parent link="b"/><child link="l"/>'
        '<axis xyz="0 0 1"/><limit effort="50" velocity="30"/>'
        f'<dynamics friction="{1.0 if where == "urdf" else 0.0}"/></joint></robot>'
    )
    (tmp_path / "robot.yaml").write_text(
        "urdf: a.urdf\nfixed_base: true\nheight: 1.0\njoints: [j]\ndrives: {j: {kind: torque}}\n"
        f"control_rate: 100\ndynamics: {{j: {{{rubs}}}}}\n"
    )
    loaded = robot.load(tmp_path)
    zero, steps = np.zeros(1), 20
    if engine == "bolted":
        held = np.zeros((steps + 1, 1))
        q = Bolted(loaded).run(held, held, held + torque).q[-1]
    else:
        with Simulation(loaded.sim.replace(engine=engine), robot=loaded) as plant:
            for k in range(steps):
                head, stance = (k, k * plant.dt), np.ones(0, dtype=bool)
                push = TrunkTorque(*head, np.array([torque]), np.zeros(6), stance)
                q = plant.step(MotionCommand(*head, zero, zero), push).q
    assert q[0] == pytest.approx(angle, abs=1e-5)


def test_the_friction_of_a_file_is_told_held_by_the_gains_and_exported(tmp_path):
    text = (
        '<mujoco><worldbody><body name="arm"><joint name="j" axis="0 1 0" frictionloss="0.7" '
        'damping="0.2" armature="0.05"/><geom type="capsule" size="0.02" fromto="0 0 0 0.3 0 0"/>'
        "</body></worldbody></mujoco>"
    )
    (tmp_path / "arm.xml").write_text(text)
    result = make(tmp_path / "arm.xml", tmp_path / "arm")
    loaded = robot.load(result.folder)
    assert loaded.joint_friction == {"j": pytest.approx(0.7)}
    assert loaded.armature["j"] >= 0.05
    (row,) = [row for row in result.rows if row[0] == "friction"]
    assert "damping up to 0.2" in row[1] and "dry friction up to 0.7" in row[1]
    assert 0.7 / loaded.drives["j"].kp <= gains.SAG
    (joint,) = portable(Model(robot=str(result.folder))).joints
    assert joint.friction == pytest.approx(0.7) and joint.damping == pytest.approx(0.2)
