# SPDX-License-Identifier: Apache-2.0
"""Imports point one way, and PyBullet, ROS and the terminal each have one place."""

from __future__ import annotations

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = {
    "loco_control": ROOT / "src/loco_control/loco_control",
    "loco_sim": ROOT / "src/loco_sim/loco_sim",
    "loco_learning": ROOT / "src/loco_learning/loco_learning",
    "loco_bringup": ROOT / "ros_ws/src/loco_bringup/loco_bringup",
}

# What each package may import besides the standard library and itself.
ALLOWED = {
    "loco_control": {"numpy", "numba"},
    "loco_sim": {"loco_control", "numpy", "numba", "llvmlite", "scipy", "yaml", "PIL"},
    "loco_learning": {
        *("loco_control", "loco_sim"),
        *("numpy", "numba", "scipy", "cma", "distributed", "yaml", "matplotlib"),
    },
}
# ROS and the messages: only in the ros folder of a package, and anywhere in loco_bringup.
ROS = {
    *("rclpy", "loco_msgs", "ament_index_python", "builtin_interfaces", "rcl_interfaces"),
    *("rosgraph_msgs", "std_msgs", "std_srvs", "geometry_msgs", "sensor_msgs", "nav_msgs"),
    *("action_msgs", "diagnostic_msgs", "visualization_msgs", "tf2_msgs"),
}
BRINGUP = {
    *ROS,
    *("loco_control", "loco_sim", "loco_learning", "numpy", "yaml", "rich", "psutil", "pytest"),
    *("numba", "mcap", "zstandard", "lz4", "mcap_ros2", "rosbags", "matplotlib", "PIL"),
}
PYBULLET_DOOR = Path("loco_sim/engine.py")
TERMINAL = ("loco_bringup/cli", "loco_bringup/console")


def allowed_in(path: Path) -> set[str]:
    """First names that a module may import; `path` begins with the package's name."""
    package = path.parts[0]
    if package == "loco_bringup":
        return BRINGUP
    ros = ROS if path.parts[1] == "ros" else set()
    door = {"pybullet", "pybullet_data"} if path == PYBULLET_DOOR else set()
    return ALLOWED[package] | ros | door


def violations(path: Path, text: str) -> list[str]:
    """What a module does that it may not; `path` begins with the package's name."""
    found = []
    legal = allowed_in(path) | {path.parts[0]} | set(sys.stdlib_module_names)
    for node in ast.walk(ast.parse(text)):
        modules = []
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            modules = [node.module]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print":
            if not path.as_posix().startswith(TERMINAL):
                found.append(f"{path}:{node.lineno} prints; use logging")
        for module in modules:
            if module.split(".")[0] not in legal:
                found.append(f"{path}:{node.lineno} imports {module}")
    return found


@pytest.mark.parametrize("package", FOLDERS)
def test_modules_keep_to_their_layer(package):
    found = []
    for path in sorted(FOLDERS[package].rglob("*.py")):
        inside = package / path.relative_to(FOLDERS[package])
        found += violations(inside, path.read_text())
    assert found == []


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("loco_control/gait.py", "import rclpy"),
        ("loco_control/gait.py", "from loco_sim.world import World"),
        ("loco_control/gait.py", "import scipy.linalg"),
        ("loco_control/gait.py", "def f():\n    import loco_msgs.msg"),
        ("loco_control/ros/node.py", "from loco_sim import robot"),
        ("loco_sim/robot.py", "import pybullet as p"),
        ("loco_sim/ros/sim_node.py", "import pybullet"),
        ("loco_sim/effects/push.py", "from loco_learning import rollout"),
        ("loco_learning/rollout.py", "import pybullet"),
        ("loco_learning/rollout.py", "from rclpy.node import Node"),
        ("loco_bringup/run.py", "import pybullet"),
        ("loco_learning/study.py", "print('done')"),
    ],
)
def test_a_violation_is_found(path, text):
    assert len(violations(Path(path), text)) == 1


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("loco_control/ros/node.py", "import rclpy\nfrom loco_control.names import LEGS"),
        ("loco_sim/engine.py", "import pybullet"),
        ("loco_learning/rollout.py", "from loco_sim.simulation import Simulation"),
        ("loco_bringup/cli.py", "print('done')"),
        ("loco_control/gait.py", "from .params import Params\nfrom . import names"),
    ],
)
def test_what_is_allowed_is_not_reported(path, text):
    assert violations(Path(path), text) == []
