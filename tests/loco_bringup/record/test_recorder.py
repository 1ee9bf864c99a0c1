# SPDX-License-Identifier: Apache-2.0
"""One recorder, two robots in their namespaces, one bag."""

import time

import numpy as np
import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from loco_bringup.bag.reader import Bag
from loco_bringup.record.recorder import RecorderNode
from loco_control.exceptions import LocoError
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.topics import to_stamp

pytestmark = pytest.mark.ros

ROBOTS = ("measured", "model")
TOPICS = ("joint_states", "events")


class Robot:
    """Publishes joint states in a namespace and hears what the recorder says there."""

    def __init__(self, executor, namespace):
        self.node = rclpy.create_node("robot_sim", namespace=namespace)
        executor.add_node(self.node)
        self.states = self._publisher("joint_states")
        self.statuses, self.events = [], []
        self._listen("recorder_status", self.statuses)
        self._listen("events", self.events)

    def _publisher(self, name):
        row = JOINT_TOPICS[name]
        return self.node.create_publisher(row.type, name, row.qos.writer())

    def _listen(self, name, heard):
        row = JOINT_TOPICS[name]
        self.node.create_subscription(row.type, name, heard.append, row.qos.reader(100))

    def publish(self, tick, angle):
        message = JointState(name=["knee"], position=[angle], velocity=[0.0], effort=[0.0])
        message.header.stamp = to_stamp(tick / 100)
        self.states.publish(message)


def start(folder, **parameters):
    """Recorder with these parameters, as the command line would set them."""
    values = {"bag": str(folder), "topics": list(TOPICS), **parameters}
    arguments = ["--ros-args"]
    for name, value in values.items():
        text = str(value).replace("'", '"') if not isinstance(value, str) else value
        arguments += ["-p", f"{name}:={text}"]
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    return RecorderNode()


def wait(executor, condition, timeout=20.0):
    end = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < end, "timed out"
        executor.spin_once(timeout_sec=0.02)


@pytest.fixture
def ros():
    yield
    rclpy.try_shutdown()


def test_two_robots_go_into_one_bag_and_hear_of_their_own_ticks(ros, tmp_path):
    recorder = start(tmp_path / "bag", table="joint", namespaces=list(ROBOTS), control_rate=100.0)
    executor = EventsExecutor()
    executor.add_node(recorder)
    robots = {name: Robot(executor, name) for name in ROBOTS}
    ready = lambda: all(any(e.kind == "ready" for e in r.events) for r in robots.values())  # noqa: E731
    wait(executor, ready)
    lengths = {"measured": 50, "model": 30}
    for name, length in lengths.items():
        for tick in range(length):
            if (name, tick) != ("model", 7):  # a message that got lost
                robots[name].publish(tick, len(name) + tick / 100)
    wait(
        executor,
        lambda: all(
            r.statuses and r.statuses[-1].tick == lengths[n] - 1 for n, r in robots.items()
        ),
    )
    recorder.close()
    recorder.destroy_node()
    for robot in robots.values():
        robot.node.destroy_node()
    bag = Bag(tmp_path / "bag")
    for name, length in lengths.items():
        states = bag.records(f"/{name}/joint_states")
        expected = len(name) + np.delete(np.arange(length), 7 if name == "model" else []) / 100
        np.testing.assert_array_equal(states["position"][:, 0], expected)
    assert bag.metadata["dropped"] == "1"
    assert {f"/{n}/{t}" for n in ROBOTS for t in TOPICS} == set(bag.topics)


def test_what_is_not_written_is_heard_all_the_same(ros, tmp_path):
    recorder = start(tmp_path / "bag", table="joint", control_rate=100.0, written=["events"])
    executor = EventsExecutor()
    executor.add_node(recorder)
    robot = Robot(executor, "")
    wait(executor, lambda: any(e.kind == "ready" for e in robot.events))
    for tick in range(5):
        robot.publish(tick, 0.0)
    wait(executor, lambda: robot.statuses and robot.statuses[-1].tick == 4)
    recorder.close()
    recorder.destroy_node()
    robot.node.destroy_node()
    assert set(Bag(tmp_path / "bag").topics) == {"/events"}


def test_what_has_arrived_before_the_stop_is_in_the_bag(ros, tmp_path):
    recorder = start(tmp_path / "bag", table="joint", control_rate=100.0)
    executor = EventsExecutor()
    executor.add_node(recorder)
    robot = Robot(executor, "")
    wait(executor, lambda: any(e.kind == "ready" for e in robot.events))
    for tick in range(40):
        robot.publish(tick, tick / 100)
    time.sleep(0.5)  # the recorder handles none of them; its readers have them
    rclpy.shutdown()
    recorder.close()
    states = Bag(tmp_path / "bag").records("joint_states")
    np.testing.assert_array_equal(states["position"][:, 0], np.arange(40) / 100)


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"namespaces": ["a", "a"]}, "must differ"),
        ({"namespaces": ["a", "b"], "tables": ["joint", "joint", "joint"]}, "one for each"),
        ({"table": "tortoise"}, "hyq"),
        ({"table": "joint", "topics": ["robot_state"]}, "joint_states"),
        ({"table": "joint", "written": ["robot_state"]}, "joint_states"),
    ],
)
def test_bad_parameters_are_named_and_leave_no_bag(ros, tmp_path, parameters, text):
    with pytest.raises(LocoError, match=text):
        start(tmp_path / "bag", **parameters)
    assert not (tmp_path / "bag").exists()
