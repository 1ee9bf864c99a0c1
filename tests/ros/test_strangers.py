# SPDX-License-Identifier: Apache-2.0
"""What anyone on the network may send: no message and no request ends a node or misleads it."""

import contextlib

import numpy as np
import pytest
import rclpy
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from std_msgs.msg import Float64, String

from loco_bringup.record.recorder import RecorderNode
from loco_control.exceptions import GraphError, ParameterError
from loco_control.ros.cpg_node import CpgNode
from loco_control.ros.fault_node import FaultNode
from loco_control.ros.health import ERROR, WARN
from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.msd_topics import MSD_TOPICS
from loco_control.ros.messages.topics import TOPICS, topic
from loco_control.ros.stance_node import StanceControllerNode
from loco_control.ros.target_node import TargetGeneratorNode
from loco_learning.ros.joint_reflex_node import JointReflexNode
from loco_learning.ros.msd_reflex_node import MsdReflexNode
from loco_learning.ros.reflex_node import ReflexNetworkNode
from loco_sim.ros.joint_sim_node import JointSimNode
from loco_sim.ros.msd_sim_node import MsdSimNode
from loco_sim.ros.sim_node import RobotSimNode

pytestmark = pytest.mark.ros

NODES = [
    (RobotSimNode, TOPICS),
    (TargetGeneratorNode, TOPICS),
    (ReflexNetworkNode, TOPICS),
    (StanceControllerNode, TOPICS),
    (JointSimNode, JOINT_TOPICS),
    (CpgNode, JOINT_TOPICS),
    (JointReflexNode, JOINT_TOPICS),
    (MsdSimNode, MSD_TOPICS),
]
EXTREMES = (0.0, -1.0, 1e-300, 1e30, 1e300, -1.7e308, np.inf, np.nan)


def junk(kind, rng):
    """Serialised messages of a class, and bytes that are none."""
    whole = serialize_message(kind())
    yield from (b"", whole[:3], whole[:4], whole[:7], whole[:-1], whole + bytes(64))
    for _ in range(30):
        data = bytearray(whole)
        for _ in range(int(rng.integers(1, 6))):
            data[int(rng.integers(4, max(5, len(data))))] = int(rng.integers(256))
        yield bytes(data)
    for value in EXTREMES:  # in all places that a double may have
        count = max(0, len(whole) - 20) // 8
        yield whole[:20] + np.full(count, value).tobytes() + whole[20 + 8 * count :]
    if kind is String:
        for text in (b"\xff\xfe\xc3", b"a: [" * 5000, b"[" * 90_000, b"&a [*a]", b"a: !!int x"):
            yield b"\0\1\0\0" + (len(text) + 1).to_bytes(4, "little") + text + b"\0"


def send(bench, name, row, messages):
    """Publish bytes as they are, each before the next, since readers keep one."""
    publisher = bench.tester.create_publisher(row.type, name, row.qos.writer())
    bench.wait(lambda: publisher.get_subscription_count() > 0)
    for data in messages:
        with contextlib.suppress(RuntimeError):
            publisher.publish(data)
        bench.executor.spin_once(timeout_sec=0.01)
    bench.tester.destroy_publisher(publisher)


@pytest.mark.parametrize(("node", "table"), NODES, ids=[n.__name__ for n, _ in NODES])
def test_no_message_on_any_input_ends_a_node_and_the_refused_are_told(bench, node, table):
    b, rng = bench(node, table), np.random.default_rng(0)
    reports = b.listen("/diagnostics")
    for name, subscription in list(b.node._inputs.items()):
        row = topic(name, table)
        send(b, subscription.topic_name, row, junk(row.type, rng))
    heard = len(reports)
    b.wait(lambda: len(reports) > heard + 1)  # it lives, and its timers run
    told = {v.key: v.value for v in reports[-1].status[0].values}
    assert int(told["refused_messages"]) + int(told.get("rejected_commands", 0)) > 0
    levels = [r.status[0].level for r in reports]
    assert max(levels) >= WARN


def test_a_reflex_of_a_network_refuses_junk(bench):
    b, rng = bench(MsdSimNode, MSD_TOPICS), np.random.default_rng(0)
    links = b.node.sim.simulation.network.count
    bench.done()
    values = {f"gait.{name}": [0.1] * links for name in ("amplitude", "phase", "stiffness")}
    b = bench(MsdReflexNode, MSD_TOPICS, **values)
    send(b, "node_states", topic("node_states", MSD_TOPICS), junk(
        topic("node_states", MSD_TOPICS).type, rng))  # fmt: skip
    assert b.node._n_refused["node_states"] > 0


