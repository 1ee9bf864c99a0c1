# SPDX-License-Identifier: Apache-2.0
"""Bags of all kinds become records; those that cannot are refused in one line."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import yaml
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64MultiArray

from loco_bringup.bag.reader import Bag
from loco_bringup.gap import importing as gap_import
from loco_bringup.gap.fields import FieldSource
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.rollout_bag import run_rollout
from loco_control.exceptions import LocoError, MissingFileError
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.recordings.mapping import Column
from loco_learning.runs.experiment import load as load_experiment
from loco_sim.plant.model import Model
from loco_sim.robot import robot as robots

from .. import message_bag

TIGRILLO = robots.load("tigrillo")
SERVO = robots.load("servo_pendulum")


def stamped(message, t):
    message.header.stamp.sec, message.header.stamp.nanosec = int(t), round(t % 1 * 1e9)
    return message


def joints(names, **fields):
    """Function of time that makes a JointState; the fields are functions of time."""

    def make(t):
        values = {field: [float(of(t))] * len(names) for field, of in fields.items()}
        return stamped(JointState(name=list(names), **values), t)

    return make


def imu(t):
    message = stamped(Imu(), t)
    message.orientation.z, message.orientation.w = np.sin(0.1), np.cos(0.1)
    message.angular_velocity.y, message.linear_acceleration.z = 0.5, 9.81
    return message


def odometry(t):
    message = stamped(Odometry(), t)
    message.pose.pose.position.x, message.pose.pose.orientation.w = t, 1.0
    return message


def array(t):
    return Float64MultiArray(data=[0.0, np.degrees(goal(t))])


def goal(t):
    return 0.8 * np.sin(6.0 * t)


def angle(t):
    return goal(t - 0.04)


def speed(t):
    return 4.8 * np.cos(6.0 * (t - 0.04))


STATES = joints(["pivot"], position=angle, velocity=speed)
COMMANDS = joints(["pivot"], position=goal)


def bag(folder, seconds=3.0, attach=None, late=0.0, about=None, **topics):
    """A bag with topics at given rates; ``__`` in a name is a slash."""
    timed = {name: (make, np.arange(round(seconds * rate)) / rate)
             for name, (make, rate) in topics.items()}  # fmt: skip
    return message_bag.write(folder, attach=attach, late=late, about=about, **timed)


def refused(path, robot, said, rules=None):
    with pytest.raises(LocoError, match=said) as error:
        gap_import.load(path, robot, rules)
    assert "\n" not in str(error.value)


def test_standard_messages(tmp_path):
    topics = {"joint_states": (STATES, 100), "joint_command": (COMMANDS, 100)}
    topics["imu__data"] = (imu, 10)
    (made,) = gap_import.load(bag(tmp_path / "swing", **topics), SERVO)
    assert (made.name, made.joints, made.driven, len(made.t)) == (
        "swing",
        ("pivot",),
        ("pivot",),
        300,
    )
    assert np.allclose(made.signals["q"][:, 0], angle(made.t), atol=1e-8)
    assert np.allclose(made.signals["dq"][:, 0], speed(made.t), atol=1e-6)
    assert np.allclose(made.command["position"][:, 0], goal(made.t), atol=1e-8)
    assert "tau" not in made.signals and "velocity" not in made.command
    known = np.isfinite(made.signals["gyro"][:, 0])
    assert known.sum() == 30 and np.allclose(made.signals["gyro"][known], [0.0, 0.5, 0.0])


def test_a_namespace_is_found_and_several_are_told_apart(tmp_path):
    topics = {"left__joint_states": (STATES, 100), "left__joint_command": (COMMANDS, 100)}
    one = gap_import.load(bag(tmp_path / "one", **topics), SERVO)
    assert len(one) == 1
    other = joints(["wheel"], position=angle)
    more = {"r__joint_states": (other, 100), "r__joint_command": (other, 100)}
    (made,) = gap_import.load(bag(tmp_path / "two", **topics, **more), SERVO)
    assert made.joints == ("pivot",)
    twins = {"r__joint_states": (STATES, 100), "r__joint_command": (COMMANDS, 100)}
    folder = bag(tmp_path / "twins", **topics, **twins)
    refused(folder, SERVO, "several robots .*/left/, /r/.* name one with namespace")
    (folder / "mapping.yaml").write_text("namespace: r")
    assert len(gap_import.load(folder, SERVO)) == 1
    (folder / "mapping.yaml").write_text("namespace: s")
    refused(folder, SERVO, "no messages on s/joint_states")


def test_the_pose_of_the_base_is_read_only_if_asked(tmp_path):
    topics = {"joint_states": (STATES, 100), "joint_command": (COMMANDS, 100)}
    topics["ground_truth__odom"] = (odometry, 100)
    folder = bag(tmp_path / "posed", **topics)
    assert "base_position" not in gap_import.load(folder, SERVO)[0].signals
    (tmp_path / "m.yaml").write_text("base_pose: true")
    (made,) = gap_import.load(folder, SERVO, tmp_path / "m.yaml")
    assert np.allclose(made.signals["base_position"][:, 0], made.t)
    assert np.allclose(made.signals["base_orientation"], [0, 0, 0, 1])
    bare = bag(tmp_path / "bare", **{k: v for k, v in topics.items() if "joint" in k})
    refused(bare, SERVO, "no /ground_truth/odom, asked for by base_pose", tmp_path / "m.yaml")


def test_a_mapping_names_any_topic_and_cuts(tmp_path):
    topics = {"arm__state": (STATES, 100), "goals": (array, 100)}
    folder = bag(tmp_path / "own", **topics)
    refused(folder, SERVO, "no messages on joint_states or robot_state.* drafts a mapping")
    rules = {
        "columns": [
            {"topic": "/arm/state", "column": "position[pivot]", "role": "q", "joint": "pivot"},
            {"topic": "goals", "column": "data[1]", "role": "command_position", "joint": "pivot"},
        ],
        "records": [{"from": 0.5, "to": 2.0}, {"from": 2.0, "to": 3.0, "role": "held-out"}],
    }
    rules["columns"][1]["unit"] = "deg"
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump(rules))
    first, second = gap_import.load(folder, SERVO, path)
    assert (first.name, first.duration) == ("own 1", pytest.approx(1.5))
    assert second.role == "held-out"
    assert np.allclose(first.command["position"][:, 0], goal(first.t + 0.5), atol=1e-8)
    for key, value, said in (
        ("topic", "nothing", "no topic in own_0.mcap named 'nothing'"),
        ("topic", "", "must name its topic in the bag"),
        ("column", "position[knee]", "named 'knee'; available: pivot"),
        ("column", "angle", "no field on /arm/state named 'angle'"),
        ("column", "position[3]", "there are 1 elements"),
        ("column", "position", "is no number"),
        ("column", "header.stamp]", "no path of a field"),
    ):
        changed = {**rules, "columns": [{**rules["columns"][0], key: value}]}
        path.write_text(yaml.safe_dump(changed))
        refused(folder, SERVO, said, path)


def test_records_of_our_topics_can_be_cut(tmp_path):
    topics = {"joint_states": (STATES, 100), "joint_command": (COMMANDS, 100)}
    folder = bag(tmp_path / "cut", **topics)
    path = tmp_path / "m.yaml"
    path.write_text("records: [{name: late, from: 1.0, overrides: {fixed_base: true}}]")
    (made,) = gap_import.load(folder, SERVO, path)
    assert (made.name, len(made.t), made.overrides) == ("late", 200, {"fixed_base": True})
    path.write_text("records: [{rows: [0, 9]}]")
    refused(folder, SERVO, "cut by from and to, not by rows", path)
    path.write_text("records: [{file: other.mcap}]")
    refused(folder, SERVO, "no record of", path)


def test_how_the_robot_was_held_is_known_but_not_its_effects(tmp_path):
    topics = {"joint_states": (STATES, 100), "joint_command": (COMMANDS, 100)}
    text = yaml.safe_dump(
        {"effects": [{"name": "x"}], "overrides": {"fixed_base": True, "drives.pivot.kp": 1.0}}
    )
    folder = bag(tmp_path / "held", attach={"experiment.yaml": text}, **topics)
    assert gap_import.load(folder, SERVO)[0].overrides == {"fixed_base": True}


def test_clocks_are_told(tmp_path):
    topics = {"joint_states": (STATES, 100), "joint_command": (COMMANDS, 100)}
    (made,) = gap_import.load(bag(tmp_path / "late", late=0.02, **topics), SERVO)
    assert "/joint_states was logged 20.0 ms after its stamps" in made.notes

    def unstamped(t):
        return JointState(name=["pivot"], position=[angle(t)])

    topics["joint_states"] = (unstamped, 100)
    (made,) = gap_import.load(bag(tmp_path / "none", **topics), SERVO)
    assert any("has no stamps" in note for note in made.notes) and len(made.t) == 300


MAPPED = """columns:
- {topic: /state, column: "position[pivot]", role: q, joint: pivot}
- {topic: /told, column: "position[pivot]", role: command_position, joint: pivot}
"""


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("stamp", [lambda t: t + 1.7e9, lambda t: 0.5 * t - 300.0, None])
def test_stamps_of_two_clocks_give_way_to_that_of_the_log(tmp_path, stamp, mapped):
    """As of a simulation and of the computer: stamps of one topic, or none, beside another's."""

    def states(t):
        return stamped(STATES(t), 1e3 + stamp(t) if stamp else 0.0)

    def commands(t):
        return stamped(COMMANDS(t), t + (0.0 if stamp else 1e6))

    names = ("state", "told") if mapped else ("joint_states", "joint_command")
    folder = bag(tmp_path / "two", **{names[0]: (states, 100), names[1]: (commands, 100)})
    rules = tmp_path / "mapping.yaml"
    rules.write_text(MAPPED)
    (made,) = gap_import.load(folder, SERVO, rules if mapped else None)
    told = [note for note in made.notes if "the log's clock" in note or "no stamps" in note]
    assert len(told) == 2 and len(made.t) == 300
    assert np.allclose(made.signals["q"][:, 0], angle(made.t), atol=1e-6)
    assert np.allclose(made.command["position"][:, 0], goal(made.t), atol=1e-6)


