# SPDX-License-Identifier: Apache-2.0
"""What every robot that brings its own drives or springs must do, from URDF and YAML alone."""

import numpy as np
import pytest
import yaml

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot

LINK = """<link name="{}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/>
<limit effort="50" velocity="9" lower="-3" upper="3"/></joint>"""
SPLIT = "".join(
    [
        '<robot name="split">',
        *map(LINK.format, ("front", "rear", "left_foot", "right_foot")),
        JOINT.format("spine", "front", "rear"),
        JOINT.format("left", "rear", "left_foot"),
        JOINT.format("right", "rear", "right_foot"),
        "</robot>",
    ]
)
EQUIPPED = [name for name in robot.names() if robot.load(name).equipped]


def command(k, plant, move=0.0):
    """Stand, or move every joint in a slow wave."""
    n = len(plant.robot.joints)
    wave = move * np.sin(2.0 * k * plant.dt) * np.ones(n)
    stance = np.ones(len(plant.robot.feet), dtype=bool)
    trunk = TrunkTorque(k, k * plant.dt, 0.1 * wave, np.zeros(6), stance)
    return MotionCommand(k, k * plant.dt, plant.robot.standing + wave, np.zeros(n)), trunk


def states(name, ticks, move=0.3, seed=0, overrides=None):
    with Simulation(robot=robot.load(name, overrides), seed=seed) as plant:
        return [plant.step(*command(k, plant, move)) for k in range(ticks)], plant


@pytest.fixture(params=EQUIPPED)
def name(request):
    return request.param


def test_the_benches_and_tigrillo_are_there():
    benches = {"servo_pendulum", "pendulum", "linear_axis", "spring_mass", "hyq_leg"}
    assert {"hyq", "tigrillo"} | benches <= set(robot.names())


def test_drives_and_springs_of_a_robot_are_on_its_joints(name):
    loaded = robot.load(name)
    assert set(loaded.drives) | set(loaded.springs) <= set(loaded.joints)
    assert [loaded.joints[i] for i in loaded.driven] == [
        joint for joint in loaded.joints if joint in loaded.drives
    ]


def test_a_second_of_motion_is_finite_and_upright(name):
    run, plant = states(name, round(robot.load(name).control_rate))
    assert plant.fallen is None
    assert all(np.all(np.isfinite(state.q)) for state in run)
    assert np.ptp([state.q for state in run], axis=0).max() > 0.01


def test_the_same_seed_gives_the_same_bytes(name):
    first, second = (states(name, 20, seed=3)[0] for _ in range(2))
    for a, b in zip(first, second, strict=True):
        assert a.q.tobytes() == b.q.tobytes()
        assert a.linear_acceleration.tobytes() == b.linear_acceleration.tobytes()


def test_a_step_without_feed_forward_torque_is_a_step_with_none(name):
    with Simulation(robot=name) as plant:
        motion, _ = command(0, plant)
        alone = plant.step(motion)
        plant.reset()
        n, stance = len(motion.q), np.ones(len(plant.robot.feet), dtype=bool)
        none = TrunkTorque(0, 0.0, np.zeros(n), np.zeros(6), stance)
        assert alone.q.tobytes() == plant.step(motion, none).q.tobytes()


def test_what_is_commanded_to_passive_joints_does_not_matter(name):
    with Simulation(robot=name) as plant:
        motion, trunk = command(1, plant, 0.1)
        first = plant.step(motion, trunk).q
        plant.reset()
        passive = np.setdiff1d(np.arange(len(motion.q)), plant.robot.driven)
        motion.q[passive] = trunk.tau[passive] = np.nan
        assert plant.step(motion, trunk).q.tobytes() == first.tobytes()
        assert plant.rejected == 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"springs.no_such_joint.stiffness": 1.0}, "no entry of springs"),
        ({"drives.no_such_joint.kp": 1.0}, "no entry of drives"),
        ({"masses.no_such_link": 1.0}, "no link"),
        ({"sim.no_such_value": 1.0}, "no_such_value"),
        ({"nonsense": 1.0}, "no value of a robot to override"),
        ({"control_rate": -1.0}, "control_rate must be in"),
        ({"sim.physics_rate": 1.0}, "physics_rate must be in"),
        ({"masses.*": -1.0}, "must be a number above 0"),
    ],
)
def test_wrong_overrides_are_refused(name, changes, message):
    with pytest.raises(LocoError, match=message):
        robot.load(name, changes)


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("spring_mass", {"springs.*.stiffness": -1.0}, "stiffness must be in"),
        ("spring_mass", {"springs.*.color": 1.0}, "color"),
        ("spring_mass", {"springs.spring.stop": 1.0}, "stop of spring must be below"),
        ("spring_mass", {"springs.spring.length": 1.0}, "fits no triangle"),
        ("servo_pendulum", {"drives.pivot.kind": "magic"}, "no kind of drive"),
        ("servo_pendulum", {"drives.pivot.stall_torque": 0.0}, "stall_torque must be in"),
        ("tigrillo", {"contacts.*_foot.depth": -1.0}, "depth must be in"),
        ("tigrillo", {"masses.front_body": 0.05}, "what hangs on it"),
        ("tigrillo", {"sensors.hall.table": "none.csv"}, "no Hall table"),
    ],
)
def test_values_out_of_range_are_refused(name, changes, message):
    with pytest.raises(LocoError, match=message):
        robot.load(name, changes)


