# SPDX-License-Identifier: Apache-2.0
"""Node `faults`: damages the messages of topics between their writers and readers.

Readers of a topic in the parameter `faulted` subscribe to ``faulty/TOPIC``, which this node
writes. The topic itself is unchanged. Begin and end of each fault are published as events.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Iterator
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message
from std_msgs.msg import UInt64

from .. import faults
from ..exceptions import ParameterError
from .executor import entry
from .in_process import raw
from .messages.codec import Codec
from .messages.convert import TICK
from .messages.joint_codec import tick_of
from .messages.joint_topics import TABLES
from .messages.topics import LOST_TICK, Topic, faulty, starts_tick
from .node import LocoNode

NAME = LOST_TICK.writer
_TIME, _HEADER = "builtin_interfaces/Time", "std_msgs/Header"


def abilities(table: str) -> dict[str, set[str]]:
    """Per topic of a table, the contents that a fault may change: numbers, stamp."""
    kinds_by_topic = {}
    for row in TABLES[table].values():
        has = {"numbers": has_numbers(row.type), "stamp": stamp_at(row.type) is not None}
        kinds_by_topic[row.name] = {what for what, supported in has.items() if supported}
    return kinds_by_topic


@functools.cache
def has_numbers(cls: type) -> bool:
    """Whether a message class has floating-point fields, at any nesting depth."""
    for kind in cls.get_fields_and_field_types().values():
        element = kind.removeprefix("sequence<").rstrip(">").partition("[")[0].partition(",")[0]
        if element in ("double", "float") or ("/" in element and has_numbers(_class(element))):
            return True
    return False


@functools.cache
def stamp_at(cls: type) -> int | None:
    """Byte offset of the stamp of a message; None if the message does not begin with a stamp."""
    kind = next(iter(cls.get_fields_and_field_types().values()), "")
    if kind in (_TIME, _HEADER):
        return 4
    if kind.startswith("sequence<"):  # the length of the sequence comes first
        inner = kind.removeprefix("sequence<").rstrip(">")
        return 8 if "/" in inner and stamp_at(_class(inner)) == 4 else None
    return None


def _class(kind: str) -> type:
    package, _, name = kind.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), name)


class Bytes:
    """Access to stamp, tick and numbers in the serialised messages of a topic.

    Args:
        row: Topic, a row of the topic table.
        rate: Ticks per second [Hz].
    """

    def __init__(self, row: Topic, rate: float):
        fields = list(row.type.get_fields_and_field_types())
        self._type, self._rate, self._at = row.type, rate, stamp_at(row.type)
        self._has_tick = fields[:2] == ["stamp", "tick"]
        self._constant, self._codec = row.rate > 0, None

    def time(self, data: bytes) -> int | None:
        """Stamp [ns]; None if the messages have none."""
        if self._at is None or len(data) < self._at + 8:
            return None
        seconds = int.from_bytes(data[self._at : self._at + 4], "little", signed=True)
        return seconds * 1_000_000_000 + int.from_bytes(data[self._at + 4 : self._at + 8], "little")

    def tick(self, data: bytes) -> int:
        """Tick of a message with a stamp."""
        if self._has_tick:
            return int.from_bytes(data[TICK], "little")
        return tick_of(self.time(data) or 0, self._rate)

    def finite(self, data: bytes) -> bool:
        """Whether all numbers are finite."""
        doubles = np.frombuffer(data, np.float64, len(data) - 4 >> 3, 4)  # see `Converter.finite`
        return bool(np.isfinite(doubles).all())

    def with_numbers(self, data: bytes, source: bytes | None) -> bytes:
        """The message with the numbers of another one of its layout, or with NaN."""
        if self._codec is None or not self._constant:
            self._codec = Codec(deserialize_message(data, self._type), len(data))
        if source is not None and len(source) != len(data):
            return data
        record = self._codec.decode(bytearray(data))
        other = None if source is None else self._codec.decode(source)
        for name in self._codec.dtype.names:
            if record[name].dtype.kind == "f":
                record[name] = float("nan") if other is None else other[name]
        return record.tobytes()

    def later(self, data: bytes, seconds: float) -> bytes:
        """The message with its stamp shifted by `seconds` [s], not below 0, and its tick."""
        time = max(0, (self.time(data) or 0) + round(seconds * 1e9))
        sec, nanoseconds = divmod(time, 1_000_000_000)
        changed = bytearray(data)
        changed[self._at : self._at + 4] = sec.to_bytes(4, "little")
        changed[self._at + 4 : self._at + 8] = nanoseconds.to_bytes(4, "little")
        if self._has_tick:
            tick = max(0, self.tick(data) + round(seconds * self._rate))
            changed[TICK] = tick.to_bytes(8, "little")
        return bytes(changed)


class FaultNode(LocoNode):
    """One subscription and one publisher per damaged topic."""

    def __init__(self) -> None:
        super().__init__(NAME)
        table = self.declare_parameter("table", "hyq").value
        self.table = TABLES[table]
        self._rate = self.declare_parameter("control_rate", 250.0).value
        specs = [t for t in self.declare_parameter("faults", [""]).value if t]
        if specs and not self.get_parameter("allow_faults").value:
            raise ParameterError(
                "faults are off; the parameter allow_faults:=true switches them on"
            )
        faults_by_topic = faults.check(specs, abilities(table))
        self._time, self._tick = 0.0, 0
        self._edges = sorted(_edges(faults_by_topic), reverse=True)
        self._lost = self.create_publisher(LOST_TICK.type, LOST_TICK.name, LOST_TICK.qos.writer())
        self._states: Any = None
        for name in dict.fromkeys(name for name, _ in faults_by_topic):
            self._stand_between(name, [f for n, f in faults_by_topic if n == name])
        self._follow(starts_tick(self.table))
        self.announce_ready()

    def _follow(self, row: Topic) -> None:
        """Subscribe to the topic that starts the ticks, as the source of the simulated time."""
        body = Bytes(row, self._rate)

        def receive(data: bytes) -> None:
            self._at(body.tick(data), (body.time(data) or 0) / 1e9)

        self._states = self.create_subscription(
            row.type, row.name, receive, row.qos.reader(), raw=True
        )

    def _at(self, tick: int, t: float) -> None:
        self._tick, self._time = tick, t
        while self._edges and self._edges[-1][0] <= t + 1e-9:
            _, kind, text = self._edges.pop()
            self.event(kind, text, tick, t)

    def _stand_between(self, name: str, topic_faults: list[faults.Fault]) -> None:
        row, body = self.row(name), Bytes(self.row(name), self._rate)
        chain = [faults.Memory(fault, name, body) for fault in topic_faults]
        output = self.create_publisher(row.type, faulty(row.name), row.qos.writer())
        self._outputs[name] = output
        publish = raw(output)
        # If such a message is lost, the tick has no command. The plant validates commands itself.
        waited_for = row.rate > 0 and bool(row.readers)
        for_plant = row.readers == ("robot_sim",)

        def receive(data: bytes) -> None:
            try:
                damage(data)
            except (ValueError, RuntimeError, OverflowError, TypeError):
                self.refuse(name, f"{len(data)} bytes are no {row.type.__name__}")

        def damage(data: bytes) -> None:
            time = body.time(data)
            t = self._time if time is None or row.writer == "any" else time / 1e9
            out = [data]
            for memory in chain:
                out = memory.feed(out, t)
            for each in out:
                publish(each)
            if waited_for and not any(
                body.time(each) == time and (for_plant or each == data or body.finite(each))
                for each in out
            ):
                self._lost.publish(UInt64(data=body.tick(data)))

        self.input(name, receive, raw=True)

    def unmatched(self) -> list[str]:
        """As in the base class; the plant must also subscribe to lost ticks."""
        missing = super().unmatched()
        if self._lost.get_subscription_count() < 1:
            missing.append(f"{LOST_TICK.name} (0/1 readers)")
        if self.writers(self._states) < 1:
            missing.append(f"{self._states.topic_name} (no writer)")
        return missing


def _edges(faults_by_topic: list[tuple[str, faults.Fault]]) -> Iterator[tuple[float, str, str]]:
    """Simulated time [s], kind and text of the event at the begin and end of each fault."""
    for name, fault in faults_by_topic:
        text = faults.to_text(name, fault)
        yield fault.start, "fault", text
        if np.isfinite(fault.stop):
            yield fault.stop, "fault over", text


main = entry(FaultNode)  # ``ros2 run loco_control faults``

if __name__ == "__main__":
    main()