@pytest.mark.parametrize("name", ["left_pivot", "pivot_joint", "/arm/pivot"])
def test_joints_with_a_prefix_are_read_by_the_names_of_the_model(tmp_path, name):
    states, commands = (joints([name, "wheel"], position=of) for of in (angle, goal))
    folder = bag(tmp_path / "one", joint_states=(states, 100), joint_command=(commands, 100))
    (made,) = gap_import.load(folder, SERVO)
    assert any(f"{name} as pivot" in note for note in made.notes)
    assert any("wheel: not in the model" in note for note in made.notes)
    states, commands = (joints(["left_pivot", "right_pivot"], position=of) for of in (angle, goal))
    two = bag(tmp_path / "two", joint_states=(states, 100), joint_command=(commands, 100))
    refused(two, SERVO, "joints left_pivot, right_pivot are not those of")


def test_bags_that_cannot_be_used(tmp_path):
    good = {"joint_states": (STATES, 100), "joint_command": (COMMANDS, 100)}

    def spoilt(name, said, **changes):
        topics = {k: v for k, v in (good | changes).items() if v is not None}
        refused(bag(tmp_path / name, **topics), SERVO, said)

    def states(names=("pivot",), **fields):
        return joints(names, **fields), 100

    turned = states(position=angle, velocity=lambda t: np.degrees(speed(t)))
    spoilt("quiet", "no messages on /joint_command, role command is missing", joint_command=None)
    spoilt("blind", "no messages on joint_states", joint_states=None)
    spoilt("nan", "q of pivot has only NaN", joint_states=states(position=lambda t: np.nan))
    spoilt("stuck", "constant at 0.1", joint_states=states(position=lambda t: 0.1))
    spoilt("other", "joints wheel are not those of", joint_states=states(["wheel"], position=angle))
    spoilt("degrees", "dq is in deg/s", joint_states=turned)
    refused(bag(tmp_path / "short", seconds=0.2, **good), SERVO, "too short")


