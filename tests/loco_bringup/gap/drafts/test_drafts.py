# SPDX-License-Identifier: Apache-2.0
"""`loco gap mapping`: what it drafts is read by `loco gap` as it stands."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Float64, Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from loco_bringup.cli import main as cli
from loco_bringup.gap import importing
from loco_bringup.gap.drafts import terminal
from loco_bringup.gap.drafts.topics import READERS
from loco_control.exceptions import LocoError
from loco_learning.gap.drafting.joints import Joints
from loco_sim.robot import robot as robots

from ... import message_bag

SERVO = robots.load("servo_pendulum")


def goal(t):
    return 0.8 * np.sin(6.0 * t)


def states(t):
    message = JointState(name=["pivot", "finger"], position=[goal(t - 0.04), 0.3])
    message.header.stamp.sec, message.header.stamp.nanosec = int(t), round(t % 1 * 1e9)
    return message


def bag(folder, **topics):
    times = np.arange(300) / 100.0
    return message_bag.write(folder, **{name: (make, times) for name, make in topics.items()})


def call(*arguments):
    with pytest.raises(SystemExit) as end:
        cli.main(["gap", "mapping", *map(str, arguments)])
    return end.value.code


def test_the_draft_of_a_bag_reads_it(tmp_path, capsys):
    folder = bag(
        tmp_path / "a", arm__states=states,
        position_controller__commands=lambda t: Float64MultiArray(data=[goal(t)]),
    )  # fmt: skip
    path = tmp_path / "drafted.yaml"
    assert call(folder, "--robot", "servo_pendulum", "--out", path) == 0
    (record,) = importing.load(folder, SERVO, path)
    assert record.command["position"][:, 0] == pytest.approx(goal(record.t), abs=1e-8)
    assert record.signals["q"][:, 0] == pytest.approx(goal(record.t - 0.04), abs=1e-8)
    assert "in this order?" in path.read_text() and "joint: finger" not in path.read_text()
    capsys.readouterr()
    assert call(folder, "--out", path) == 2 and "is there already" in capsys.readouterr().err
    assert call(folder) == 0 and "finger" in capsys.readouterr().out


def test_a_bag_with_other_topics_is_refused_with_the_command_that_works(tmp_path, monkeypatch):
    folder = bag(
        tmp_path / "a", joint_states=states,
        position_controller__commands=lambda t: Float64MultiArray(data=[goal(t)]),
    )  # fmt: skip
    with pytest.raises(LocoError) as error:
        importing.load(folder, SERVO)
    (command,) = re.findall(r"`loco gap mapping (.*?)`", str(error.value))
    monkeypatch.chdir(tmp_path)
    assert call(*command.replace("ROBOT", "servo_pendulum").split()) == 0
    (record,) = importing.load(folder, SERVO, "mapping.yaml")
    assert record.command["position"][:, 0] == pytest.approx(goal(record.t), abs=1e-8)


def trajectory(t, points=1):
    point = JointTrajectoryPoint(positions=[0.0, goal(t)])
    return JointTrajectory(joint_names=["finger", "pivot"], points=[point] * points)


def gravity(t):
    message = Imu()
    message.linear_acceleration.z, message.angular_velocity.x = 9.8, goal(t)
    message.orientation_covariance[0] = -1.0
    return message


@pytest.mark.parametrize(
    "command",
    [
        {"arm__joint_trajectory": trajectory},
        {"arm__commands": lambda t: Float64MultiArray(data=[goal(t)])},
        {"pivot_position_controller__command": lambda t: Float64(data=goal(t))},
    ],
)
def test_a_bag_of_controllers_is_drafted_by_the_search_itself(tmp_path, command):
    folder = bag(tmp_path / "a", joint_states=states, imu__raw=gravity, **command)
    out = tmp_path / "out"
    robot, rules, notes = importing.drafted("servo_pendulum", [str(folder)], "", out)
    assert (robot, rules) == ("servo_pendulum", str(out / importing.MAPPING)) and len(notes) == 1
    (record,) = importing.load(folder, SERVO, rules)
    assert record.command["position"][:, 0] == pytest.approx(goal(record.t), abs=1e-8)
    assert record.signals["gyro"][:, 0] == pytest.approx(goal(record.t), abs=1e-8)
    assert "orientation" not in record.signals  # unknown
    known = bag(tmp_path / "b", joint_states=states, joint_command=states)
    assert importing.drafted("servo_pendulum", [str(known)], "", out)[1] == ""


def test_a_trajectory_of_several_points_is_no_command(tmp_path):
    folder = bag(tmp_path / "a", joint_states=states, joint_trajectory=lambda t: trajectory(t, 2))
    assert "# Missing: a command of pivot" in terminal.draft(folder, Joints(("pivot",)))


def test_the_state_of_a_trajectory_controller_has_both():
    point = SimpleNamespace(positions=[0.1, 0.2], velocities=[])
    message = SimpleNamespace(joint_names=["a", "b"], reference=point, feedback=point)
    lines = READERS["JointTrajectoryControllerState"]("/c/state", message, ())
    assert [(line.role, line.joint, line.column) for line in lines] == [
        ("command_position", "a", "reference.positions[0]"),
        ("command_position", "b", "reference.positions[1]"),
        ("q", "a", "feedback.positions[0]"),
        ("q", "b", "feedback.positions[1]"),
    ]


@pytest.mark.parametrize("where", ["file", "folder"])
def test_the_draft_of_a_table_reads_it(tmp_path, where):
    t = np.arange(300) / 100.0
    rows = [f"{a:.2f},{np.degrees(goal(a - 0.04)):.6f},{np.degrees(goal(a)):.6f}" for a in t]
    (tmp_path / "run.csv").write_text("t,pivot_pos,pivot_cmd\n" + "\n".join(rows) + "\n")
    path = tmp_path / "run.csv" if where == "file" else tmp_path
    (tmp_path / "mapping.yaml").write_text(terminal.draft(path, Joints(("pivot",))))
    (record,) = importing.load(path, SERVO)
    assert record.signals["q"][:, 0] == pytest.approx(goal(record.t - 0.04), abs=1e-6)


def test_what_is_no_recording_is_one_line(tmp_path):
    for path, words in ((tmp_path / "no", "no recording at"), (tmp_path, "is no recording")):
        with pytest.raises(LocoError, match=words):
            terminal.draft(path, Joints())
    with pytest.raises(LocoError, match="no name says what is measured or commanded; it has /x"):
        terminal.draft(bag(tmp_path / "a", x=lambda t: Float64MultiArray(data=[t])), Joints())


def test_joints_of_a_second_publisher_on_a_topic_are_drafted(tmp_path):
    def in_turn(t):
        message = states(t)
        if round(100.0 * t) % 2:
            message.name, message.position = ["wrist"], [goal(t)]
        return message

    folder = bag(tmp_path / "a", joint_states=in_turn, joint_command=states)
    text = terminal.draft(folder, Joints())
    for joint in ("pivot", "finger", "wrist"):
        assert f'column: "position[{joint}]", role: q, joint: {joint}}}' in text
    assert "Also q" not in text
    with pytest.raises(
        LocoError, match="no joint of the robot .*elbow.* is named in: pivot, finger, wrist"
    ):
        terminal.draft(folder, Joints(("elbow",)))


def test_a_description_gives_the_joints_of_a_draft(tmp_path, capsys):
    table = tmp_path / "a.csv"
    table.write_text("t,pos\n" + "".join(f"{i / 100},{goal(i / 100)}\n" for i in range(99)))
    (tmp_path / "a.urdf").write_text(SERVO.urdf)
    assert call(table, "--robot", tmp_path / "a.urdf") == 0
    assert "joint: pivot}  # “pos”, the only joint" in capsys.readouterr().out
    other = table.rename(tmp_path / "a.traj")
    assert call(other) == 2 and "give a text of rows the ending .txt" in capsys.readouterr().err
