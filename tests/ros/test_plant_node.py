# SPDX-License-Identifier: Apache-2.0
"""Commands that a plant must not use, on every topic that it takes: counted, and nothing moves."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from loco_control.ros.messages.convert import TICK, Converter
from loco_control.ros.messages.joint_codec import JointCodec, stamp_ns
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.msd_topics import MSD_TOPICS, link_names
from loco_control.ros.messages.topics import TOPICS, topic
from loco_control.types import MotionCommand, TrunkTorque
from loco_msgs.msg import Event
from loco_sim.ros.joint_sim_node import JointSimNode
from loco_sim.ros.msd_sim_node import MsdSimNode
from loco_sim.ros.sim_node import RobotSimNode

pytestmark = pytest.mark.ros

WARM, AFTER = 5, 10  # ticks before the bad message, and after it


class Hyq:
    """HyQ that stands, commanded by two topics."""

    node, table, states, period, parameters = RobotSimNode, TOPICS, "robot_state", 1, {}
    commands = ("motion_command", "trunk_torque")

    def __init__(self, node):
        self._q = node.sim.robot.standing
        self._packs = dict(
            motion_command=Converter(MotionCommand).pack, trunk_torque=Converter(TrunkTorque).pack
        )

    def pack(self, name, tick, value):
        t, twelve = tick * 0.004, np.full(12, value)
        if name == "motion_command":
            made = MotionCommand(tick, t, self._q + 0.01 * twelve, 0.0 * twelve)
        else:
            made = TrunkTorque(tick, t, twelve, np.zeros(6), np.zeros(4, bool))
        return self._packs[name](made)

    def short(self, name, tick):
        return self.pack(name, tick, 0.0)[:-8]

    def key(self, data):
        return int.from_bytes(data[TICK], "little")


class Stamped:
    """A plant of standard messages."""

    def __init__(self, node):
        self.period = round(1e9 / node.rate)
        self._pack, self._base = self.codec(node)

    def pack(self, name, tick, value):
        return self._pack(tick * self.period * 1e-9, self._base + 0.01 * value)

    def short(self, name, tick):
        message = deserialize_message(self.pack(name, tick, 0.0), JointState)
        message.position = message.position[:-1]
        return message

    def key(self, data):
        return stamp_ns(data) // self.period


class Joint(Stamped):
    """A robot of joints."""

    node, table, states, parameters = JointSimNode, JOINT_TOPICS, "joint_states", {}
    commands = ("joint_command",)

    def codec(self, node):
        robot = node.sim.robot
        names = [robot.joints[i] for i in robot.driven]
        return JointCodec(names, fields=("position",)).pack, robot.standing[robot.driven]


class Network(Stamped):
    """Masses and springs."""

    node, table, states, parameters = MsdSimNode, MSD_TOPICS, "node_states", {}
    commands = ("link_command",)

    def codec(self, node):
        links = node.sim.simulation.network.links.tolist()
        return JointCodec(link_names(links), fields=("position",)).pack, np.ones(len(links))


def drive(bench, kind, bad=None):
    """States of a run in which a bad message comes before the right one at tick `WARM`.

    Returns:
        The serialised states, and how many commands the bad message made stale and refused.
    """
    b = bench(kind.node, kind.table, **kind.parameters)
    play = kind(b.node)
    row, states = topic(kind.states, kind.table), []
    heard = [
        b.tester.create_subscription(
            each.type, each.name, len if i or each != row else states.append,
            each.qos.reader(100), raw=True,
        )
        for each in kind.table.values()
        if each.writer == "robot_sim" and each.rate > 0
        for i in range(max(1, len(each.readers)))
    ]  # fmt: skip
    events = b.listen("events")
    outputs = {name: b.publisher(name) for name in kind.commands}
    ready = b.publisher("events")
    b.wait(lambda: any(e.kind == "ready" for e in events))
    for name in kind.node.controllers[1:]:
        ready.publish(Event(node=name, kind="ready"))
    b.wait(lambda: states)

    def answer(tick):
        for name, publisher in outputs.items():
            publisher.publish(play.pack(name, tick, np.sin(0.3 * tick)))
        b.wait(lambda: len(states) > tick + 1)

    for tick in range(WARM):
        answer(tick)
    before = counts(b.node)
    if bad:
        bad(b, play, outputs, states)
    for tick in range(len(states) - 1, WARM + AFTER):
        answer(tick)
    assert [play.key(s) for s in states] == list(range(len(states)))
    del heard
    return states, counts(b.node) - before


def counts(node):
    """Commands that were stale, and those that were refused."""
    said = node.diagnose()
    return np.array([said["stale_commands"], said["rejected_commands"]])


KINDS = [(kind, name) for kind in (Hyq, Joint, Network) for name in kind.commands]
TICKS = {"old": WARM - 3, "repeated": WARM - 1, "future": WARM + 40}


@pytest.mark.parametrize(("kind", "name"), KINDS, ids=[name for _, name in KINDS])
@pytest.mark.parametrize("how", TICKS)
def test_a_command_of_another_tick_is_counted_and_moves_nothing(bench, kind, name, how):
    def bad(b, play, outputs, states):
        before = counts(b.node)[0]
        outputs[name].publish(play.pack(name, TICKS[how], 50.0))
        b.wait(lambda: counts(b.node)[0] > before)
        assert len(states) == WARM + 1  # no tick was stepped

    states, counted = drive(bench, kind, bad)
    bench.done()
    again, none = drive(bench, kind)
    assert counted.tolist() == [1, 0]
    assert none.tolist() == [0, 0]
    assert states == again


@pytest.mark.parametrize(("kind", "name"), KINDS, ids=[name for _, name in KINDS])
def test_a_command_without_numbers_is_counted_and_the_one_before_stays(bench, kind, name):
    def spoiled(value):
        def bad(b, play, outputs, states):
            for each, publisher in outputs.items():
                other = value(each)
                publisher.publish(play.pack(each, WARM, other))
            b.wait(lambda: len(states) == WARM + 2)

        return bad

    last = np.sin(0.3 * (WARM - 1))
    states, counted = drive(bench, kind, spoiled(lambda each: np.nan if each == name else last))
    bench.done()
    again, _ = drive(bench, kind, spoiled(lambda each: last))
    assert counted.tolist() == [0, 1]
    assert states == again


@pytest.mark.parametrize(("kind", "name"), KINDS, ids=[name for _, name in KINDS])
def test_a_command_of_the_wrong_size_is_counted_and_moves_nothing(bench, kind, name):
    def bad(b, play, outputs, states):
        before = counts(b.node)[1]
        for each, publisher in outputs.items():
            wrong = play.short(each, WARM) if each == name else play.pack(each, WARM, 0.0)
            publisher.publish(wrong)
        b.wait(lambda: counts(b.node)[1] > before)
        assert len(states) == WARM + 1

    states, counted = drive(bench, kind, bad)
    bench.done()
    again, _ = drive(bench, kind)
    assert counted.tolist() == [0, 1]
    assert states == again
