# SPDX-License-Identifier: Apache-2.0
"""`loco ros2`: every line of it that a page prints runs, and says what the original says."""

from __future__ import annotations

import ast
import re
import shlex
import threading
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import rclpy
from rclpy.action import ActionServer, CancelResponse
from rclpy.experimental import EventsExecutor
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool

from loco_bringup.ros2 import client, main, topics
from loco_control.exceptions import GraphError, LocoError, NameUnknownError, ParameterError
from loco_control.ros import LOOPBACK
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.topics import TOPICS
from loco_msgs.action import Calibrate, FindGap

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def printed_lines() -> list[str]:
    """The commands of our pages that begin with ``./loco ros2``, whole."""
    text = "\n".join(page.read_text() for page in PAGES).replace("\\\n", " ")
    return sorted(set(re.findall(r"^\./loco (ros2 .+?)(?:\s+#.*)?$", text, re.MULTILINE)))


LINES = [line for line in printed_lines() if not line.startswith("ros2 run")]


class Graph:
    """A node with the ends that the lines speak to, spun in a thread."""

    def __init__(self):
        self.heard: dict[str, list] = {}
        self._servers: list[ActionServer] = []
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = node = rclpy.create_node("target_generator", context=self.context)
        node.declare_parameter("gait.speed", 0.3)
        node.declare_parameter("names", ["a", "b"])
        for row in (JOINT_TOPICS | TOPICS).values():
            if row.writer == "any":
                self._listen(row.type, f"/{row.name.lstrip('/')}", row.qos.reader())
        self._listen(TOPICS["robot_description"].type, "/replayer/control", 10)
        node.create_service(SetBool, "/set_estop", self._answer)
        for kind, name in ((Calibrate, "/calibrate"), (FindGap, "/find_gap")):
            server = ActionServer(
                node, kind, name, self._run, cancel_callback=lambda _: CancelResponse.ACCEPT
            )
            self._servers.append(server)
        row = TOPICS["robot_description"]
        self.latched = node.create_publisher(row.type, "/robot_description", row.qos.writer())
        self.latched.publish(row.type(data="<robot/>"))
        row = JOINT_TOPICS["joint_states"]
        self._states = node.create_publisher(row.type, "/joint_states", row.qos.writer())
        node.create_timer(0.02, lambda: self._states.publish(row.type(name=["knee"])))
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(node)
        self._open = True
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _listen(self, kind, name, qos):
        got = self.heard.setdefault(name, [])
        self.node.create_subscription(kind, name, got.append, qos)

    def _answer(self, request, response):
        response.success, response.message = True, f"set to {request.data}"
        return response

    def _run(self, handle):
        kind = Calibrate if isinstance(handle.request, Calibrate.Goal) else FindGap
        for _ in range(10):  # the first is lost while the client's reader is not matched yet
            handle.publish_feedback(kind.Feedback())
            time.sleep(0.02)
        handle.succeed()
        return kind.Result(message="found")

    def _spin(self):
        while self._open:
            self.executor.spin_once(timeout_sec=0.05)

    def close(self):
        self._open = False
        self._thread.join()
        for server in self._servers:
            server.destroy()
        self.executor.shutdown()  # holds every endpoint of the node until then
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture(scope="module")
def graph():
    made = Graph()
    yield made
    made.close()


@pytest.fixture
def said(monkeypatch):
    """Everything that the commands write."""
    found = []
    for module in (topics, main.nodes):
        monkeypatch.setattr(module, "write", found.append)
    return lambda: "".join(found)


def test_pages_print_such_lines():
    assert len(LINES) >= 8
    assert not [
        p.name for p in PAGES if re.search(r"^ros2 (?!launch)", p.read_text(), re.MULTILINE)
    ]


@pytest.mark.parametrize("line", LINES)
def test_a_printed_line_runs(graph, said, line):
    words = shlex.split(line)[1:]
    before = {name: len(got) for name, got in graph.heard.items()}
    assert main.run(words) == 0
    if words[:2] == ["topic", "pub"]:
        name = next(w for w in words[2:] if w.startswith("/"))
        end = time.monotonic() + 5.0
        while len(graph.heard[name]) == before[name]:
            assert time.monotonic() < end, f"nothing arrived on {name}"
            time.sleep(0.01)
        assert said().startswith(("publisher: beginning loop\npublishing #1: ", "Waiting for at "))
    elif words[0] == "param":
        assert said() == "Set parameter successful\n"
    elif words[0] == "service":
        assert "response:\nstd_srvs.srv.SetBool_Response(success=True, message='set to " in said()
    elif words[0] == "action":
        assert "Goal accepted with ID: " in said() and "Feedback:\n" in said()
        assert said().endswith("Goal finished with status: SUCCEEDED\n")


def listed(said, words, *texts):
    """The command says all these; on a busy machine discovery may need more than one look."""
    for _ in range(10):
        main.run(words.split())
        if all(text in said() for text in texts):
            return
    raise AssertionError(f"{words}: {said()}")