def test_what_is_no_recording(tmp_path):
    with pytest.raises(MissingFileError, match="no recording at"):
        gap_import.load(tmp_path / "none", SERVO)
    (tmp_path / "a.png").write_text("")
    refused(tmp_path / "a.png", SERVO, r"a.png is no recording: wanted are .mcap")
    (tmp_path / "echo.yaml").write_text("position:\n- 0.1\n---\n")
    refused(tmp_path / "echo.yaml", SERVO, "a file of `ros2 topic echo` needs the ending .txt")
    (tmp_path / "a.csv").write_text("t,q\n0,1\n")
    refused(tmp_path / "a.csv", SERVO, "needs a mapping that says what its columns are")


@pytest.mark.parametrize("name", ["sine", "bound", "walk", "bound_plain", "walk_plain"])
def test_the_recordings_of_the_surrogate_raise_no_alarm(repository, name):
    (made,) = gap_import.load(repository / f"bags/surrogate_{name}", TIGRILLO)
    assert 1.0 / made.dt == pytest.approx(100.0) and made.joints == TIGRILLO.joints
    assert np.all(np.isfinite(made.joints_of(TIGRILLO, "q")))
    assert made.step("q") == pytest.approx(0.00506)
    lag = next(note for note in made.notes if note.startswith("motion is behind"))
    assert float(lag.split("about ")[1].split()[0]) > 100.0


