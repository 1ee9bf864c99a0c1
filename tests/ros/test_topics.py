# SPDX-License-Identifier: Apache-2.0
"""Laws of the topic table."""

import ast
from pathlib import Path

import pytest

from loco_control.exceptions import NameUnknownError
from loco_control.ros.messages.topics import NODES, TOPICS, WRITER_DEPTH, topic
from loco_sim.ros.sim_node import TickParams

ROOT = Path(__file__).resolve().parents[2]
KNOWN = {*NODES, "recorder", "any"}


@pytest.mark.parametrize("row", TOPICS.values(), ids=lambda r: r.name)
def test_writers_and_readers_are_nodes(row):
    assert {row.writer, *row.readers} <= KNOWN
    assert row.doc


@pytest.mark.parametrize("row", TOPICS.values(), ids=lambda r: r.name)
def test_every_writer_profile_serves_its_reader(row):
    writer, reader = row.qos.writer(), row.qos.reader()
    assert (writer.reliability, writer.durability) == (reader.reliability, reader.durability)
    assert writer.depth >= reader.depth


def test_the_writer_queue_is_longer_than_the_flow_window():
    assert TickParams().flow_window < WRITER_DEPTH


def test_clock_is_at_most_100_hz():
    assert TOPICS["/clock"].rate <= 100  # 1 kHz costs 20-35 % of a core per node


def test_unknown_topic_lists_the_known():
    with pytest.raises(NameUnknownError, match="robot_state"):
        topic("robot_stat")


def test_nobody_spins_an_events_executor_directly():
    # EventsExecutor.spin() of the Jazzy wheels burns a core and ignores SIGTERM.
    for path in [*ROOT.glob("src/**/*.py"), *ROOT.glob("ros_ws/src/loco_bringup/**/*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                assert not (node.func.attr == "spin" and "executor" in ast.unparse(node).lower()), (
                    path
                )
