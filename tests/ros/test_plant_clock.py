# SPDX-License-Identifier: Apache-2.0
"""Clock realtime of a plant node: stalls, and commands that stay away."""

import time

import pytest

from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_msgs.msg import Event
from loco_sim.ros.joint_sim_node import JointSimNode
from loco_sim.ros.plant_node import FIRST

pytestmark = pytest.mark.ros


class Loop:
    """A plant in realtime, and a controller that answers each state as long as it wants."""

    def __init__(self, bench, **parameters):
        self.b = bench(JointSimNode, JOINT_TOPICS, clock="realtime", **parameters)
        robot = self.b.node.sim.robot
        self.rest = robot.standing[robot.driven]
        names = [robot.joints[i] for i in robot.driven]
        self.pack = JointCodec(names, fields=("position", "velocity")).pack
        self.events = self.b.listen("events")
        self.states = self.b.listen("joint_states")
        self.b.listen("joint_states")  # there are two controllers
        self.b.listen("imu/data")
        self.commands = self.b.publisher("joint_command")
        ready = self.b.publisher("events")
        self.b.wait(lambda: self.said("ready"))
        for name in JointSimNode.controllers[1:]:
            ready.publish(Event(node=name, kind="ready"))
        self.answered = 0

    def said(self, kind):
        return [e.text for e in self.events if e.kind == kind]

    def figures(self):
        return self.b.node.diagnose()

    def answer(self):
        if len(self.states) > self.answered:
            self.answered = len(self.states)
            stamp = self.states[-1].header.stamp
            t = stamp.sec + stamp.nanosec / 1e9
            self.commands.publish(self.pack(t, self.rest, 0.0 * self.rest))

    def due_ticks(self):
        """Time before, ticks that are done or dropped when all are that are due, time after."""
        before = time.monotonic()
        self.b.node.on_deadline()
        after = time.monotonic()
        return before, self.b.node.state.tick + self.figures()["dropped_ticks"], after

    def run(self, until, answer=True):
        def done():
            if answer:
                self.answer()
            return until()

        self.b.wait(done)


def test_ticks_begin_when_the_controllers_have_answered_and_follow_the_wall_clock(bench):
    loop = Loop(bench)
    loop.run(lambda: "missed_ticks" in loop.figures())
    assert loop.b.node.state.tick <= FIRST + 1
    begun = loop.due_ticks()
    until = time.monotonic() + 0.5
    loop.run(lambda: time.monotonic() > until)
    ended = loop.due_ticks()
    ticks = ended[1] - begun[1]
    assert 100.0 * (ended[0] - begun[2]) - 1 <= ticks <= 100.0 * (ended[2] - begun[0]) + 1


def test_a_stall_is_made_up_within_the_bound_and_the_rest_is_told_as_dropped(bench):
    loop = Loop(bench, catch_up=5)
    loop.run(lambda: "missed_ticks" in loop.figures())
    loop.run(lambda: loop.b.node.newest() > 10)
    before, at = loop.figures(), loop.b.node.state.tick
    time.sleep(0.5)
    loop.b.node.on_deadline()
    after = loop.figures()
    assert loop.b.node.state.tick - at == 5
    assert after["missed_ticks"] - before["missed_ticks"] >= 48
    assert after["dropped_ticks"] - before["dropped_ticks"] >= 44
    assert after["lateness_max_ms"] >= 480.0
    loop.run(lambda: loop.b.node.state.tick > at + 20)  # and it goes on


def test_commands_that_stay_away_are_held_then_damp_and_come_back(bench):
    loop = Loop(bench, command_timeout=0.1)
    loop.run(lambda: loop.b.node.newest() > 10)
    loop.run(lambda: loop.said("timeout"), answer=False)
    assert "no command since tick" in loop.said("timeout")[0]
    loop.run(lambda: len(loop.said("timeout")) > 1)
    assert "commands are back" in loop.said("timeout")[1]
    assert not loop.said("estop")


def test_a_safe_stop_stays_when_the_commands_are_back(bench):
    loop = Loop(bench, command_timeout=0.1, late="safe-stop")
    loop.run(lambda: loop.b.node.newest() > 10)
    loop.run(lambda: loop.said("estop"), answer=False)
    assert "no command since tick" in loop.said("estop")[0]
    at = loop.b.node.state.tick
    loop.run(lambda: loop.b.node.state.tick > at + 20)
    assert "no command since tick" in loop.figures()["estop"]


def test_nobody_is_stopped_before_the_first_command(bench):
    loop = Loop(bench, command_timeout=0.05, late="safe-stop")
    loop.run(lambda: loop.b.node.newest() > 30, answer=False)
    assert not loop.said("estop")