def test_the_graph_of_hyq(tmp_path):
    experiment = load_experiment(
        "hyq_short", {"learner.train": 0.3, "learner.closing": 0.1, "learner.test": 0.1}
    )
    run_rollout(experiment, tmp_path / "trot", lambda progress: None)
    hyq = robots.load("hyq")
    (made,) = gap_import.load(tmp_path / "trot", hyq)
    log = read_log(Bag(tmp_path / "trot"))
    assert np.array_equal(made.signals["q"], log.q)
    assert np.array_equal(made.signals["tau"], log.tau)
    assert np.array_equal(made.signals["grf"], log.grf[:, :, 2])
    assert np.array_equal(made.command["position"], log.command)
    assert np.array_equal(made.command["torque"], log.trunk_tau)
    assert made.joints == hyq.joints and made.feet == hyq.feet
    assert made.simulated == 1e-3
    refused(tmp_path / "trot", TIGRILLO, "12 values of q, the robot has 8")


def test_steps_of_a_simulation_are_read_and_told(tmp_path):
    topics = {"joint_states": (STATES, 100), "joint_command": (COMMANDS, 100)}

    def read(name, **about):
        (made,) = gap_import.load(bag(tmp_path / name, about=about, **topics), SERVO)
        return made.simulated, any("steps of" in note for note in made.notes)

    assert read("coarse", physics_step="0.001") == (1e-3, True)
    assert read("fine", physics_step="0.000125") == (1.25e-4, False)
    for name, said in (("word", "fast"), ("endless", "inf"), ("negative", "-1"), ("nan", "nan")):
        assert read(name, physics_step=said) == (0.0, False)
    assert read("machine", physics_step="0.001", hardware="bus: x") == (0.0, False)
    assert read("silent") == (0.0, False)


