# SPDX-License-Identifier: Apache-2.0
"""Node that replaces the plant: publishes a bag's sensor messages and receives the answers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from loco_control.exceptions import GraphError
from loco_control.ros.messages.topics import Topic

from ..client import GraphClient
from ..graph.start import StartMonitor
from .compare import Comparison

ANSWER_TIMEOUT = 10.0  # wall time for the answers to one tick [s]
_HEARING = 5.0  # wall time for a controller to acknowledge an operator's message [s]


@dataclass
class Step:
    """One tick of a recording: messages of the plant, and answers of the controllers."""

    tick: int
    key: int  # number that all messages of the tick share
    said: dict[str, bytes]
    answers: dict[str, bytes]
    before: list[tuple[str, bytes]] = field(default_factory=list)  # operator messages


class Feed(GraphClient):
    """Publisher of ticks to live controllers; each tick waits for the answers to the previous one.

    Args:
        steps: The recording.
        plant_topics: Topic rows of the published topics.
        controller_topics: Topic rows of the topics that the controllers publish.
        key_of: Function from the bytes of a message to the number of its tick.
        comparison: Comparison that receives the answers.
        namespace: Namespace of the controllers.
    """

    def __init__(
        self,
        steps: list[Step],
        plant_topics: list[Topic],
        controller_topics: list[Topic],
        key_of: Callable[[bytes], int],
        comparison: Comparison,
        namespace: str = "",
    ):
        super().__init__("robot_sim", namespace)
        self._steps, self._key_of, self._comparison = steps, key_of, comparison
        self._at = -1
        self._waiting: dict[str, bytes] = {}
        self._ready: set[str] = set()
        self._n_ready = 0  # ready nodes already counted as progress
        self._moved = time.monotonic()
        self._readers = {row.name: set(row.readers) for row in plant_topics}
        self._error = ""
        self._unheard = 0  # operator messages not acknowledged yet
        self._outputs = {
            row.name: self.node.create_publisher(row.type, row.name, row.qos.writer())
            for row in plant_topics
        }
        for row in controller_topics:
            self.node.create_subscription(
                row.type, row.name, self._receiver(row.name), row.qos.reader(), raw=True
            )

    def hear_events(self, row: Topic) -> None:
        """Subscribe to the events that report readiness and errors."""
        self.node.create_subscription(row.type, row.name, self._on_event, row.qos.reader(100))

    def run(
        self,
        nodes: set[str],
        check: Callable[[], None],
        on_progress: Callable[[float], None],
        start: StartMonitor,
    ) -> None:
        """Publish all ticks and compare the answers.

        Args:
            nodes: Controllers that must be ready first.
            check: Called periodically; raises if a process died.
            on_progress: Called periodically with the share of completed ticks.
            start: Monitor of the controllers' progress until they are ready.

        Raises:
            GraphError: A controller makes no progress before it is ready, or reports an error.
        """
        while self._at < len(self._steps):
            self.spin(0.1)
            check()
            if self._error:
                raise GraphError(self._error)
            on_progress(max(self._at, 0) / len(self._steps))
            if self._at < 0:
                self._begin(nodes, start)
            elif self._unheard and time.monotonic() - self._moved > _HEARING:
                self._publish()
            elif time.monotonic() - self._moved > ANSWER_TIMEOUT:
                self._give_up()
                return

    def _begin(self, nodes: set[str], start: StartMonitor) -> None:
        if len(self._ready) != self._n_ready:
            self._n_ready = len(self._ready)
            start.advance()
        missing = nodes - self._ready
        unheard = [
            name
            for name, readers in self._readers.items()
            if self._outputs[name].get_subscription_count() < len(readers & nodes)
        ]
        if not missing and not unheard:
            self._next()
        elif failure := start.failure():
            raise GraphError(
                f"{failure}: {', '.join(sorted(missing)) or 'no readers of ' + ', '.join(unheard)}"
            )

    def _on_event(self, event) -> None:
        if event.kind == "ready":
            self._ready.add(event.node)
        elif event.kind == "error":
            self._error = f"{event.node}: {event.text}"
        elif event.kind == "heard" and self._unheard:
            self._unheard -= 1
            if not self._unheard:
                self._publish()

    def _next(self) -> None:
        """Proceed to the next tick, starting with the operator messages before it."""
        self._at += 1
        self._moved = time.monotonic()
        if self._at >= len(self._steps):
            return
        before = self._steps[self._at].before
        self._unheard = len(before)
        for name, data in before:
            self._outputs[name].publish(data)
        if not before:
            self._publish()

    def _publish(self) -> None:
        """Publish the plant's messages of this tick."""
        step, self._unheard = self._steps[self._at], 0
        self._moved = time.monotonic()
        self._waiting = dict(step.answers)
        self._comparison.verdict.ticks += 1
        for name, data in step.said.items():
            self._outputs[name].publish(data)

    def _receiver(self, name: str) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            if not 0 <= self._at < len(self._steps):
                return
            step = self._steps[self._at]
            if self._key_of(data) != step.key or name not in self._waiting:
                return  # an answer that was not recorded
            recorded = self._waiting.pop(name)
            self._comparison.add(name, step.tick, recorded, data)
            if not self._waiting:
                self._next()

        return receive

    def _give_up(self) -> None:
        step = self._steps[self._at]
        self._comparison.verdict.trouble = (
            f"no {' and no '.join(sorted(self._waiting))} for tick {step.tick} within "
            f"{ANSWER_TIMEOUT:.0f} s"
        )
