# SPDX-License-Identifier: Apache-2.0
"""Temporary node of a command: graph discovery, waiting, clean shutdown."""

from __future__ import annotations

import os
import time
from typing import Any

from loco_control.exceptions import GraphError, NameUnknownError

from ..client import GraphClient

DISCOVERY = 10.0  # longest wall time to discover a named topic, node or service [s]
ANSWER = 60.0  # longest wall time for a discovered node to answer, long for busy nodes [s]
SETTLE = 1.0  # wall time without new names after which a list is complete [s]


class Client(GraphClient):
    """Node of one command, hidden as for the original ros2 commands."""

    def __init__(self) -> None:
        super().__init__(f"_ros2cli_{os.getpid()}")

    def result(self, future: Any, what: str) -> Any:
        """Answer of a call.

        Raises:
            GraphError: No answer arrived within `ANSWER`.
        """
        if not self.wait(future.done, ANSWER):
            raise GraphError(f"{what} did not answer within {ANSWER:g} s")
        return future.result()

    def settle(self) -> None:
        """Wait until a node is discovered, then until no new name appears for `SETTLE`."""
        self.wait(self.nodes, DISCOVERY)
        previous, since = -1, time.monotonic()
        while time.monotonic() - since < SETTLE:
            self.spin(0.05)
            count = len(self.node.get_node_names()) + len(self.node.get_topic_names_and_types())
            if count != previous:
                previous, since = count, time.monotonic()

    def topic_type(self, name: str) -> str:
        """Type of a topic with a publisher or subscription.

        Raises:
            NameUnknownError: The topic has neither.
        """
        types: dict[str, list[str]] = {}

        def is_visible() -> bool:
            types.update(self.node.get_topic_names_and_types())
            return name in types

        if not self.wait(is_visible, DISCOVERY):
            raise NameUnknownError("topic", name, types)
        return types[name][0]

    def nodes(self) -> list[str]:
        """Full names of the nodes that are not hidden, sorted."""
        pairs = self.node.get_node_names_and_namespaces()
        return sorted(
            f"{space.rstrip('/')}/{name}" for name, space in pairs if not name.startswith("_")
        )

    def existing(self, name: str) -> str:
        """Full name of a running node.

        Raises:
            NameUnknownError: No such node is running.
        """
        name = name if name.startswith("/") else f"/{name}"
        if not self.wait(lambda: name in self.nodes(), DISCOVERY):
            raise NameUnknownError("node", name, self.nodes())
        return name
