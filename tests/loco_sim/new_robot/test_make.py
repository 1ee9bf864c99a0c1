# SPDX-License-Identifier: Apache-2.0
"""Robots that nobody here drew become folders: they stand, or swing where they are bolted."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from loco_control.exceptions import LocoError, MissingFileError, ParameterError
from loco_control.types import MotionCommand
from loco_sim.bolted.loop import Bolted, needs_engine
from loco_sim.geometry import roll_pitch, rotation_matrix
from loco_sim.new_robot import trial
from loco_sim.new_robot.make import make
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots
from loco_sim.robot.equipment import GRAVITY

from ...quadrupeds import DATA, legs_of
from ..robot.test_urdf_check import GOOD, HOSTILE

QUADRUPEDS = {  # and how many of their feet carry them
    "laikago/laikago_toes_limits": 4,
    "a1/a1": 4,
    "aliengo/aliengo": 4,
    "mini_cheetah/mini_cheetah": 4,
    "quadruped/spirit40": 4,
    "quadruped/vision60": 4,
    "quadruped/microtaur/microtaur": 4,
    "quadruped/minitaur": 8,
    "quadruped/minitaur_fixed_knees": 8,
}
STANDING = {**QUADRUPEDS, "humanoid/humanoid": 2, "racecar/racecar": 4, "husky/husky": 4, "r2d2": 4}
BOLTED = [
    "kuka_iiwa/model",
    "franka_panda/panda",
    "xarm/xarm6_robot",
    "xarm/xarm6_with_gripper",
    "cartpole",
    "pendulum5",
    "bicycle/bike",
]
WITH_LEGS = [*list(QUADRUPEDS)[:6]]


def each(names):
    """Names of robots as parameters; one process has all tests of a robot and makes it once."""
    return [pytest.param(name, marks=pytest.mark.xdist_group(name)) for name in names]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Function that gives the robot folder of a URDF, made once."""
    folder, known = tmp_path_factory.mktemp("robots"), {}

    def get(name):
        if name not in known:
            known[name] = make(DATA / f"{name}.urdf", folder / name.replace("/", "_"))
        return known[name]

    return get


def held(robot, seconds):
    """States of a robot that holds its posture, and the height of its base at each."""
    states, heights, tilts = [], [], []
    with Simulation(robot=robot) as plant:
        for k in range(round(seconds / plant.dt)):
            states.append(
                plant.step(MotionCommand(k, k * plant.dt, robot.standing, 0.0 * robot.standing))
            )
            truth = plant.ground_truth()
            heights.append(truth.position[2])
            tilts.append(roll_pitch(rotation_matrix(truth.orientation)))
        assert plant.fallen is None
    return states, np.array(heights), np.array(tilts)


def test_there_are_twenty():
    assert len(STANDING) + len(BOLTED) == 20


@pytest.mark.parametrize("name", each(STANDING))
def test_it_stands_and_its_feet_carry_its_weight(made, name):
    result = made(name)
    assert result.stands
    robot = robots.load(result.folder)
    assert len(robot.feet) == STANDING[name]
    states, heights, tilts = held(robot, 2.0)
    carried = np.mean([state.grf[:, 2].sum() for state in states[-100:]])
    assert carried == pytest.approx(robot.mass * GRAVITY, rel=0.05)
    assert np.abs(tilts).max() < 0.15
    assert np.ptp(heights[-100:]) < 0.02 * max(heights[0], 0.3)
    assert np.all(np.abs([state.tau for state in states[-100:]]) <= robot.effort + 1e-9)


@pytest.mark.parametrize("name", each(BOLTED))
def test_it_is_bolted_and_follows_its_swing_within_its_limits(made, name):
    result = made(name)
    assert not result.stands
    assert [note for note in result.notes if note.startswith("bolted, as ")]
    robot = robots.load(result.folder)
    target = yaml.safe_load((result.folder / "experiment.yaml").read_text())["target"]
    amplitude, offset = np.array(target["amplitude"]), np.array(target["offset"])
    np.testing.assert_array_equal(offset, robot.standing)
    limits = {j: (lo, hi) for j, lo, hi in ranges(robot)}
    positions = []
    with Simulation(robot=robot) as plant:
        for k in range(round(2.0 / plant.dt)):
            t = k * plant.dt
            q = offset + amplitude * np.sin(np.pi * t)
            state = plant.step(MotionCommand(k, t, q, np.pi * amplitude * np.cos(np.pi * t)))
            positions.append(plant.true_q)
            assert not state.grf.any()  # it touches nothing
    positions = np.array(positions)
    for joint, (low, high) in limits.items():
        column = positions[:, robot.joints.index(joint)]
        assert low - 0.02 <= column.min() and column.max() <= high + 0.02
    assert np.all(np.ptp(positions, axis=0) > np.abs(amplitude))  # half of the whole swing


