# SPDX-License-Identifier: Apache-2.0
"""The latched emergency stop of a plant node, over real DDS."""

import time
from types import SimpleNamespace

import numpy as np
import pytest
from std_msgs.msg import Bool, Empty
from std_srvs.srv import SetBool

from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_msgs.msg import Event
from loco_sim.ros import estop
from loco_sim.ros.joint_sim_node import JointSimNode

pytestmark = pytest.mark.ros


class Plant:
    """A plant of which every state is answered, and the ways to stop it."""

    def __init__(self, bench, **parameters):
        self.b = bench(JointSimNode, JOINT_TOPICS, **parameters)
        robot = self.b.node.sim.robot
        self.rest, names = robot.standing[robot.driven], [robot.joints[i] for i in robot.driven]
        self.driven = robot.driven
        self.pack = JointCodec(names, fields=("position", "velocity")).pack
        self.events, self.states = self.b.listen("events"), self.b.listen("joint_states")
        self.b.listen("joint_states"), self.b.listen("imu/data")
        self.commands, self.stop = self.b.publisher("joint_command"), self.b.publisher("estop")
        self.service = self.b.tester.create_client(SetBool, "set_estop")
        ready = self.b.publisher("events")
        self.b.wait(lambda: any(e.kind == "ready" for e in self.events))
        for name in JointSimNode.controllers[1:]:
            ready.publish(Event(node=name, kind="ready"))
        self.b.wait(lambda: self.states)

    def said(self):
        return [(e.kind, e.text) for e in self.events if e.kind.startswith("estop")]

    def tick(self, answer):
        count, stamp = len(self.states), self.states[-1].header.stamp
        self.commands.publish(self.pack(stamp.sec + stamp.nanosec * 1e-9, answer, 0.0 * answer))
        self.b.wait(lambda: len(self.states) > count)
        return np.array(self.states[-1].position)[self.driven]

    def say(self, stops):
        """On the topic; until it was heard."""
        self.stop.publish(Bool(data=stops))
        for _ in range(30):
            self.b.executor.spin_once(timeout_sec=0.01)

    def call(self, stops):
        self.b.wait(self.service.service_is_ready)
        return self.b.answer(lambda: self.service.call_async(SetBool.Request(data=stops)))


def test_false_on_the_topic_does_nothing_before_and_after_a_stop(bench):
    plant = Plant(bench)
    plant.say(False)
    assert plant.said() == []
    before = plant.tick(plant.rest)
    for _ in range(20):
        moved = plant.tick(plant.rest + 0.4)
    assert np.abs(moved - before).max() > 0.05  # it was not stopped
    plant.say(True)
    plant.say(False)
    assert plant.said() == [("estop", "topic estop")]
    assert plant.b.node.diagnose()["estop"] == "topic estop"


def test_the_first_reason_stays_until_the_reset(bench):
    plant = Plant(bench)
    plant.say(True)
    answer = plant.call(True)
    assert answer.success and answer.message == "stopped: topic estop"
    plant.b.node._estop.engage("no command since tick 3")
    assert plant.said() == [("estop", "topic estop")]
    answer = plant.call(False)
    assert answer.success and answer.message == "reset; it was stopped by topic estop"
    assert "estop" not in plant.b.node.diagnose()
    answer = plant.call(False)
    assert not answer.success and answer.message == "it is not stopped"
    plant.call(True)
    plant.b.wait(lambda: len(plant.said()) == 3)
    assert [kind for kind, _ in plant.said()] == ["estop", "estop reset", "estop"]
    assert plant.said()[-1] == ("estop", "service set_estop")


def test_after_a_stop_the_first_command_is_limited_in_rate(bench):
    """Also where no command came before the stop, and where the old one is repeated."""
    plant = Plant(bench, **{"safety.rate": 0.5})
    plant.say(True)
    reading = plant.tick(plant.rest + 0.5)
    for _ in range(20):
        at, reading = reading, plant.tick(plant.rest + 0.5)  # at: where it was last held
    plant.call(False)
    assert plant.b.node.diagnose()["limited_rate"] == 0  # the stop itself limits nothing
    step = plant.b.node._safety._step[plant.driven]
    plant.tick(plant.rest + 0.5)
    assert plant.b.node.diagnose()["limited_rate"] == 1
    sent = plant.b.node._safety._past[0][plant.driven]
    assert np.all(np.abs(sent - at) <= step + 1e-12)


def test_a_silent_operator_stops_the_robot(bench):
    plant = Plant(bench, heartbeat=0.5)
    assert 0.5e9 / 4 in [timer.timer_period_ns for timer in plant.b.node.timers]
    beats = plant.b.publisher("heartbeat")
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        beats.publish(Empty())
        plant.b.executor.spin_once(timeout_sec=0.02)
    assert plant.said() == []
    plant.b.wait(plant.said)
    assert plant.said() == [("estop", "no heartbeat for 0.5 s")]
    plant.call(False)
    plant.b.wait(lambda: len(plant.said()) == 3)  # still silent: it stops again
    beats.publish(Empty())


def test_an_operator_may_fall_silent_before_the_start(bench):
    b = bench(JointSimNode, JOINT_TOPICS, heartbeat=0.2)
    events, beats = b.listen("events"), b.publisher("heartbeat")
    b.wait(lambda: beats.get_subscription_count())
    end = time.monotonic() + 1.0
    beats.publish(Empty())
    while time.monotonic() < end:
        b.executor.spin_once(timeout_sec=0.02)
    assert not [e for e in events if e.kind == "estop"]
    assert not b.node._estop.reason


def test_silence_is_what_is_longer_than_allowed_since_the_last_beat(monkeypatch):
    now, stops = [10.0], []
    node = SimpleNamespace(input=lambda *_: None, create_timer=lambda *_: None)
    monkeypatch.setattr(estop, "time", SimpleNamespace(monotonic=lambda: now[0]))
    heart = estop.Heartbeat(node, 0.5, stops.append)
    heart.start()
    for _ in range(3):
        now[0] += 0.5
        heart._check()
        assert not stops
        heart._on_beat(Empty())
    now[0] += 0.51
    heart._check()
    assert stops == ["no heartbeat for 0.5 s"]


def test_no_heartbeat_is_wanted_by_default(bench):
    plant = Plant(bench)
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        plant.b.executor.spin_once(timeout_sec=0.02)
    assert plant.said() == []