def test_a_recorder_and_the_node_of_faults_live_through_junk(bench, tmp_path):
    rng = np.random.default_rng(0)
    for node, options in (
        (RecorderNode, {"bag": str(tmp_path / "bag")}),
        (FaultNode, {"faults": '["motion_command:nan", "stance:stuck"]', "allow_faults": "true"}),
    ):
        b = bench(node, **options)
        for name in ("robot_state", "motion_command", "stance"):
            row = topic(name)
            with contextlib.suppress(AssertionError):
                send(b, row.name, row, junk(row.type, rng))
        late = topic("robot_state").type()
        late.stamp.sec, late.stamp.nanosec, late.tick = -5, 4_000_000_000, 2**64 - 1
        send(b, "robot_state", topic("robot_state"), [serialize_message(late)])
        b.wait(lambda b=b: sum(b.node._n_refused.values()) > 0)
        bench.done()


def drive(b, states, targets, ticks, start=0):
    pack, zeros = JointCodec(b.node.joints).pack, np.zeros(len(b.node.joints))
    for tick in range(start, start + ticks):
        count = len(targets)
        states.publish(pack(tick * 0.01, zeros, zeros, zeros))
        b.wait(lambda count=count: len(targets) > count)


def test_a_flood_of_replayed_ticks_holds_nothing_up(bench):
    """Ten old messages to each new one; each new one is answered, no old one is."""
    b = bench(CpgNode, JOINT_TOPICS)
    states, targets = b.publisher("joint_states"), b.listen("joint_target")
    b.wait(lambda: b.node._ready_timer is None)
    other = b.tester.create_publisher(
        JOINT_TOPICS["joint_states"].type, "joint_states", JOINT_TOPICS["joint_states"].qos.writer()
    )
    b.wait(lambda: other.get_subscription_count() > 0)
    pack, zeros = JointCodec(b.node.joints).pack, np.zeros(len(b.node.joints))
    drive(b, states, targets, 20)
    for tick in range(20, 60):
        for back in range(10):
            other.publish(pack((tick - 1 - back % 3) * 0.01, zeros, zeros, zeros))
        drive(b, states, targets, 1, tick)
    ticks = [round(100 * (t.header.stamp.sec + t.header.stamp.nanosec * 1e-9)) for t in targets]
    assert ticks == list(range(60))


def test_a_second_writer_ends_a_graph_before_it_begins_and_is_told_after(bench):
    b = bench(CpgNode, JOINT_TOPICS)
    states, targets = b.publisher("joint_states"), b.listen("joint_target")
    reports = b.listen("/diagnostics")
    b.wait(lambda: b.node._ready_timer is None)
    stranger = rclpy.create_node("stranger")
    row = JOINT_TOPICS["joint_states"]
    second = stranger.create_publisher(row.type, row.name, row.qos.writer())
    b.wait(lambda: any(r.status[0].level == ERROR for r in reports))
    assert "joint_states has 2 writers" in reports[-1].status[0].message
    assert "stranger" in reports[-1].status[0].message
    drive(b, states, targets, 5)
    with pytest.raises(GraphError, match="another graph runs"):
        b.node._refuse_strangers()
    stranger.destroy_publisher(second)
    stranger.destroy_node()


@pytest.mark.parametrize(
    ("node", "table"), [(TargetGeneratorNode, TOPICS), (JointSimNode, JOINT_TOPICS)]
)
def test_a_stranger_sets_only_what_may_change(bench, node, table):
    b = bench(node, table)
    b.wait(lambda: b.node.count_subscribers("/parameter_events") >= 0)
    client = b.tester.create_client(SetParameters, f"/{b.node.get_name()}/set_parameters")
    b.wait(client.service_is_ready)

    def ask(name, value):
        request = SetParameters.Request(
            parameters=[Parameter(name, value=value).to_parameter_msg()]
        )
        return b.answer(lambda: client.call_async(request)).results[0]

    for name, value in (("use_sim_time", True), ("recorded", True), ("control_rate", 1e9)):
        before = b.node.get_parameter(name).value
        answer = ask(name, value)
        assert not answer.successful
        assert f"{name} cannot change while the node runs" in answer.reason
        assert b.node.get_parameter(name).value == before
    assert not ask("no_such", 1).successful
    assert not ask("gait.speed", "\udcff".encode("utf-8", "replace").decode()).successful
    if node is TargetGeneratorNode:
        assert ask("gait.speed", 0.1).successful
        assert not ask("gait.speed", 99.0).successful
    reports = b.listen("/diagnostics")
    b.wait(lambda: len(reports) > 1)