@pytest.mark.pybullet
@pytest.mark.parametrize("name", each(BOLTED[:3]))
def test_an_arm_of_others_needs_no_engine_to_do_what_it_does_with_it(made, name):
    """It hangs so high that its meshes cannot touch the ground; `loco gap` is fast with it."""
    # As `loco gap` has it: damping is held over sub-steps, in both; PyBullet has no rotors,
    # and iterates to stop joints that rub, to about 1e-7 rad.
    held = {"sim.implicit_damping": False, "sim.max_substeps": 40}
    robot = replace(robots.load(made(name).folder, held), armature={}, joint_friction={})
    assert needs_engine(robot) == ""
    wave = np.sin(np.linspace(0.0, 6.0, 100))[:, None]
    told = robot.standing + 0.005 * wave * np.ones(len(robot.joints))
    run = Bolted(robot).run(told, 0.0 * told, 0.0 * told)
    with Simulation(robot=robot) as plant:
        state = plant.reset()
        for k in range(len(told)):
            np.testing.assert_allclose(run.q[k], state.q, rtol=0.0, atol=1e-9)
            state = plant.step(MotionCommand(k, k * plant.dt, told[k], 0.0 * told[k]))


def ranges(robot):
    from loco_sim.robot.description import Description

    description = Description(robot.urdf)
    return [(joint, *description.limits(joint)) for joint in robot.joints]


@pytest.mark.parametrize("name", each(WITH_LEGS))
def test_its_legs_are_those_that_people_named(made, name):
    folder = made(name).folder
    assert robots.load(folder).legs is not None
    legs = yaml.safe_load((folder / "robot.yaml").read_text())["legs"]
    assert legs == legs_of(name.split("/")[1].removesuffix("_toes_limits"))


def test_the_same_urdf_gives_the_same_robot(tmp_path):
    texts = []
    for name in ("one", "two"):
        folder = tmp_path / name / "r2d2"
        make(DATA / "r2d2.urdf", folder)
        texts.append([(folder / f).read_bytes() for f in ("robot.yaml", "r2d2.urdf")])
    assert texts[0] == texts[1]


# ---- input of all kinds


def written(folder, urdf):
    path = folder / "r.urdf"
    path.write_text(urdf)
    (folder / "cut.stl").write_bytes(bytes(80) + (9).to_bytes(4, "little") + bytes(50))
    return path


CURED = ("inertia of no body", "limits crossed", "floating joint")


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_urdf_is_one_line_and_leaves_nothing_behind(tmp_path, name):
    old, new, _ = HOSTILE[name]
    urdf = written(tmp_path, GOOD.replace(old, new, 1))
    try:
        result = make(urdf, tmp_path / "out")
    except LocoError as error:
        assert "\n" not in str(error) and "r.urdf" in str(error)
        assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.stl", "r.urdf"]
    else:
        assert name in CURED or "not the engine" in str(result.notes) or result.folder.is_dir()


def test_a_folder_that_exists_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    with pytest.raises(ParameterError, match="exists already; give another folder with --out"):
        make(written(tmp_path, GOOD), tmp_path / "out")


def test_a_missing_urdf_is_named(tmp_path):
    with pytest.raises(MissingFileError, match="no URDF at .*none.urdf"):
        make(tmp_path / "none.urdf", tmp_path / "out")


def test_nothing_to_drive_is_said(tmp_path):
    with pytest.raises(ParameterError, match="no joint of it moves"):
        make(DATA / "samurai.urdf", tmp_path / "out")


BALL = (
    '<inertial><mass value="0.5"/><inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" '
    'iyz="0"/></inertial><collision><geometry><sphere radius="0.02"/></geometry></collision>'
)