def test_an_override_says_what_may_be_overridden():
    with pytest.raises(NameUnknownError, match="springs.spring.<parameter>"):
        robot.load("spring_mass", {"stiffness": 3.0})


def test_overrides_reach_the_joints_and_links_they_name():
    changes = {"springs.l?_kfe_joint.stiffness": 440.6, "masses.front_body": 0.674}
    loaded = robot.load("tigrillo", changes)
    stiffness = {joint: spring.stiffness for joint, spring in loaded.springs.items()}
    assert stiffness["lf_kfe_joint"] == stiffness["lh_kfe_joint"] == 440.6
    assert stiffness["rf_kfe_joint"] == 181.6
    described = robot.Description(loaded.urdf)
    weights = [described.mass_of(link) for link in described.below("front_body")]
    assert sum(weights) == pytest.approx(0.674)


def test_a_robot_yaml_with_an_unknown_joint_is_refused(tmp_path):
    folder = robot.ASSETS / "spring_mass"
    (tmp_path / "spring_mass.urdf").write_text((folder / "spring_mass.urdf").read_text())
    values = yaml.safe_load((folder / "robot.yaml").read_text())
    values["springs"] = {"sprong": {"stiffness": 1.0}}
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(NameUnknownError, match="did you mean 'spring'"):
        robot.load(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"standing": ["up"]}, "standing must be a list of numbers"),
        ({"standing": 3}, "standing must be a list of numbers"),
        ({"standing": [1.0, 2.0]}, "standing must have 1 values"),
        ({"height": "high"}, "height must be a number"),
        ({"joints": "spring"}, "joints must be a list"),
        ({"joints": ["spring", "spring"]}, "without repeats"),
        ({"guessed": "drives"}, "guessed must be a list"),
        ({"guessed": ["drives", 3]}, "named 3; available: .*drives"),
        ({"springs": ["spring"]}, "springs must be a mapping"),
        ({"springs": {"spring": 3}}, "springs.spring must be a mapping"),
        ({"sensors": {"hall": 3}}, "sensors.hall must be a mapping"),
        ({"masses": {"mass": "heavy"}}, "masses.mass must be a number"),
        ({"spring": {}}, "did you mean 'springs'"),
    ],
)
def test_a_robot_yaml_with_a_wrong_value_is_refused(tmp_path, changes, message):
    folder = robot.ASSETS / "spring_mass"
    (tmp_path / "spring_mass.urdf").write_text((folder / "spring_mass.urdf").read_text())
    values = yaml.safe_load((folder / "robot.yaml").read_text()) | changes
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(values))
    with pytest.raises(LocoError, match=message):
        robot.load(tmp_path)


def test_a_folder_of_the_same_name_does_not_hide_a_robot(tmp_path, monkeypatch):
    (tmp_path / "pendulum").mkdir()
    monkeypatch.chdir(tmp_path)
    assert robot.load("pendulum").joints == ("pivot",)


def test_a_robot_with_neither_drives_nor_springs_is_refused(tmp_path):
    folder = robot.ASSETS / "pendulum"
    (tmp_path / "pendulum.urdf").write_text((folder / "pendulum.urdf").read_text())
    (tmp_path / "robot.yaml").write_text("urdf: pendulum.urdf\njoints: [pivot]\n")
    with pytest.raises(ParameterError, match="neither drives nor springs: list them in its robot"):
        Simulation(robot=tmp_path)


def test_a_joint_belongs_to_the_foot_that_hangs_on_it():
    assert robot.load("hyq").foot_of.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 3, 3, 3]
    assert robot.load("tigrillo").foot_of.tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert robot.load("pendulum").foot_of.tolist() == [-1]


def test_a_joint_that_carries_several_feet_belongs_to_none(tmp_path):
    (tmp_path / "split.urdf").write_text(SPLIT)
    legs = "joints: [spine, left, right]\nfeet: [left_foot, right_foot]\n"
    (tmp_path / "robot.yaml").write_text("urdf: split.urdf\n" + legs)
    split = robot.load(tmp_path)
    assert split.foot_of.tolist() == [-1, 0, 1]
    assert split.swinging(np.array([True, False])).tolist() == [0.0, 0.0, 1.0]
    assert split.swinging(np.array([False, False])).tolist() == [0.0, 1.0, 1.0]
    with pytest.raises(ParameterError, match="has 2 feet, got 3 stance flags"):
        split.swinging(np.ones(3, dtype=bool))
