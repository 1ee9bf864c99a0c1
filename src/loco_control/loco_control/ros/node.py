# SPDX-License-Identifier: Apache-2.0
"""Base class of every node of the graph: topics from the table, readiness, ticks, diagnostics.

Nodes are spun by `executor.run_nodes` only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from loco_msgs.msg import Event

from .. import realtime
from ..exceptions import GraphError, ParameterError
from .endpoints import ANOTHER, is_named, living, own_host, strangers
from .health import ERROR, WARN, HealthParams, PeriodMeter, UsageMeter, judge
from .in_process import Post, raw
from .join import TickJoin, loco_tick
from .messages.convert import Converter
from .messages.topics import FAULT_DEPTH, TOPICS, Topic, faulty, starts_tick, to_stamp, topic
from .parameters import declare, seal

__all__ = ["LocoNode"]

_STEADY = Clock(clock_type=ClockType.STEADY_TIME)
_NO_NUMBERS = "numbers that are not finite"
# Endpoints must be matched this long before a node is ready, since discovery takes time [s].
_SETTLE_TIME = 0.2
_LAST_TICK, _LAST_TIME = 2**64 - 1, 2.0**31  # largest tick and time [s] of a message
_LONGEST = 2000  # longest text of an event, which may quote input of any length [characters]


class LocoNode(Node):
    """Node whose publishers and subscriptions come from the topic table.

    An invalid message does not end the node: it is refused and counted in /diagnostics, and the
    first one of each topic is reported by an event. Parameters are constant, except those passed to
    `parameters.on_change`.

    Args:
        name: Node name, as in the topic table.

    Attributes:
        table: The topic table of the graph that the node belongs to.
        timed: Whether ticks are scheduled by time: `on_deadline` is called at each `deadline`.
        changeable: Full names of the parameters that may be set while it runs.
        granted: Report lines on the settings of `RealtimeParams` that were granted or refused.
        post: Queue of the messages between nodes of the same process; None if DDS is used.
    """

    post: ClassVar[Post | None] = None
    table: ClassVar[dict[str, Topic]] = TOPICS
    timed = False
    deadline = math.inf  # next time of `time.monotonic` [s]

    def __init__(self, name: str):
        super().__init__(name, automatically_declare_parameters_from_overrides=False)
        self.changeable = seal(self)
        self.recorded = self.declare_parameter("recorded", False).value
        # Topics that the node `faults` damages.
        self.faulted = {n for n in self.declare_parameter("faulted", [""]).value if n}
        if not self.declare_parameter("allow_faults", False).value and self.faulted:
            raise ParameterError(
                f"{name} is told that faults damage {', '.join(sorted(self.faulted))}; that needs "
                "the parameter allow_faults:=true"
            )
        self._n_refused: dict[str, int] = {}  # number of refused messages by topic
        self._reason = ""  # reason of the newest refusal
        self._reported_refused = 0  # count at the last report
        self._outputs: dict[str, Any] = {}
        self._inputs: dict[str, Any] = {}
        self._health = declare(self, HealthParams(), "diagnostics.")
        self.realtime = declare(self, realtime.RealtimeParams(), "realtime.")
        self.granted: list[str] = []
        self._periods, self._usage = PeriodMeter(), UsageMeter()
        self._joins: list[TickJoin] = []
        self._stale_counts = 0  # counts at the last report
        self._events = self.output("events")
        self._diagnostics = self.output("/diagnostics")
        self._ready_timer = None
        self.create_timer(1.0, self.publish_diagnostics)

    def create_publisher(self, *args: Any, **kwargs: Any) -> Any:
        """Create a publisher as `Node` does, which also reaches nodes of the same process."""
        if self.post:
            kwargs["publisher_class"] = self.post.publisher
        return super().create_publisher(*args, **kwargs)

    def create_subscription(
        self, kind: type, name: str, callback: Callable, qos: Any, **kwargs: Any
    ) -> Any:
        """Create a subscription as `Node` does, which also hears nodes of the same process."""
        subscription = super().create_subscription(kind, name, callback, qos, **kwargs)
        if self.post:
            self.post.subscribe(subscription, callback)
        return subscription

    def create_timer(
        self,
        period: float,
        callback: Callable,
        callback_group: Any = None,
        clock: Any = _STEADY,
        **kwargs: Any,
    ) -> Any:
        """Create a timer as `Node` does, by default on the steady clock."""
        return super().create_timer(period, callback, callback_group, clock, **kwargs)

    def writers(self, subscription: Any) -> int:
        """Number of writers matched with a subscription."""
        in_process = self.post.writers(subscription.topic_name) if self.post else 0
        return subscription.get_publisher_count() + in_process

    def row(self, name: str) -> Topic:
        """Row of a topic in the table of this graph."""
        return topic(name, self.table)

    def output(self, name: str) -> Any:
        """Publisher of a topic of the table; `publish` takes bytes or a message."""
        row = self.row(name)
        self._outputs[name] = self.create_publisher(row.type, row.name, row.qos.writer())
        return self._outputs[name]

    def raw_output(self, name: str) -> Callable[[bytes], None]:
        """Function that publishes the bytes of a message on a topic of the table."""
        return raw(self.output(name))

    def input(self, name: str, callback: Callable, raw: bool = False) -> Any:
        """Subscription of a topic of the table.

        Args:
            name: Name of the topic in the table.
            callback: Function called with each valid message.
            raw: The callback takes the bytes instead and validates them itself.
        """
        row = self.row(name)
        topic_name = faulty(row.name) if name in self.faulted else row.name
        # After a lost tick the plant goes on while other nodes have not read that tick yet: with
        # a queue of one they would receive the next tick too early, and miss both.
        qos = row.qos.reader(FAULT_DEPTH if self.faulted else None)
        receive = callback if raw else self.reader(name, row.type, callback)
        self._inputs[name] = self.create_subscription(row.type, topic_name, receive, qos, raw=True)
        return self._inputs[name]

    def reader(self, name: str, kind: type, callback: Callable) -> Callable[[bytes], None]:
        """Callback for the bytes of a topic that passes on the messages that can be decoded.

        Args:
            name: Name of the topic, for `refuse`.
            kind: Class of its messages.
            callback: Function called with a message.
        """

        def receive(data: bytes) -> None:
            try:
                message = deserialize_message(data, kind)
            except Exception:  # an error of rclpy, or any other caused by these bytes
                self.refuse(name, f"{len(data)} bytes are no {kind.__name__}")
                return
            callback(message)

        return receive

    def refuse(self, name: str, reason: str) -> None:
        """Count an invalid message, and publish an event for the first one of a topic.

        Args:
            name: Name of the topic.
            reason: Human-readable reason.
        """
        repeated = name in self._n_refused
        self._n_refused[name] = self._n_refused.get(name, 0) + 1
        self._reason = f"{name}: {reason}"
        if not repeated:
            self.event("message refused", self._reason)

    def join(self, classes: dict[str, type], step: Callable) -> TickJoin:
        """Call ``step(a, b, …)`` once every topic of `classes` has sent the same tick."""
        readers = {name: Converter(cls) for name, cls in classes.items()}
        return self.join_by(readers, step)

    def join_by(
        self,
        readers: dict[str, Any],
        step: Callable,
        tick_of: Callable[[bytes], int] = loco_tick,
        *limits: Any,
    ) -> TickJoin:
        """As `join`, with a reader object per topic in place of a message class.

        Args:
            readers: Object per topic whose `read` decodes its bytes.
            step: Function called with the decoded messages, in the order of `readers`.
            tick_of: Function that extracts the tick from the bytes of a message.
            limits: `newest` and `on_refusal` of `TickJoin`; by default the node's `refuse` is
                called for an invalid tick.
        """
        if not limits:
            limits = None, lambda reason: self.refuse(" + ".join(readers), reason or _NO_NUMBERS)
        join = TickJoin(readers, step, self._periods, tick_of, *limits)
        self._joins.append(join)
        for name in readers:
            self.input(name, join.receiver(name), raw=True)
        return join

    def announce_ready(self) -> None:
        """Publish the event ``ready`` once every endpoint is matched in both directions."""
        self._matched_since = time.monotonic()
        self._ready_timer = self.create_timer(0.02, self._check_ready)

    def event(self, kind: str, text: str = "", tick: int = 0, t: float = 0.0) -> None:
        """Publish a one-time event."""
        self.publish_event(self.get_name(), kind, text, tick, t)

    def publish_event(self, node: str, kind: str, text: str, tick: int, t: float) -> None:
        """Publish an event in the name of this node or of the node that it represents.

        Args:
            node: Name of the node that the event concerns.
            kind: Kind of the event.
            text: Human-readable details.
            tick: Tick at which it happened.
            t: Simulated time [s].
        """
        text = text.encode("utf-8", "replace").decode()  # received text may end within a character
        text = text if len(text) <= _LONGEST else f"{text[: _LONGEST - 1]}…"
        tick = min(max(tick, 0), _LAST_TICK)  # received ticks and times may have any value
        stamp = to_stamp(t if abs(t) < _LAST_TIME else 0.0)
        message = Event(stamp=stamp, tick=tick, node=node, kind=kind, text=text)
        self._events.publish(message)

    def heard(self, topic: str, value: Any, tick: int) -> None:
        """Publish a received value and the first tick to which it applies; needed for replay."""
        self.event("heard", f"{topic} {value}", tick)

    def diagnose(self) -> dict[str, Any]:
        """Values for ``/diagnostics`` in addition to the tick period; nodes extend it."""
        return {}

    def on_deadline(self) -> None:
        """Called when `deadline` is reached."""

    def close(self) -> None:
        """Release resources of the node (physics client, files); called once at the end."""

    def unmatched(self) -> list[str]:
        """Topics with unmatched endpoints, each with a description of the missing endpoint."""
        missing = []
        for name, subscription in self._inputs.items():
            if not self.row(name).paced:
                continue
            count = self.writers(subscription)
            if count < 1:
                missing.append(f"{name} (no writer)")
            elif count > 1 and not all(map(is_named, self._living(subscription.topic_name))):
                missing.append(f"{name} (a writer whose node is not known yet)")
        for name, publisher in self._outputs.items():
            row = self.row(name)
            expected = (1 if name in self.faulted else len(row.readers)) + bool(self.recorded)
            expected += bool(self.faulted) and row == starts_tick(self.table)  # `faults` reads it
            if row.paced and publisher.get_subscription_count() < expected:
                missing.append(f"{name} ({publisher.get_subscription_count()}/{expected} readers)")
        return missing

    def _strangers(self) -> str:
        """First control topic with several writers, and their names; "" if there is none."""
        for name, subscription in self._inputs.items():
            if self.row(name).paced and self.writers(subscription) > 1:
                if conflict := strangers(self, subscription.topic_name, self._host()):
                    return conflict
        return ""

    def _refuse_strangers(self) -> None:
        """Raise an error if another graph writes the control topics; called before the start only.

        Raises:
            GraphError: A control topic has a second writer.
        """
        if conflict := self._strangers():
            raise GraphError(f"{conflict}; {ANOTHER}")

    def _living(self, name: str) -> list[Any]:
        """Writers of a topic whose processes are running."""
        return living(self.get_publishers_info_by_topic(name), self._host())

    def _host(self) -> bytes:
        return own_host(self.get_publishers_info_by_topic(self._events.topic_name))

    def _check_ready(self) -> None:
        self._refuse_strangers()
        time_now = time.monotonic()
        if self.unmatched():
            self._matched_since = time_now
        elif self._ready_timer is not None and time_now - self._matched_since > _SETTLE_TIME:
            self._ready_timer.cancel()
            self._ready_timer = None
            self.event("ready")

    def publish_diagnostics(self) -> None:
        """Publish the statistics since the last call; called at 1 Hz by a timer."""
        strangers = self._strangers()
        if strangers and self._ready_timer is not None:
            self._refuse_strangers()
        values = {**self._periods.summary(), **self._usage.summary(), **self._inputs_report()}
        values |= self.diagnose()
        if self.granted:
            values["realtime"] = "; ".join(self.granted)
        values |= self._refusals()
        level, text = judge(self._health, values)
        if strangers:
            level, text = ERROR, f"{strangers}; {text}"
        if self._ready_timer is not None:
            values["waiting for"] = ", ".join(self.unmatched())
            level, text = max(level, WARN), "waiting for endpoints"
        status = DiagnosticStatus(
            level=level,
            name=self.get_fully_qualified_name().lstrip("/"),
            message=text,
            hardware_id="loco",
            values=[KeyValue(key=key, value=_text(value)) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)

    def _refusals(self) -> dict[str, Any]:
        """Number of refused messages, in total and since the last report, and the newest reason."""
        total = sum(self._n_refused.values())
        new, self._reported_refused = total - self._reported_refused, total
        values: dict[str, Any] = {"refused_messages": total, "refused": new}
        return values | ({"refused_last": self._reason} if total else {})

    def _inputs_report(self) -> dict[str, Any]:
        """Number of late messages, time since the last tick [s], and missing inputs."""
        if not self._joins:
            return {}
        stale_count = sum(join.stale for join in self._joins)
        values: dict[str, Any] = {"stale": stale_count - self._stale_counts}
        self._stale_counts = stale_count
        if self._periods.silence is not None:
            values["silence"] = self._periods.silence
        values["missing"] = ", ".join(n for join in self._joins for n in join.missing())
        return values


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