def comb(count):
    """Limbs of up to five hinges on the world, with fixed links and joints that mimic."""
    links, joints = (
        [f'<link name="world"/><link name="l0">{BALL}</link>'],
        ['<joint name="j0" type="fixed"><parent link="world"/><child link="l0"/></joint>'],
    )
    for i in range(1, count):
        kind = "fixed" if i % 5 == 0 else "revolute"
        follows = f'<mimic joint="j{i - 1}" multiplier="-0.5"/>' if i % 7 == 2 else ""
        before = 0 if i % 6 == 1 else i - 1
        links.append(f'<link name="l{i}">{BALL}</link>')
        joints.append(
            f'<joint name="j{i}" type="{kind}"><parent link="l{before}"/><child link="l{i}"/>'
            f'<origin xyz="0.05 0 0"/><axis xyz="0 {i % 2} {1 - i % 2}"/>{follows}'
            '<limit lower="-1" upper="1"/></joint>'
        )
    return "<robot name='comb'>" + "".join(links + joints) + "</robot>"


def test_thirty_joints_fixed_links_and_mimics(tmp_path):
    result = make(written(tmp_path, comb(38)), tmp_path / "out")
    robot = robots.load(result.folder)
    assert len(robot.joints) == 30
    assert not result.stands
    assert any("mimic" in note for note in result.notes)
    assert np.all(robot.effort > 0.0)  # guessed, as the URDF names none


def dog():
    """Four legs of two hinges under a trunk that a floating joint ties to the world."""
    shank = BALL.replace('<sphere radius="0.02"/>', '<box size="0.02 0.02 0.4"/>')
    trunk = BALL.replace("1e-3", "0.1").replace('"0.5"', '"5"')
    links = [f'<link name="world"/><link name="trunk">{trunk}</link>']
    free = '<joint name="free" type="floating"><parent link="world"/><child link="trunk"/></joint>'
    joints = [free]
    moves = '<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="20"/></joint>'
    for k, (x, y) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        links.append(f'<link name="shank{k}">{shank}</link><link name="thigh{k}">{BALL}</link>')
        joints.append(
            f'<joint name="hip{k}" type="revolute"><parent link="trunk"/><child link="thigh{k}"/>'
            f'<origin xyz="{0.2 * x} {0.15 * y} 0"/>{moves}<joint name="knee{k}" type="revolute">'
            f'<parent link="thigh{k}"/><child link="shank{k}"/><origin xyz="0 0 -0.2"/>{moves}'
        )
    return f'<robot name="dog">{"".join(links + joints)}</robot>'


def test_a_floating_joint_to_the_world_is_a_base_that_floats(tmp_path):
    result = make(written(tmp_path, dog()), tmp_path / "out")
    assert result.stands, result.notes
    assert len(robots.load(result.folder).feet) == 4


def test_an_arm_on_a_quadruped_is_locked_by_robot_yaml_alone(tmp_path):
    """Deleting `locked` and `legs` frees it, as the URDF still has its joint."""
    arm = (
        f"<link name='arm'>{BALL}</link><joint name='shoulder' type='revolute'>"
        "<parent link='trunk'/><child link='arm'/><origin xyz='0 0 0.1'/><axis xyz='0 1 0'/>"
        "<limit lower='-1' upper='1'/></joint></robot>"
    )
    urdf = (DATA / "a1" / "a1.urdf").read_text().replace("</robot>", arm)
    urdf = urdf.replace('filename="', f'filename="{DATA / "a1"}/')
    result = make(written(tmp_path, urdf), tmp_path / "out")
    assert result.stands and "shoulder" not in robots.load(result.folder).joints
    assert any("the gait moves legs alone" in n and "shoulder" in n for n in result.notes)
    values = yaml.safe_load((result.folder / "robot.yaml").read_text())
    assert list(values.pop("locked")) == ["shoulder"]
    values.pop("legs", None)
    (result.folder / "robot.yaml").write_text(yaml.safe_dump(values))
    freed = robots.load(result.folder)
    assert "shoulder" in freed.drives and freed.effort[freed.joints.index("shoulder")] > 0.0