@pytest.mark.pybullet
def test_gains_of_stance_and_torques_of_the_trunk_reach_the_model_of_hyq(tmp_path):
    """HyQ bolted in the air treads under its trunk controller; the same model says the same."""
    held = {"overrides": {"fixed_base": True, "height": 1.0}, "gait.start_time": 0.1}
    experiment = load_experiment("hyq_trot_open", {**held, "duration": 1.2})
    run_rollout(experiment, tmp_path / "tread", lambda progress: None)
    (made,) = gap_import.load(tmp_path / "tread", robots.load("hyq"))
    assert made.overrides == held["overrides"]
    stance = made.stance_of(made.feet)
    assert {tuple(row) for row in stance.tolist()} > {(True, False, False, True)}
    assert np.ptp(made.command["torque"], axis=0).max() > 1.0

    def worst(record):
        forward = Forward(Model("hyq"), [record], ForwardParams(burn_in=0.0))
        return np.nanmax(np.abs(forward()[0] - forward.measured[0]))

    assert worst(made) < 1e-3
    assert worst(replace(made, stance={})) > 1.0
    command = {kind: v for kind, v in made.command.items() if kind != "torque"}
    assert worst(replace(made, command=command)) > 1.0


def in_turn(*kinds):
    """Function of time that makes messages of several publishers one after the other."""
    turn = iter(range(10**9))
    return lambda t: kinds[next(turn) % len(kinds)](t)


@pytest.mark.parametrize("fingers", [["finger"], ["left_finger", "right_finger"], []])
def test_publishers_of_joints_of_their_own_share_a_topic(tmp_path, fingers):
    states = in_turn(STATES, joints(fingers, position=lambda t: 0.3))
    path = bag(tmp_path / "a", joint_states=(states, 200), joint_command=(COMMANDS, 100))
    (made,) = gap_import.load(path, SERVO)
    assert made.joints == ("pivot",)
    q, at = made.signals["q"][:, 0], np.isfinite(made.signals["q"][:, 0])
    (alone,) = gap_import.load(
        bag(tmp_path / "b", joint_states=(STATES, 100), joint_command=(COMMANDS, 100)), SERVO
    )
    off = np.interp(made.t, alone.t, alone.signals["q"][:, 0])[at] - q[at]
    assert np.max(np.abs(off)) < 0.8 * 6.0 * 0.02  # no finger's 0.3 is among them
    assert at.sum() > 50
    if fingers:
        words = f"{', '.join(fingers)}: not in the model"
        assert any(note.startswith(words) for note in made.notes)


def test_a_joint_of_two_publishers_is_told_and_not_mixed(tmp_path):
    zeros = joints(["pivot", "finger"], position=lambda t: 0.0)
    states = in_turn(STATES, zeros)
    path = bag(tmp_path / "a", joint_states=(states, 200), joint_command=(COMMANDS, 100))
    refused(path, SERVO, "joint_states tells of pivot in messages with different joints")


def sometimes(main, other, each):
    """Function of time that makes messages of one publisher, and each so manieth of another."""
    turn = iter(range(10**9))
    return lambda t: (main if next(turn) % each else other)(t)


@pytest.mark.parametrize("value", [0.0, 0.25])
@pytest.mark.parametrize("fields", [("position",), ("position", "velocity")])
def test_a_second_publisher_of_the_same_joints_is_told_and_left_out_by_the_users_word(
    tmp_path, value, fields
):
    """A joint_state_publisher: it has no speeds, or zeros, which are no readings of the joint."""
    other = joints(["pivot"], **{f: lambda t, f=f: value * (f == "position") for f in fields})
    states = sometimes(STATES, other, 11)
    path = bag(tmp_path / "a", joint_states=(states, 110), joint_command=(COMMANDS, 100))
    words = f"q of pivot: 30 of 330 readings are {value:g}, at 10 Hz, .*missing: {value:g} in the"
    refused(path, SERVO, words)
    for rules in (
        {"missing": value},
        {"columns": [
            {"topic": "/joint_states", "column": "position[pivot]", "role": "q", "joint": "pivot",
             "missing": value},
            {"topic": "/joint_command", "column": "position[pivot]", "joint": "pivot",
             "role": "command_position"},
        ]},
    ):  # fmt: skip
        (path / "mapping.yaml").write_text(yaml.safe_dump(rules))
        (made,) = gap_import.load(path, SERVO)
        assert any("30 of 330 readings are" in n and "left out" in n for n in made.notes)
        known = np.isfinite(made.signals["q"][:, 0])
        assert np.max(np.abs(made.signals["q"][known, 0] - angle(made.t[known]))) < 2e-3
    if "velocity" in fields:
        return
    (path / "mapping.yaml").write_text(yaml.safe_dump({"missing": value}))
    (made,) = gap_import.load(path, SERVO)
    known = np.isfinite(made.signals["dq"][:, 0])
    assert np.max(np.abs(made.signals["dq"][known, 0] - speed(made.t[known]))) < 2e-2


