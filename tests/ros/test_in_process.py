# SPDX-License-Identifier: Apache-2.0
"""Messages between nodes of one process: from neighbours once, to and from everyone else."""

import ast
import os
import subprocess
import sys
import time

import pytest
import rclpy
from rclpy.experimental import EventsExecutor
from std_msgs.msg import String

from loco_control.ros.in_process import Post
from loco_control.ros.messages.topics import topic


class Executor:
    """Keeps the tasks that it is given."""

    def __init__(self):
        self.tasks = []

    def create_task(self, task):
        self.tasks.append(task)


def test_a_message_is_handed_over_after_its_writer_is_done_and_in_order():
    executor, got = Executor(), []
    post = Post(executor)

    def answer(data):
        got.append(data)
        if data < b"3":
            post.put([answer, got.append], bytes([data[0] + 1]))
            got.append(b"done")

    post.put([answer], b"1")
    assert got == [] and len(executor.tasks) == 1  # one task for all that wait
    executor.tasks.pop()()
    assert got == [b"1", b"done", b"2", b"done", b"2", b"3", b"3"]
    assert not executor.tasks


def test_the_executor_gets_its_turn_between_messages_that_never_end():
    executor, count = Executor(), [0]
    post = Post(executor)

    def answer(data):
        count[0] += 1
        post.put([answer], data)

    post.put([answer], b"")
    for _ in range(3):
        before = count[0]
        executor.tasks.pop()()
        assert 0 < count[0] - before < 100
        assert len(executor.tasks) == 1


def test_a_node_with_deadlines_takes_messages_itself():
    executor, got = Executor(), []
    post = Post(executor)
    post.timed = True
    post.put([got.append, got.append], b"x")
    assert not executor.tasks and got == []
    assert post.hand_over() and post.hand_over() and not post.hand_over()
    assert got == [b"x", b"x"]


NEIGHBOURS = """
from loco_control.ros.executor import run_nodes
from loco_control.ros.node import LocoNode
from std_msgs.msg import String

class Speaker(LocoNode):  # answers what it hears on stance_estimator with its own description
    def __init__(self):
        super().__init__("speaker")
        self._said = self.output("robot_description")
        self._said.publish(String(data="latched"))
        self.input("stance_estimator", self._answer)

    def _answer(self, message):
        self._said.publish(String(data=message.data))

class Hearer(LocoNode):  # repeats on the topic events what it hears of its neighbour
    def __init__(self):
        super().__init__("hearer")
        self.raw = self.input("robot_description", self._hear)
        self.create_timer(0.1, self._tell)
        self.heard = []

    def _hear(self, message):
        self.heard.append(message.data)

    def _tell(self):
        self.event("heard so far", f"{self.raw.get_publisher_count()} {self.heard}")

raise SystemExit(run_nodes([Speaker, Hearer]))
"""


@pytest.mark.ros
def test_neighbours_hear_each_other_once_and_strangers_hear_and_are_heard():
    process = subprocess.Popen([sys.executable, "-c", NEIGHBOURS], env=fresh_environment())
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    try:
        stranger = rclpy.create_node("stranger", context=context)
        executor = EventsExecutor(context=context)
        executor.add_node(stranger)
        said, events = [], []
        for name, kind in (("robot_description", said), ("events", events)):
            row = topic(name)
            stranger.create_subscription(row.type, row.name, kind.append, row.qos.reader(100))
        row = topic("stance_estimator")
        question = stranger.create_publisher(row.type, row.name, row.qos.writer())
        wait(executor, lambda: question.get_subscription_count() == 1 and said and events)
        asked = [f"asked {number}" for number in range(600)]  # the first may come too early
        left = iter(asked)

        def heard():  # of its neighbour, as the node tells it
            return ast.literal_eval(events[-1].text.partition(" ")[2])

        def answered():
            question.publish(String(data=next(left)))
            return len(heard()) > 3

        wait(executor, answered, every=0.1)
        wait(executor, lambda: heard() == [m.data for m in said])
        assert heard()[0] == "latched"
        assert heard()[1:] == [text for text in asked if text in heard()]  # each once, in order
        assert events[-1].text.startswith("0 ")  # writers that it hears over DDS
        row = topic("robot_description")
        second = stranger.create_publisher(row.type, row.name, row.qos.writer())
        second.publish(String(data="from outside"))
        wait(executor, lambda: "from outside" in heard())
        assert events[-1].text.startswith("1 ")
        names = {
            i.node_name for i in stranger.get_subscriptions_info_by_topic("/robot_description")
        }
        assert names == {"hearer", "stranger"}  # tools see the reader as ever
    finally:
        process.terminate()
        process.wait()
        context.try_shutdown()


def wait(executor, condition, every=0.0, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "timed out"
        pause = time.monotonic() + every
        executor.spin_once(timeout_sec=0.05)
        while time.monotonic() < pause:
            executor.spin_once(timeout_sec=0.02)


def fresh_environment():
    env = dict(os.environ)
    for name in ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "FASTRTPS_DEFAULT_PROFILES_FILE"):
        env.pop(name, None)
    return env