def test_an_arm_that_cannot_hold_itself_out_hangs(tmp_path):
    """As on Baxter and PR2, whose springs no URDF tells: 2 kg at 0.4 m on a joint of 5 N·m."""
    heavy = BALL.replace('"0.5"', '"2"').replace("<inertial>", '<inertial><origin xyz="0.4 0 0"/>')
    urdf = (
        f"<robot name='arm'><link name='world'/><link name='upper'>{heavy}</link>"
        "<joint name='shoulder' type='revolute'><parent link='world'/><child link='upper'/>"
        "<axis xyz='0 1 0'/><limit lower='-2' upper='2' effort='5' velocity='5'/></joint></robot>"
    )
    result = make(written(tmp_path, urdf), tmp_path / "out")
    robot = robots.load(result.folder)
    assert not result.stands
    weight = 2.0 * GRAVITY * 0.4
    assert weight > 5.0 > weight * abs(np.cos(robot.standing[0]))
    assert any("'shoulder' would need" in note for note in result.notes)


def test_a_refusal_of_the_trial_leaves_nothing_behind(tmp_path, monkeypatch):
    """Joints that do not follow: bolted it cannot swing either."""
    misses = trial.Outcome("joint 'elbow' misses its swing", missed=("elbow",))
    monkeypatch.setattr(trial, "swing", lambda robot, amplitude: misses)
    with pytest.raises(ParameterError, match="no gains were found: joint 'elbow' misses"):
        make(written(tmp_path, GOOD), tmp_path / "out")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.stl", "r.urdf"]


def test_other_units_are_told_before_what_follows_from_them(tmp_path, monkeypatch):
    heavy = GOOD.replace('<mass value="1"', '<mass value="1e5"')
    result = make(written(tmp_path, heavy), tmp_path / "heavy")
    assert result.notes[0].startswith("masses in g?")
    assert not [note for note in result.notes if "correct <limit effort>" in note]
    misses = trial.Outcome("joint 'elbow' misses its swing", missed=("elbow",))
    monkeypatch.setattr(trial, "swing", lambda robot, amplitude: misses)
    with pytest.raises(ParameterError, match="masses in g.* As it is written: no gains were found"):
        make(tmp_path / "r.urdf", tmp_path / "out")


def test_a_joint_that_no_gains_move_is_locked_with_those_that_mimic_it(tmp_path, monkeypatch):
    inertia = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><mass value="1"/>{inertia}</inertial>'
    links = "".join(f'<link name="{name}">{inertial}</link>' for name in "abcd")
    limit = '<axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="50" velocity="5"/>'
    joints = "".join(
        f'<joint name="{name}" type="revolute"><parent link="{above}"/><child link="{below}"/>'
        f"{more}{limit}</joint>"
        for name, above, below, more in (
            ("arm", "a", "b", ""), ("finger", "b", "c", ""),
            ("thumb", "b", "d", '<mimic joint="finger"/>'),
        )
    )  # fmt: skip
    (tmp_path / "hand.urdf").write_text(f'<robot name="hand">{links}{joints}</robot>')
    swing = trial.swing

    def stuck(robot, amplitude):
        if "finger" in robot.joints:
            return trial.Outcome("joint 'finger' misses its swing", missed=("finger",))
        return swing(robot, amplitude)

    monkeypatch.setattr(trial, "swing", stuck)
    result = make(tmp_path / "hand.urdf", tmp_path / "hand")
    assert robots.load(result.folder).joints == ("arm",)
    assert any("no gains make them follow a swing: finger, thumb" in n for n in result.notes)
    text = (result.folder / "robot.yaml").read_text()
    for name in ("finger", "thumb"):
        assert f"  {name}: 0  # no gains make them follow a swing\n" in text
    lines = [line for line in text.split("\n") if not line.endswith("follow a swing")]
    (result.folder / "robot.yaml").write_text("\n".join(lines))
    freed = robots.load(result.folder)  # the lines deleted
    assert set(freed.joints) == set(freed.drives) == {"arm", "finger", "thumb"}
    assert swing(freed, np.array([0.1, 0.1, 0.1])).fault == ""
    slips = trial.Outcome("joint 'arm' slips", missed=("arm",))
    monkeypatch.setattr(trial, "swing", lambda robot, amplitude: slips)
    with pytest.raises(ParameterError, match="no gains were found: joint 'arm' slips"):
        make(result.folder / "hand.urdf", tmp_path / "again")
