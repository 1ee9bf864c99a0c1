# SPDX-License-Identifier: Apache-2.0
"""A plain rclpy node takes the place of a controller: the page says how, and what it says runs."""

import re
import subprocess
import sys

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.graph.processes import _environment
from loco_control.ros.guest import Herald, table_of
from loco_control.ros.messages.joint_topics import TABLES

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]


@pytest.fixture
def page(repository, tmp_path):
    """Folder with the files of the page, and its command."""
    text = (repository / "docs/controller.md").read_text()
    blocks = dict(re.findall(r"```(\w+)\n(.*?)```", text, re.DOTALL))
    (tmp_path / "my_controller.py").write_text(blocks["python"])
    (tmp_path / "my_nodes.yaml").write_text(blocks["yaml"])
    for name in ("queue", "random", "yaml"):  # the folder is searched last
        (tmp_path / f"{name}.py").write_text("raise RuntimeError('not the library')")
    return tmp_path, blocks["sh"].split()[1:]


def run(folder, command, *more):
    return subprocess.run(
        [sys.executable, "-m", "loco_bringup.cli.main", *command, *more], cwd=folder,
        capture_output=True, text=True, env=_environment(), timeout=200,
    )  # fmt: skip


@pytest.mark.parametrize("layout", ["composed", "processes"])
def test_the_controller_of_the_page_drives_the_robot(page, layout):
    folder, command = page
    done = run(folder, command, "--out", "bag", "--layout", layout)
    assert done.returncode == 0, done.stdout + done.stderr
    bag = Bag(folder / "bag")
    commands, states = bag.messages("/joint_command"), bag.records("/joint_states")
    t = np.array([m.header.stamp.sec + m.header.stamp.nanosec * 1e-9 for m in commands])
    assert len(commands) == 500  # every tick was answered, and recorded
    np.testing.assert_allclose(t, np.arange(500) * 0.01, atol=1e-9)
    expected = 0.7 + 0.3 * np.sin(2.0 * np.pi * t)
    sent = [m.position for m in commands]
    np.testing.assert_allclose(sent, np.repeat(expected[:, None], 4, axis=1))
    swing = states["position"][200:].max(axis=0) - states["position"][200:].min(axis=0)
    assert swing.max() > 0.3  # the robot moved by it
    events = bag.messages("/events")
    assert "reflex_network" in {e.node for e in events if e.kind == "ready"}
    assert not [e for e in events if e.kind in ("error", "timeout", "estop", "message refused")]


def test_a_controller_that_breaks_ends_the_run_with_its_name(page):
    folder, command = page
    text = (folder / "my_controller.py").read_text()
    broken = text.replace("t = state", "1 / 0\n        t = state")
    (folder / "my_controller.py").write_text(broken)
    done = run(folder, command, "--out", "bag", "--layout", "processes")
    assert done.returncode == 1
    assert "reflex_network died" in done.stderr and "ZeroDivisionError" in done.stderr


def test_a_place_is_found_by_what_a_node_writes_and_reads(bench):
    import rclpy

    from loco_control.ros.cpg_node import CpgNode
    from loco_msgs.msg import MotionCommand, RobotState

    bench(CpgNode, TABLES["joint"])  # for the context
    guest = rclpy.create_node("reflex_network")
    guest.create_subscription(RobotState, "robot_state", print, 1)
    guest.create_publisher(MotionCommand, "motion_command", 10)
    assert table_of(guest) is TABLES["hyq"]
    herald = Herald(guest)
    assert set(herald._outputs) == {"learning_state", "events", "/diagnostics"}
    assert set(herald._inputs) == {"gait_target"}
    assert any("robot_state" in each for each in herald.unmatched())
    assert any("motion_command" in each for each in herald.unmatched())
    herald.destroy_node()
    guest.destroy_node()
