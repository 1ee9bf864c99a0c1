# SPDX-License-Identifier: Apache-2.0
"""The calibrator alone, over real DDS: mistakes in a goal, a bag, a robot of a few lines."""

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from sensor_msgs.msg import JointState

from loco_bringup.bag.writer import BagWriter
from loco_bringup.live.calibrator import CalibratorNode
from loco_bringup.logs.rollout_bag import write_messages as write_log
from loco_control.ros.messages.calibration_topics import CALIBRATION_TOPICS
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.topics import to_stamp
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout
from loco_msgs.action import Calibrate
from loco_sim.plant import model as models
from loco_sim.robot import robot as robots

from .conftest import Caller

pytestmark = pytest.mark.ros

PARAMETERS = {
    "listen.patience": 1.5,
    "listen.skip": 0.0,
    "calibration.skip": 1.0,
    "calibration.periods": 1,
    "calibration.population": 2,
    "calibration.generations": 1,
}


class Calibrating(Caller):
    """A calibrator, and a client of its action."""

    def __init__(self, bench, folder):
        made = bench(CalibratorNode, CALIBRATION_TOPICS, folders=f'["{folder}"]', **PARAMETERS)
        self.states, self._robots = made.listen("calibration"), []
        super().__init__(made, Calibrate, "calibrate")

    def robot(self, namespace):
        """A robot to listen to."""
        self._robots.append(Robot(self.bench, namespace))
        return self._robots[-1]

    def close(self):
        """Nobody may hear of us in the next test, even if our node lives on for a while."""
        for robot in self._robots:
            robot.close()
        super().close()


