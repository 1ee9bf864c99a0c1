# SPDX-License-Identifier: Apache-2.0
"""What every node of the graph has: topics from the table, readiness, ticks, diagnostics.

`spin.run_nodes` is the only way a node is spun.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from loco_control import realtime
from loco_control.exceptions import GraphError, LocoError
from loco_msgs.msg import Event

from .convert import TICK, Converter
from .endpoints import is_named, living, low_pid, own_host
from .health import WARN, HealthParams, PeriodMeter, UsageMeter, judge
from .parameters import declare
from .topics import FAULT_DEPTH, TOPICS, Topic, faulty, starts_tick, to_stamp, topic

__all__ = ["LocoNode", "PeriodMeter", "TickJoin", "loco_tick"]

_PENDING = 8  # messages of a topic that wait for those of others
_BACK = 4  # ticks that a state may be late; one that is later means that the clock was set back


def loco_tick(data: bytes) -> int:
    """Tick in the bytes of a message of `loco_msgs`."""
    return int.from_bytes(data[TICK], "little")


class LocoNode(Node):
    """Node whose publishers and subscriptions come from the topic table.

    Args:
        name: Node name, as in the topic table.

    Attributes:
        table: The topic table of the graph that the node belongs to.
        timed: Ticks are due at times: `on_deadline` is called at each `deadline`.
        granted: What the process was granted and refused of `RealtimeParams`.
    """

    table: ClassVar[dict[str, Topic]] = TOPICS
    timed = False
    deadline = math.inf  # next time of `time.monotonic` [s]

    def __init__(self, name: str):
        super().__init__(name, automatically_declare_parameters_from_overrides=False)
        self.recorded = self.declare_parameter("recorded", False).value
        # Topics between whose writers and readers the node `faults` stands.
        self.faulted = {n for n in self.declare_parameter("faulted", [""]).value if n}
        self._outputs: dict[str, Any] = {}
        self._inputs: dict[str, Any] = {}
        self._health = declare(self, HealthParams(), "diagnostics.")
        self.realtime = declare(self, realtime.RealtimeParams(), "realtime.")
        self.granted: list[str] = []
        self._periods, self._usage = PeriodMeter(), UsageMeter()
        self._joins: list[TickJoin] = []
        self._stale = 0  # at the last report
        self._events = self.output("events")
        self._diagnostics = self.output("/diagnostics")
        self._ready_timer = None
        self.create_timer(1.0, self.publish_diagnostics)

    def row(self, name: str) -> Topic:
        """Row of a topic in the table of this graph."""
        return topic(name, self.table)

    def output(self, name: str) -> Any:
        """Publisher of a topic of the table; `publish` takes bytes or a message."""
        row = self.row(name)
        self._outputs[name] = self.create_publisher(row.type, row.name, row.qos.writer())
        return self._outputs[name]

    def raw_output(self, name: str) -> Callable[[bytes], None]:
        """Function that publishes the bytes of a message on a topic of the table.

        It is rclpy's compiled publish without the checks in Python around it, which
        took 3 % of a composed tick.
        """
        return self.output(name).handle.publish_raw

    def input(self, name: str, callback: Callable, raw: bool = False) -> Any:
        """Subscription of a topic of the table."""
        row = self.row(name)
        heard = faulty(row.name) if name in self.faulted else row.name
        # A plant that was told of a lost tick goes on while others still have to read it:
        # with a queue of one they would find the next tick, too early, and miss both.
        qos = row.qos.reader(FAULT_DEPTH if self.faulted else None)
        self._inputs[name] = self.create_subscription(row.type, heard, callback, qos, raw=raw)
        return self._inputs[name]

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
        """As `join`, with an object per topic whose `read` decodes its bytes.

        Args:
            readers: By topic.
            step: Gets what they read, in their order.
            tick_of: Number in the bytes of a message that all messages of a tick share.
            limits: `newest` and `refuse` of `TickJoin`.
        """
        join = TickJoin(readers, step, self._periods, tick_of, *limits)
        self._joins.append(join)
        for name in readers:
            self.input(name, join.receiver(name), raw=True)
        return join

    def announce_ready(self) -> None:
        """Publish the event ``ready`` once every endpoint is matched in both directions."""
        self._ready_timer = self.create_timer(0.02, self._check_ready)

    def event(self, kind: str, text: str = "", tick: int = 0, t: float = 0.0) -> None:
        """Publish something that happens once."""
        message = Event(stamp=to_stamp(t), tick=tick, node=self.get_name(), kind=kind, text=text)
        self._events.publish(message)

    def heard(self, topic: str, value: Any, tick: int) -> None:
        """Tell what somebody said and the first tick for which it counts; replay needs it."""
        self.event("heard", f"{topic} {value}", tick)

    def diagnose(self) -> dict[str, Any]:
        """Values for ``/diagnostics`` beside the tick period; nodes extend it."""
        return {}

    def on_deadline(self) -> None:
        """A `deadline` has come."""

    def close(self) -> None:
        """Free what the node holds (physics client, files); called once at the end."""

    def unmatched(self) -> list[str]:
        """Topics that still wait for an endpoint, with what is missing."""
        missing = []
        for name, subscription in self._inputs.items():
            if _paced(self.row(name)) and subscription.get_publisher_count() < 1:
                missing.append(f"{name} (no writer)")
        for name, publisher in self._outputs.items():
            row = self.row(name)
            wanted = (1 if name in self.faulted else len(row.readers)) + bool(self.recorded)
            wanted += bool(self.faulted) and row == starts_tick(self.table)  # `faults` follows it
            if _paced(row) and publisher.get_subscription_count() < wanted:
                missing.append(f"{name} ({publisher.get_subscription_count()}/{wanted} readers)")
        return missing

    def _refuse_strangers(self) -> None:
        """A second writer of a control topic would answer our ticks with its own."""
        for name, subscription in self._inputs.items():
            if _paced(self.row(name)) and subscription.get_publisher_count() > 1:
                writers = self._writers(subscription.topic_name)
                if len(writers) > 1:
                    who = ", ".join(f"{w.node_name} of process {low_pid(w)}" for w in writers)
                    raise GraphError(
                        f"{name} has {len(writers)} writers ({who}); another graph runs on this "
                        "ROS domain and namespace"
                    )

    def _writers(self, name: str) -> list[Any]:
        """Writers of a topic whose processes live and whose nodes are known."""
        host = own_host(self.get_publishers_info_by_topic(self._events.topic_name))
        return list(filter(is_named, living(self.get_publishers_info_by_topic(name), host)))

    def _check_ready(self) -> None:
        self._refuse_strangers()
        if self._ready_timer is not None and not self.unmatched():
            self._ready_timer.cancel()
            self._ready_timer = None
            self.event("ready")

    def publish_diagnostics(self) -> None:
        """Publish the figures since the last call; a timer does it at 1 Hz."""
        self._refuse_strangers()
        values = {**self._periods.summary(), **self._usage.summary(), **self._inputs_report()}
        values |= self.diagnose()
        if self.granted:
            values["realtime"] = "; ".join(self.granted)
        level, text = judge(self._health, values)
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

    def _inputs_report(self) -> dict[str, Any]:
        """What came too late, how long ago the last tick was, and what the next one lacks."""
        if not self._joins:
            return {}
        stale = sum(join.stale for join in self._joins)
        values: dict[str, Any] = {"stale": stale - self._stale}
        self._stale = stale
        if self._periods.silence is not None:
            values["silence"] = self._periods.silence
        values["missing"] = ", ".join(n for join in self._joins for n in join.missing())
        return values


class TickJoin:
    """Collects one message per topic and calls `step` when all have the same tick.

    A tick is any number that grows: the tick itself, or the stamp. One that was answered
    already, or an older one, is stale: counted and not answered. A message that cannot be
    used is refused: nobody steps with numbers that are not finite.

    Args:
        readers: By topic: `read` decodes its bytes, ``finite(data, value)`` judges them.
        step: Gets what they read.
        meter: Is told of each step.
        tick_of: Number in the bytes of a message that all messages of a tick share.
        newest: For plants: the newest tick that anyone can know of; what claims to be newer
            is stale, too. Without it a first topic that goes back by more than `_BACK` ticks
            is believed: the plant's clock was set back. A message more than a tick ahead of
            the first topic waits, for that may be late; when another one of its topic comes
            before that tick its clock was wrong, and it is stale.
        refuse: Is told why a tick was refused: an error in words, or "" for not finite;
            without it an error is raised.
    """

    def __init__(
        self,
        readers: dict[str, Any],
        step: Callable,
        meter: PeriodMeter,
        tick_of: Callable[[bytes], int] = loco_tick,
        newest: Callable[[], int] | None = None,
        refuse: Callable[[str], None] | None = None,
    ):
        self._readers, self._tick_of = readers, tick_of
        self._step, self._meter = step, meter
        self._newest, self._refuse = newest, refuse
        self._waiting: dict[str, dict[int, bytes]] = {name: {} for name in readers}  # by tick
        self._heard = -1  # tick of the newest message that waits
        self._period = 0  # smallest number of a step from one tick to the next, 0 unknown
        self._begun = -1  # tick of the last message of the first topic
        self.done = -1  # newest tick answered
        self.stale = self.refused = 0

    def receiver(self, name: str) -> Callable[[bytes], None]:
        """Callback for the raw bytes of one topic."""
        tick_of, own, others = self._tick_of, self._waiting[name], self._waiting.values()
        first, count = own is next(iter(others)), len(self._readers)

        def receive(data: bytes) -> None:
            tick = tick_of(data)
            if first:
                self._begun = tick
            elif own and self._newest is None:
                self._forget_early(own)
            if tick <= self.done or (self._newest is not None and tick > self._newest()):
                self.stale += 1
                if not first or not self._set_back(tick):
                    return
            own[tick], self._heard = data, tick
            found = [messages[tick] for messages in others if tick in messages]
            if len(found) == count:
                self._answer(tick, found)
            elif len(own) > _PENDING:
                del own[next(iter(own))]

        return receive

    def _forget_early(self, own: dict[int, bytes]) -> None:
        """Another message came after one of a tick that did not begin: its clock was wrong."""
        for tick in [t for t in own if self._period and t > self._begun + self._period]:
            del own[tick]
            self.stale += 1

    def _set_back(self, tick: int) -> bool:
        """Whether the clock was set back, and not a message late; then begin anew there."""
        known = self._period and self._newest is None
        if not known or tick > self.done - _BACK * self._period:
            return False
        self.done = tick - self._period
        for messages in self._waiting.values():
            messages.clear()
        return True

    def missing(self) -> list[str]:
        """Topics that the next step still waits for."""
        return [name for name, own in self._waiting.items() if self._heard not in own]

    def _answer(self, tick: int, found: list[bytes]) -> None:
        readers = self._readers.values()
        try:
            values = [reader.read(data) for reader, data in zip(readers, found, strict=True)]
        except LocoError as error:
            self.refused += 1
            for own in self._waiting.values():
                del own[tick]  # another message may still be right
            if self._refuse is None:
                raise
            self._refuse(str(error))
            return
        if self.done >= 0:
            self._period = min(self._period or tick, tick - self.done)
        self.done = tick
        for own in self._waiting.values():
            for old in [t for t in own if t <= tick]:
                del own[old]
        judged = zip(readers, found, values, strict=True)
        if not all(reader.finite(data, value) for reader, data, value in judged):
            self.refused += 1
            if self._refuse is not None:
                self._refuse("")
            return
        self._meter.mark()
        self._step(*values)


def _paced(row: Topic) -> bool:
    return row.rate > 0 and row.qos.reliable


def _text(value: Any) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