@pytest.mark.parametrize("column", ["position[pivot]", "position[0]", "velocity[pivot]"])
def test_a_mapped_field_of_two_publishers_is_not_mixed(tmp_path, column):
    zeros = joints(["finger", "pivot"], position=lambda t: 0.0, velocity=lambda t: 0.0)
    path = bag(tmp_path / "a", joint_states=(in_turn(STATES, zeros), 200))
    source = FieldSource(Bag(path), "a")
    with pytest.raises(LocoError, match="300 and 300 of them.: two publishers"):
        source.series(Column(column, "q", "pivot", topic="joint_states"))


def test_a_field_by_name_is_read_where_the_message_has_it(tmp_path):
    states = in_turn(STATES, joints(["finger"], position=lambda t: 0.3))
    path = bag(tmp_path / "a", joint_states=(states, 200), joint_command=(COMMANDS, 100))
    source = FieldSource(Bag(path), "a")
    t, q = source.series(Column("position[pivot]", "q", "pivot", topic="joint_states"))
    assert len(t) == len(q) == len(source.series(
        Column("position[finger]", "q", "finger", topic="joint_states"))[0])  # fmt: skip
    assert np.allclose(q, [angle(at) for at in t], atol=1e-6)
    with pytest.raises(LocoError, match="'thumb'"):
        source.series(Column("position[thumb]", "q", "thumb", topic="joint_states"))


@pytest.mark.parametrize("late", [0.03, 0.25, 1.7e9])
def test_the_clock_of_a_topic_can_be_chosen_and_the_delay_is_told(tmp_path, late):
    folder = bag(tmp_path / "a", late=late, states=(STATES, 100), goals=(array, 100))
    columns = [
        {"topic": "/states", "column": "position[pivot]", "role": "q", "joint": "pivot"},
        {"topic": "/goals", "column": "data[1]", "role": "command_position", "joint": "pivot"},
    ]
    columns[1]["unit"] = "deg"
    path = tmp_path / "m.yaml"
    path.write_text(yaml.safe_dump({"columns": columns}))
    (made,) = gap_import.load(folder, SERVO, path)
    told = f"was logged {1e3 * late:.1f} ms" if late < 1e3 else f"by the log's clock, {late:.6g} s"
    assert any(note.startswith("/states") and told in note for note in made.notes)
    assert "/goals has no stamps: the times of logging were taken" in made.notes
    for which in ("log", "receive"):
        path.write_text(yaml.safe_dump({"columns": [{**c, "clock": which} for c in columns]}))
        (made,) = gap_import.load(folder, SERVO, path)
        assert any("goes by the log's clock" in note for note in made.notes)
        assert np.allclose(made.signals["q"][:, 0], angle(made.t), atol=1e-4)
    columns[1]["clock"] = "stamp"
    path.write_text(yaml.safe_dump({"columns": columns}))
    refused(folder, SERVO, "goals has no stamps for clock: stamp; say clock: log", path)
    columns[1]["clock"] = "wall"
    path.write_text(yaml.safe_dump({"columns": columns}))
    refused(folder, SERVO, "must be stamp, log or receive.*got 'wall'", path)
