# SPDX-License-Identifier: Apache-2.0
"""A plain rclpy node in the place of one of ours.

The graph begins when every endpoint of its topic table is matched and every node has said
``ready``. A plain node says nothing and has only the endpoints that it needs, so a `Herald` beside
it, in the same process, has the others and speaks for it.
"""

from __future__ import annotations

from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from .messages.joint_topics import TABLES
from .messages.topics import Topic
from .node import LocoNode


class Herald(LocoNode):
    """Has the endpoints that a plain node leaves out, and says ``ready`` for it.

    Args:
        guest: The plain node; its name is that of the node whose place it takes.
    """

    def __init__(self, guest: Node):
        self._guest = guest
        self.table = table_of(guest)
        super().__init__(f"{guest.get_name()}_herald")
        if not guest.has_parameter("recorded"):
            guest.declare_parameter("recorded", False)
        self.recorded = guest.get_parameter("recorded").value
        name, has = guest.get_name(), topics_of(guest)
        for row in self.table.values():
            if row.rate <= 0 or not row.qos.reliable:
                continue
            if row.writer == name and row.name not in has:
                self.output(row.name)
            if name in row.readers and row.name not in has:
                self.input(row.name, _leave, raw=True)
        self.announce_ready()

    def event(self, kind: str, text: str = "", tick: int = 0, t: float = 0.0) -> None:
        """Publish an event of the guest."""
        self.publish_event(self._guest.get_name(), kind, text, tick, t)

    def unmatched(self) -> list[str]:
        """Topics of guest and herald that still wait for an endpoint."""
        missing, has = super().unmatched(), topics_of(self._guest)
        for row in (row for row in self.table.values() if row.name in has and row.rate > 0):
            if isinstance(endpoint := has[row.name], Publisher):
                wanted = len(row.readers) + bool(self.recorded)
                if endpoint.get_subscription_count() < wanted:
                    missing.append(f"{row.name} (readers)")
            elif endpoint.get_publisher_count() < 1:
                missing.append(f"{row.name} (no writer)")
        return missing


def table_of(guest: Node) -> dict[str, Topic]:
    """Topic table with the most topics that a node writes or reads under its name.

    Args:
        guest: A plain node.
    """
    name, has = guest.get_name(), topics_of(guest)

    def fit(table: dict[str, Topic]) -> int:
        places = (row for row in table.values() if name == row.writer or name in row.readers)
        return sum(row.rate > 0 and row.name in has for row in places)

    return max(TABLES.values(), key=fit)


def topics_of(guest: Node) -> dict[str, Any]:
    """Publishers and subscriptions of a node, by the names of our tables.

    Args:
        guest: A plain node.
    """
    space = guest.get_namespace().rstrip("/") + "/"
    ends = [*guest.publishers, *guest.subscriptions]
    names = {end.topic_name: end for end in ends}
    return {n.removeprefix(space): e for n, e in names.items() if n.startswith(space)} | names


def _leave(data: bytes) -> None:
    """In the place of the guest, which does not want this topic."""