@pytest.fixture
def caller(bench, tmp_path_factory):
    made = Calibrating(bench, tmp_path_factory.getbasetemp())
    yield made
    made.close()


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A recorded robot with other springs."""
    experiment = load(
        "tigrillo_sine",
        {
            "duration": 6.0,
            "target.frequency": 1.0,
            "target.offset": [0.0],
            "target.amplitude": [0.35],
            "overrides": {"springs.[lr]h_kfe_joint.stiffness": 440.0},
        },
    )
    writer = BagWriter(tmp_path_factory.mktemp("bag") / "bag")
    write_log(rollout(experiment), writer)
    writer.close()
    return writer.folder


def test_every_mistake_in_a_goal_is_one_clear_line(caller, tmp_path):
    goals = [
        ({}, "namespace of a measured robot, or a bag"),
        ({"measured": "/nobody"}, "nobody publishes /nobody/joint_states; there are robots in"),
        ({"measured": "/x", "robot": "tiger"}, "tigrillo"),
        ({"measured": "/x", "parameter_set": "eleven"}, "seven, ten"),
        ({"measured": "/x", "loss": "lost"}, "author, thesis"),
        ({"bag": str(tmp_path / "none")}, "no bag at"),
        ({"bag": "/etc/hosts"}, "bag '/etc/hosts' is not below"),
        ({"measured": "/x", "robot": "../tiger/robot.yaml"}, "is not below"),
        ({"measured": "/x", "duration": -1.0}, "duration must be in (0, 10000] s"),
        *(
            ({"measured": name}, "a namespace has letters, digits and _")
            for name in ("..", "/1x", "a//b", "a b", "~", "é", "x/" + "y" * 300)
        ),
        ({"bag": str(tmp_path), "model": "/{x}"}, "a namespace has letters, digits and _"),
    ]
    for goal, text in goals:
        status, result = caller.result(caller.send(**goal))
        assert status == GoalStatus.STATUS_ABORTED, goal
        assert text in result.message, goal
        assert "\n" not in result.message
        assert result.model_yaml == ""
        caller.bench.wait(lambda message=result.message: caller.states[-1].text == message)
        assert caller.states[-1].phase == "failed"


def test_whatever_goes_wrong_while_a_goal_waits_ends_the_goal_and_not_the_node(caller):
    caller.bench.node.count_publishers = lambda name: 1 / 0
    status, result = caller.result(caller.send(measured="/x"))
    assert (status, result.message) == (GoalStatus.STATUS_ABORTED, "the goal cannot be run")
    del caller.bench.node.count_publishers
    status, result = caller.result(caller.send(measured="/x"))
    assert "nobody publishes /x/joint_states" in result.message


def test_a_bag_is_fitted_with_feedback_and_a_result(caller, bag):
    status, result = caller.result(caller.send(bag=str(bag), generations=2, population=3))
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert [f.generation for f in caller.feedback] == [1, 2]
    assert [f.evaluations for f in caller.feedback] == [3, 6]
    assert result.loss_after <= result.loss_before
    if result.model_yaml:
        assert models.loads(result.model_yaml).robot == "tigrillo"
        assert len(result.names) == len(result.values) == 7
    caller.bench.wait(lambda: caller.states[-1].phase == "done")
    assert [s.phase for s in caller.states][:2] == ["listening", "fitting"]


class Robot:
    """Says joint states and commands in a namespace, as fast as they are heard."""

    def __init__(self, bench, namespace):
        self._node, self._executor = bench.tester, bench.executor
        self.joints = robots.load("tigrillo")
        self.names = list(self.joints.joints)
        self.driven = [self.names[i] for i in self.joints.driven]
        self.tick = 0
        self._publishers = {
            name: self._node.create_publisher(
                JointState, f"{namespace}/{name}", JOINT_TOPICS[name].qos.writer()
            )
            for name in ("joint_states", "joint_command")
        }

    def close(self):
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers.clear()

    def heard(self):
        return all(p.get_subscription_count() > 0 for p in self._publishers.values())

    def step(self, names=None):
        t = self.tick / 100
        angle = float(np.sin(2 * np.pi * 2.0 * t))
        for name, joints in (("joint_states", names or self.names), ("joint_command", self.driven)):
            message = JointState(name=joints, position=[0.3 * angle + 0.7] * len(joints))
            message.header.stamp = to_stamp(t)
            self._publishers[name].publish(message)
        self.tick += 1
        for _ in range(8):  # or what was said piles up in front of what is waited for
            self._executor.spin_once(timeout_sec=0.0)


def test_cancel_while_it_listens_and_a_second_goal_meanwhile(caller):
    robot = caller.robot("/real")
    handle = caller.send(measured="real", duration=1e4)
    caller.bench.wait(robot.heard)
    status, result = caller.result(caller.send(measured="real"), robot.step)
    assert status == GoalStatus.STATUS_ABORTED
    assert "a calibration is running" in result.message
    handle.cancel_goal_async()
    status, result = caller.result(handle, robot.step)
    assert status == GoalStatus.STATUS_CANCELED
    assert "cancelled" in result.message
    caller.bench.wait(lambda: caller.states[-1].phase == "cancelled")


def test_a_robot_that_falls_silent_ends_the_goal(caller):
    robot = caller.robot("/real")
    handle = caller.send(measured="/real", duration=1e4)
    caller.bench.wait(robot.heard)
    robot.step()
    status, result = caller.result(handle)
    assert status == GoalStatus.STATUS_ABORTED
    assert "silent for 1.5 s" in result.message


def test_a_robot_with_other_joints_ends_the_goal(caller):
    robot = caller.robot("/real")
    handle = caller.send(measured="/real", duration=1e4)
    wheels = ["wheel"] * len(robot.names)
    status, result = caller.result(handle, lambda: robot.step(wheels))
    assert status == GoalStatus.STATUS_ABORTED
    assert "no joint in /real/joint_states named 'wheel'" in result.message


def test_equal_robots_have_no_gap(caller):
    gaps = caller.bench.listen("gap")
    both = [caller.robot(f"/{name}") for name in ("real", "twin")]
    handle = caller.send(measured="/real", model="/twin", duration=1e4)
    caller.bench.wait(lambda: all(robot.heard() for robot in both))

    def go_on():
        for robot in both:
            robot.step()
        return len(gaps) >= 2

    caller.bench.wait(go_on)
    assert max(g.gap for g in gaps) < 0.05  # of four joints that swing 0.76 rad in all
    assert {len(g.joints) for g in gaps} == {4}
    assert all(name.endswith("kfe_joint") for name in gaps[0].names)
    handle.cancel_goal_async()
    caller.result(handle)
