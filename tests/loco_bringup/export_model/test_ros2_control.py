# SPDX-License-Identifier: Apache-2.0
"""Files for ros2_control name what the robot and its topics have, and its commands drive a robot.

ros2_control itself is no Python package: a publisher that stamps commands as its topic-based
hardware interface does stands in for it.
"""

import dataclasses
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import yaml

import loco
from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run as runner
from loco_control.exceptions import ParameterError
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_learning.runs.experiment import load
from loco_sim.export import ros2_control
from loco_sim.export.portable import SERVO, TORQUE, portable
from loco_sim.plant.model import Model
from loco_sim.robot import robot as robots

POSE = 0.4  # [rad]


@pytest.mark.parametrize(
    ("name", "kind"),
    [("servo_pendulum", "position"), ("tigrillo", "position"), ("pendulum", "effort")],
)
def test_joints_interfaces_and_topics_are_those_of_the_robot(name, kind, tmp_path):
    loco.export_model(name, "ros2_control", tmp_path)
    robot = robots.load(name)
    driven = [robot.joints[i] for i in robot.driven]
    root = ET.parse(tmp_path / "robot.urdf").getroot()
    assert {j.get("name") for j in root.findall("joint")} >= set(robot.joints)
    control = root.find("ros2_control")
    assert [j.get("name") for j in control.findall("joint")] == driven
    for joint in control.findall("joint"):
        (command,) = joint.findall("command_interface")
        assert command.get("name") == kind
        start = float(command.find("param").text)
        wanted = robot.standing[robot.joints.index(joint.get("name"))]
        assert start == pytest.approx(wanted if kind == "position" else 0.0)
        measured = {each.get("name") for each in joint.findall("state_interface")}
        assert measured == {"position", "velocity", "effort"}
    said = {p.get("name"): p.text for p in control.find("hardware").findall("param")}
    states = JOINT_TOPICS[said["joint_states_topic"].removeprefix("/")]
    assert states.kind == "sensor_msgs/msg/JointState" and states.writer == "robot_sim"
    assert said["joint_commands_topic"].removeprefix("/") not in JOINT_TOPICS  # the guest's alone
    found = yaml.safe_load((tmp_path / "controllers.yaml").read_text())
    manager, own = (value["ros__parameters"] for value in found.values())
    assert manager["update_rate"] == robot.control_rate
    assert own["joints"] == driven and own["command_interfaces"] == [kind]
    assert next(reversed(found)).rpartition("/")[2] in manager


def test_a_robot_whose_drives_differ_is_refused():
    made = portable(Model("tigrillo"))
    first = made.joints.index(next(j for j in made.joints if j.kind == SERVO))
    made.joints[first] = dataclasses.replace(made.joints[first], kind=TORQUE)
    with pytest.raises(ParameterError, match="drives of positions and of torques.*--to urdf"):
        ros2_control.ros2_control(made)


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
def test_its_commands_drive_the_robot_tick_by_tick(tmp_path):
    import rclpy
    from sensor_msgs.msg import JointState

    loco.export_model("servo_pendulum", "ros2_control", tmp_path / "files")
    context = rclpy.Context()
    rclpy.init(context=context)  # it is there first: robots join controllers that run
    node = rclpy.create_node("stand_in", context=context)
    publisher = node.create_publisher(JointState, ros2_control.COMMANDS, 1)

    def speak(progress):
        message = JointState(name=["pivot"], position=[POSE])
        message.header.stamp = node.get_clock().now().to_msg()  # its own time
        publisher.publish(message)

    nodes = str(tmp_path / "files/nodes.yaml")
    try:
        outcome = runner.run(
            load("servo_pendulum_sine", {"duration": 4.0}), tmp_path / "bag", clock="realtime",
            nodes=nodes, on_progress=speak,
        )  # fmt: skip
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert not any(outcome.exit_codes.values()), outcome
    bag = Bag(tmp_path / "bag")
    q = np.array([s[0] for s in bag.records("/joint_states")["position"]])
    assert abs(q[-1] - POSE) < 0.2 < abs(q[-1])  # a soft servo that holds the rod
    stamps = {(m.header.stamp.sec, m.header.stamp.nanosec) for m in bag.messages("/joint_states")}
    answers = [(m.header.stamp.sec, m.header.stamp.nanosec) for m in bag.messages("/joint_command")]
    assert len(answers) > 200 and set(answers) <= stamps