def test_wishes_that_cannot_be_met_are_counted(bench):
    b = bench(TargetGeneratorNode)
    events = b.listen("events")
    frequency = b.publisher("gait_frequency")
    for value in (1e9, np.nan, -3.0):
        frequency.publish(Float64(data=value))
        count = sum(b.node._n_refused.values())
        b.wait(lambda count=count: sum(b.node._n_refused.values()) > count)
    b.wait(lambda: any(e.kind == "message refused" for e in events))
    assert sum(e.kind == "message refused" for e in events) == 1  # a flood makes no flood


MODELS = {
    "no date": "a: 2001-99-99",
    "deep": "[" * 50_000,
    "half a character": "format: 1\nrobot: caf\udce9",
    "a list": "- 1",
    "a word for a mass": "format: 1\nrobot: tigrillo\noverrides: {masses.front_body: heavy}",
    "a list for a stiffness": "format: 1\nrobot: tigrillo\noverrides: {springs: [1]}",
    "a negative mass": "format: 1\nrobot: tigrillo\noverrides: {masses.front_body: -3}",
    "another file as its URDF": "format: 1\nrobot: tigrillo\noverrides: {urdf: ../hyq/hyq.urdf}",
    "effects of numbers": "format: 1\nrobot: tigrillo\neffects: [3, [x], {name: [y]}]",
    "no end": "format: 1\nrobot: tigrillo\neffects: [{name: command_delay, delay: .inf}]",
    "a file of the system": "/etc/os-release.yaml",
    "a robot of the system": "format: 1\nrobot: /etc/os-release",
    "a way out": "format: 1\nrobot: bags/../../x/robot.yaml",
    "too long": "a: " + "b" * 200_000,
}  # fmt: skip


@pytest.fixture
def plant(bench):
    b = bench(JointSimNode, JOINT_TOPICS)
    return b, b.publisher("model"), b.listen("events")


def test_no_model_text_ends_the_plant_or_shows_a_file(plant):
    b, models, events = plant
    before = b.node.sim
    for how, text in MODELS.items():
        said = len([e for e in events if e.kind == "model refused"])
        raw = text.encode("utf-8", "surrogateescape") + b"\0"
        models.publish(b"\0\1\0\0" + len(raw).to_bytes(4, "little") + raw)
        b.wait(lambda said=said: len([e for e in events if e.kind == "model refused"]) > said)
        last = [e.text for e in events if e.kind == "model refused"][-1]
        assert "\n" not in last and len(last) < 600, how
        assert "NAME=" not in last and "Linux" not in last  # what /etc/os-release says
    assert b.node.sim is before
    assert b.node._n_refused["model"] == len(MODELS)


def test_a_model_in_a_folder_of_the_operator_is_read(bench, tmp_path):
    (tmp_path / "model.yaml").write_text("format: 1\nrobot: tigrillo\n")
    b = bench(JointSimNode, JOINT_TOPICS, folders=f'["{tmp_path}"]')
    events, models = b.listen("events"), b.publisher("model")
    models.publish(String(data=f"{tmp_path}/model.yaml"))
    b.wait(lambda: any(e.kind == "model loaded" for e in events))


def test_faults_are_off_unless_a_parameter_allows_them(bench):
    with pytest.raises(ParameterError, match="allow_faults"):
        bench(FaultNode, faults='["motion_command:drop"]')
    with pytest.raises(ParameterError, match="allow_faults"):
        bench(TargetGeneratorNode, faulted='["robot_state"]')


def test_a_plant_hears_no_odometry(bench):
    """The table is the whole list of what a node hears."""
    b = bench(RobotSimNode)
    b.tester.create_publisher(Odometry, "ground_truth/odom", 1)
    assert set(b.node._inputs) == {r.name for r in TOPICS.values() if "robot_sim" in r.readers}
