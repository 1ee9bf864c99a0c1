# SPDX-License-Identifier: Apache-2.0
"""Support for a plain rclpy node that replaces a node of loco.

The graph begins when every endpoint of its topic table is matched and every node has published
the event ``ready``. A plain node publishes no events and has only the endpoints that it needs, so
a `Herald` in the same process creates the missing endpoints and publishes its events.
"""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from .messages.joint_topics import TABLES
from .messages.topics import Topic
from .node import LocoNode


class Herald(LocoNode):
    """Creates the endpoints that a plain node lacks, and publishes ``ready`` for it.

    Args:
        guest: The plain node, with the name of the node that it replaces.
    """

    def __init__(self, node: Node):
        self._node = node
        self.table = table_of(node)
        super().__init__(f"{node.get_name()}_herald")
        if not node.has_parameter("recorded"):
            node.declare_parameter("recorded", False)
        self.recorded = node.get_parameter("recorded").value
        name, has = node.get_name(), topics_of(node)
        for row in self.table.values():
            if row.rate <= 0 or not row.qos.reliable:
                continue
            if row.writer == name and row.name not in has:
                self.output(row.name)
            if name in row.readers and row.name not in has:
                self.input(row.name, _exit, raw=True)
        self.announce_ready()

    def event(self, kind: str, text: str = "", tick: int = 0, t: float = 0.0) -> None:
        """Publish an event in the name of the guest."""
        self.publish_event(self._node.get_name(), kind, text, tick, t)

    def unmatched(self) -> list[str]:
        """Topics of guest and herald with an unmatched endpoint."""
        missing, has = super().unmatched(), topics_of(self._node)
        for row in (row for row in self.table.values() if row.name in has and row.rate > 0):
            if isinstance(endpoint := has[row.name], Publisher):
                expected = len(row.readers) + bool(self.recorded)
                if endpoint.get_subscription_count() < expected:
                    missing.append(f"{row.name} (readers)")
            elif endpoint.get_publisher_count() < 1:
                missing.append(f"{row.name} (no writer)")
        return missing


def table_of(node: Node) -> dict[str, Topic]:
    """The topic table that has most of the topics that a node writes or reads under its name.

    Args:
        node: A plain node.
    """
    name, has = node.get_name(), topics_of(node)

    def fit(table: dict[str, Topic]) -> int:
        rows = (row for row in table.values() if name == row.writer or name in row.readers)
        return sum(row.rate > 0 and row.name in has for row in rows)

    return max(TABLES.values(), key=fit)


def topics_of(node: Node) -> dict[str, Any]:
    """Publishers and subscriptions of a node, by topic name as in the tables.

    Args:
        node: A plain node.
    """
    space = node.get_namespace().rstrip("/") + "/"
    endpoints = [*node.publishers, *node.subscriptions]
    names = {end.topic_name: end for end in endpoints}
    return {n.removeprefix(space): e for n, e in names.items() if n.startswith(space)} | names


def _exit(data: bytes) -> None:
    """Callback that discards messages of a topic that the guest does not use."""