def test_every_node_is_heard_of_again_before_a_list_counts_as_complete():
    """Whoever missed its first announcements waits for the next: a list without it was printed."""
    period = ET.parse(LOOPBACK).find(".//{*}leaseAnnouncement")
    seconds = float(period.find("{*}sec").text) + 1e-9 * float(period.find("{*}nanosec").text)
    assert 0.1 <= seconds < client.SETTLE  # more often would cost the nodes time


def test_what_the_graph_holds_is_listed(graph, said):
    listed(said, "node list", "/target_generator\n")
    listed(said, "topic list -t", "/joint_states [sensor_msgs/msg/JointState]\n")
    ends = "Publisher count: 0\nSubscription count: 1\n"
    listed(said, "topic info /estop", f"Type: std_msgs/msg/Bool\n{ends}")
    listed(
        said, "node info /target_generator", "  Subscribers:\n", "    /estop: std_msgs/msg/Bool\n",
        "  Action Servers:\n    /calibrate: loco_msgs/action/Calibrate\n",
    )  # fmt: skip


def test_parameters_are_read_and_set(graph, said):
    main.run(["param", "list", "/target_generator"])
    assert "  gait.speed\n" in said()
    main.run(["param", "set", "target_generator", "gait.speed", "0.25"])
    main.run(["param", "get", "target_generator", "gait.speed"])
    assert said().endswith("Set parameter successful\nDouble value is: 0.25\n")
    main.run(["param", "get", "target_generator", "names"])
    assert said().endswith("String values are: ['a', 'b']\n")
    with pytest.raises(GraphError, match="Setting parameter failed: "):
        main.run(["param", "set", "target_generator", "gait.speed", "fast"])
    with pytest.raises(GraphError, match="has no parameter gait.sped"):
        main.run(["param", "get", "target_generator", "gait.sped"])


def test_messages_are_shown(graph, said):
    main.run(["topic", "echo", "--once", "/robot_description"])
    assert said() == "data: <robot/>\n---\n"
    main.run(["topic", "echo", "--once", "/joint_states"])
    assert said().endswith("name:\n- knee\nposition: []\nvelocity: []\neffort: []\n---\n")


def test_a_rate_is_measured(graph, said, monkeypatch):
    spun = []

    def stop_after_two(self, seconds):
        spun.append(seconds)
        if len(spun) > 2:
            raise KeyboardInterrupt
        self.wait(lambda: False, 0.5 * seconds)

    monkeypatch.setattr(client.Client, "spin", stop_after_two)
    with pytest.raises(KeyboardInterrupt):
        main.run(["topic", "hz", "/joint_states"])
    rate = float(re.search(r"average rate: ([\d.]+)\n\tmin: ", said())[1])
    assert 10.0 < rate < 60.0  # of a timer of 50 Hz on a busy machine


@pytest.mark.parametrize(
    ("line", "error", "text"),
    [
        ("topic pub /estop std_msgs/msg/Bool '{dta: 1}'", NameUnknownError, "did you mean 'data'"),
        (
            "topic pub /estop std_msgs/msg/Bool '{data: 1}'",
            ParameterError,
            "data is of type boolean",
        ),
        ("topic pub /estop std_msgs/msg/Bol '{}'", NameUnknownError, "no installed msg type"),
        ("topic pub /estop std_msgs/msg/Bool 'yes'", ParameterError, "must be a mapping"),
        ("topic echo /nothing", NameUnknownError, "no topic named '/nothing'"),
        ("param get /nobody a", NameUnknownError, "no node named '/nobody'"),
        ("service call /none std_srvs/srv/SetBool", GraphError, "nobody offers the service /none"),
        ("topic pub --once /void std_msgs/msg/Bool", GraphError, "nobody listens to /void"),
        ("topic", ParameterError, "required: VERB"),
        ("run loco_bringup calibratr", NameUnknownError, "loco_bringup calibrator"),
    ],
)
def test_a_mistake_is_one_message(graph, said, monkeypatch, line, error, text):
    for module in (client, topics, main.nodes):
        monkeypatch.setattr(module, "DISCOVERY", 0.5)
    with pytest.raises(LocoError, match=re.escape(text)) as caught:
        main.run(shlex.split(line))
    assert isinstance(caught.value, error)


def test_executables_are_those_of_the_packages():
    """`ros2 run` starts here what it starts in a workspace that was built."""
    found = {}
    for setup in [*ROOT.glob("src/*/setup.py"), ROOT / "ros_ws/src/loco_bringup/setup.py"]:
        listed = re.search(r'"console_scripts": (\[.*?\])', setup.read_text(), re.DOTALL)
        for entry in ast.literal_eval(listed[1]) if listed else []:
            name, target = entry.split(" = ")
            found[setup.parent.name, name] = target
    del found["loco_bringup", "loco"]
    assert found == main.EXECUTABLES
    printed = [shlex.split(line)[2:4] for line in printed_lines() if line.startswith("ros2 run")]
    assert printed and all(tuple(pair) in main.EXECUTABLES for pair in printed)
