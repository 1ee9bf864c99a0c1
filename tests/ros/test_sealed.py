# SPDX-License-Identifier: Apache-2.0
"""Nobody on the network can change a parameter of a node, of whatever process."""

import ast
from pathlib import Path

import pytest
import rclpy
from rcl_interfaces.srv import SetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from loco_control.ros.parameters import sealed_node
from loco_sim.ros.ros2_control_node import Ros2ControlNode

ROOT = Path(__file__).parents[2]
SOURCES = [p for top in ("src", "ros_ws/src") for p in sorted((ROOT / top).rglob("*.py"))]


def _bare(tree: ast.AST) -> list[int]:
    """Lines that make a node of rclpy in a scope without `seal`."""
    lines = []
    for scope in ast.walk(tree):
        if not isinstance(scope, (ast.FunctionDef, ast.ClassDef)):
            continue
        calls = [n.func for n in ast.walk(scope) if isinstance(n, ast.Call)]
        names = {getattr(f, "id", getattr(f, "attr", "")) for f in calls}
        plain = "create_node" in names
        if isinstance(scope, ast.ClassDef):
            plain |= any(isinstance(b, ast.Name) and b.id == "Node" for b in scope.bases)
        if plain and "seal" not in names:
            lines.append(scope.lineno)
    return lines


def test_every_node_is_sealed():
    bare = {p.name: _bare(ast.parse(p.read_text())) for p in SOURCES if "launch" not in p.parts}
    assert not {name: lines for name, lines in bare.items() if lines}


@pytest.mark.parametrize(
    "text",
    [
        "def f():\n    rclpy.create_node('a')",
        "def f():\n    create_node('a')",
        "class A(Node):\n    pass",
    ],
)
def test_a_bare_node_is_noticed(text):
    assert _bare(ast.parse(text))


def _answer(node, executor):
    asker = rclpy.create_node("asker")
    executor.add_node(asker)
    client = asker.create_client(SetParameters, f"{node.get_fully_qualified_name()}/set_parameters")
    while not client.service_is_ready():
        executor.spin_once(timeout_sec=0.05)
    request = SetParameters.Request(
        parameters=[Parameter("use_sim_time", value=True).to_parameter_msg()]
    )
    future = client.call_async(request)
    while not future.done():
        executor.spin_once(timeout_sec=0.05)
    return future.result().results[0]


@pytest.mark.ros
@pytest.mark.parametrize("name", ["plain", "ros2_control"])
def test_use_sim_time_is_refused_from_outside(name):
    rclpy.init()
    executor = SingleThreadedExecutor()
    try:
        node = sealed_node("plain") if name == "plain" else Ros2ControlNode()
        executor.add_node(node)
        answer = _answer(node, executor)
        assert not answer.successful
        assert "use_sim_time cannot change" in answer.reason
        assert not node.get_parameter("use_sim_time").value
    finally:
        executor.shutdown()
        rclpy.shutdown()
