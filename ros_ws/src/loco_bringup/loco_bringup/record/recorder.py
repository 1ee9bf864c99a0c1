# SPDX-License-Identifier: Apache-2.0
"""Node `recorder`: writes every topic of the topic table to one bag, in its own process.

It publishes its progress to the plant (`recorder_status`), so that a lockstep run
waits for the disk and loses no message; missing ticks are counted. A full
disk ends the recording with the event `recording stopped`; the run continues.
Several robots, each in a namespace, can be recorded in the same bag; each plant
receives the progress of its own ticks.
"""

from __future__ import annotations

import dataclasses
import json
import logging
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from loco_control.exceptions import BagError, NameUnknownError, ParameterError
from loco_control.ros.executor import entry
from loco_control.ros.messages.convert import TICK
from loco_control.ros.messages.joint_topics import TABLES
from loco_control.ros.messages.topics import LOST_TICK, Topic, faulty, to_stamp
from loco_control.ros.node import LocoNode
from loco_msgs.msg import Event, RecorderStatus

from ..bag.writer import BagWriter, Limits

log = logging.getLogger(__name__)

FAULTS = LOST_TICK.writer
_STAMP_AT = 4  # byte offset of the stamp, after the CDR header
_LATEST = 2**31 * 10**9  # largest time that a stamp can represent [ns]
_MOST_TICKS = 2**40  # 35 years at 1 kHz: a larger number is no valid tick
_MOST_LOST = 10**6  # largest gap in ticks; a larger jump is a wrong number
_STARTS_TICK = {"hyq": "robot_state", "joint": "joint_states", "msd": "node_states"}  # by table


class RecorderNode(LocoNode):
    """Node with raw subscriptions to the topics of the table, which writes messages on arrival."""

    def __init__(self) -> None:
        super().__init__("recorder")
        folder = Path(self.declare_parameter("bag", "bags/unnamed").value)
        custom = json.loads(self.declare_parameter("custom_data", "{}").value)
        names = [n for n in self.declare_parameter("topics", [""]).value if n]
        # Nodes wait for a recorder on every topic, so it subscribes to unwritten topics too.
        self._written = [n for n in self.declare_parameter("written", [""]).value if n]
        graphs = self._graphs()
        self._rate = self.declare_parameter("control_rate", 250.0).value
        # With flow control no queue can overflow, and acknowledging each message would
        # cost the writers more than writing it. Operator messages stay reliable: the recorder may
        # discover their publishers later than the controllers do.
        self._reliable = self.declare_parameter("reliable", True).value
        # Ticks between two recorder_status messages: half of the lag that the plant allows.
        self.status_every = self.declare_parameter("status_every", 20).value
        self._attachments = [Path(p) for p in self.declare_parameter("attach", [""]).value if p]
        self.table = {**self.table, **_merged(graphs, self.faulted)}
        topics_by_space = {space: _select(names, TABLES[table]) for space, table in graphs}
        for _, table in graphs:
            _select(self._written, TABLES[table])
        size = int(self.declare_parameter("max_bagfile_size", 0).value)
        limits = Limits(size, float(self.declare_parameter("max_bagfile_duration", 0.0).value))
        custom = {str(k): str(v) for k, v in custom.items()}
        self.writer = BagWriter(folder, custom, limits=limits)
        self._received, self._dropped, self._stopped = 0, 0, False
        self._next_tick: dict[str, int] = {}
        self.robots = [_Robot(self, space, table) for space, table in graphs]
        for robot in self.robots:
            for row in topics_by_space[robot.namespace]:
                self._subscribe(robot, row)
                if row.name in self.faulted:
                    self._subscribe(robot, _damaged_copy(row))
        self.create_timer(0.1, self._tell_if_new)
        self.create_timer(1.0, self.writer.flush)
        self.create_timer(1.0, self._tell_again)
        self.announce_ready()

    def _graphs(self) -> list[tuple[str, str]]:
        """Namespace and table of each graph to record."""
        table = self.declare_parameter("table", "hyq").value
        spaces = [s.strip("/") for s in self.declare_parameter("namespaces", [""]).value]
        tables = [t or table for t in self.declare_parameter("tables", [""]).value]
        if len(tables) == 1:
            tables *= len(spaces)
        if len(tables) != len(spaces) or len(set(spaces)) != len(spaces):
            raise ParameterError(
                f"namespaces {spaces} must differ, and tables {tables} name one for each"
            )
        for name in tables:
            if name not in TABLES:
                raise NameUnknownError("topic table", name, TABLES)
        return list(zip(spaces, tables, strict=True))

    def _subscribe(self, robot: _Robot, row: Topic) -> None:
        key = _key(robot.namespace, row.name)
        if key in self._inputs:
            return  # a topic shared by all robots, such as /diagnostics
        name = self.resolve_topic_name(key)
        written = not self._written or row.name in self._written
        if written:
            self.writer.add_row(name, row)
        fields = list(row.type.get_fields_and_field_types())
        tick_of = self._tick_of(robot, row, fields)
        # Topics of foreign publishers and /diagnostics have wall-time stamps.
        # Those of operators and of the fault node may have any time.
        from_graph = row.name == "events" or row.writer not in ("any", FAULTS)
        stamped = from_graph and fields[:1] in (["stamp"], ["header"])
        write = self.writer.write if written else lambda topic, data, t: None

        def receive(data: bytes) -> None:
            try:
                record(data)
            except (ValueError, OverflowError, AssertionError, struct.error) as error:
                self.refuse(row.name, f"stamp or tick cannot be: {error}")

        def record(data: bytes) -> None:
            self._received += 1
            t = robot.now
            if stamped:
                t = _time(data)
                if not 0 <= t < _LATEST:
                    raise ValueError(f"{t / 1e9:g} s")
            tick = tick_of(data) if tick_of else 0
            if not 0 <= tick < _MOST_TICKS:
                raise ValueError(f"tick {tick}")
            if tick_of:
                self._count(key, tick)
            if row.name == robot.starts_tick:
                robot.moved(t, tick)
            write(name, data, t)

        self._inputs[key] = self.create_subscription(
            row.type, key, receive, row.qos.tap(self._reliable or row.writer == "any"), raw=True
        )

    def _tick_of(
        self, robot: _Robot, row: Topic, fields: list[str]
    ) -> Callable[[bytes], int] | None:
        """Function that reads the tick of a message; None for topics that skip ticks."""
        if fields[:2] == ["stamp", "tick"] and row.rate > 0:
            return lambda data: int.from_bytes(data[TICK], "little")
        paces = TABLES[robot.table].get(robot.starts_tick)
        if robot.table in ("joint", "msd") and fields[:1] == ["header"] and row.rate == paces.rate:
            return lambda data: round(_time(data) * self._rate / 1e9)
        return None

    def _count(self, key: str, tick: int) -> None:
        expected = self._next_tick.get(key, tick)
        if tick - expected >= _MOST_LOST:
            raise ValueError(f"tick {tick} after tick {expected - 1}")
        self._dropped += max(0, tick - expected)
        self._next_tick[key] = tick + 1

    def _tell_if_new(self) -> None:
        if self.writer.failed and not self._stopped:
            self._stopped = True
            count, end = self.writer.kept
            message = f"kept {count} messages up to {end:.3f} s, less the room for the index"
            text = f"{self.writer.failed}; {message}"
            self.get_logger().error(f"recording stopped: {text}")
            self.event("recording stopped", text, max(r.tick for r in self.robots))
        for robot in self.robots:
            if robot.tick != robot.told:
                robot.tell()

    def _tell_again(self) -> None:
        """Repeat the status, since a wrong one of another publisher would block the plant."""
        for robot in self.robots:
            robot.settle()
            if robot.tick >= 0:
                robot.tell()

    def status(self, stamp: int, tick: int) -> RecorderStatus:
        """Status of the recorder for a robot whose newest tick has this stamp [ns]."""
        return RecorderStatus(
            stamp=to_stamp(stamp / 1e9),
            tick=max(0, tick),
            received=self._received,
            written=self.writer.written,
            dropped=self._dropped,
        )

    def event(self, kind: str, text: str = "", tick: int = 0, t: float = 0.0) -> None:
        """Publish an event to the graph of each robot, unless the run has ended."""
        if not self.context.ok():
            return
        message = Event(stamp=to_stamp(t), tick=tick, node=self.get_name(), kind=kind, text=text)
        for name in dict.fromkeys(_key(robot.namespace, "events") for robot in self.robots):
            self._outputs[name].publish(message)

    def diagnose(self) -> dict[str, Any]:
        """Values for diagnostics: received messages and missing ticks."""
        tick = max((robot.tick for robot in self.robots), default=-1)
        return {"received": self._received, "dropped": self._dropped, "tick": tick}

    def drain(self) -> None:
        """Write messages that have arrived but are not handled yet, so that a stop loses none."""
        for subscription in self._inputs.values():
            with subscription.handle:
                while message := subscription.handle.take_message(subscription.msg_type, True):
                    subscription.callback(message[0])

    def close(self) -> None:
        """Write the pending messages, attach the run's files, then write index and metadata."""
        self.drain()
        for path in self._attachments:
            if path.is_file():
                self.writer.attach(path.name, path.read_bytes(), "application/octet-stream")
        self.writer.custom["received"] = str(self._received)
        self.writer.custom["dropped"] = str(self._dropped)
        try:
            self.writer.close()
        except BagError as error:
            log.error("%s", error)


class _Robot:
    """Newest tick of one robot's graph, and the publisher of the recorder's status."""

    def __init__(self, recorder: RecorderNode, namespace: str, table: str):
        self._recorder = recorder
        self.namespace, self.table = namespace, table
        self.starts_tick = _STARTS_TICK.get(table, "")
        self.now = 0  # simulated time of the newest tick [ns]
        self.tick = self.told = -1
        self._odd = -2  # newest tick that is not consecutive
        self._waiting: tuple[int, int] | None = None  # time [ns] and number of that tick
        self._waited = False  # whether it was already pending at the last call of `settle`
        if namespace:
            recorder.output(_key(namespace, "events"))
        if self.starts_tick:
            self._status = recorder.output(_key(namespace, "recorder_status"))

    def moved(self, time_ns: int, tick: int) -> None:
        """Accept a new tick if it is consecutive, and publish the status the plant waits for.

        Ticks of a foreign writer are not consecutive. After a restart of the plant or lost ticks,
        numbers are consecutive again from the second tick on; `settle` accepts a single one.
        """
        if self.tick >= 0 and tick not in (self.tick + 1, self._odd + 1):
            self._odd, self._waiting, self._waited = tick, (time_ns, tick), False
            return
        self._waiting = None
        self.now, self.tick = time_ns, tick
        if abs(tick - self.told) >= self._recorder.status_every or tick == 0:
            self.tell()

    def settle(self) -> None:
        """Accept a pending non-consecutive tick as the newest if no other tick followed."""
        if self._waiting and self._waited:
            (self.now, self.tick), self._waiting = self._waiting, None
        self._waited = True

    def tell(self) -> None:
        """Publish the status of the recorder, unless the run has ended."""
        self.told = self.tick
        if self._recorder.context.ok():
            self._status.publish(self._recorder.status(self.now, self.tick))


def _key(namespace: str, name: str) -> str:
    """Topic name relative to the recorder's namespace."""
    return name if name.startswith("/") or not namespace else f"{namespace}/{name}"


def _merged(graphs: list[tuple[str, str]], faulted: set[str]) -> dict[str, Topic]:
    """One topic table of all graphs, with the namespaces in the names."""
    merged = {}
    for space, table in graphs:
        rows = TABLES[table].values()
        for row in [*rows, *(_damaged_copy(row) for row in rows if row.name in faulted)]:
            name = _key(space, row.name)
            merged[name] = dataclasses.replace(row, name=name)
    return merged


def _damaged_copy(row: Topic) -> Topic:
    """Row of the damaged copy of a topic, which the readers receive; its ticks are not counted."""
    return dataclasses.replace(row, name=faulty(row.name), writer=FAULTS, rate=0.0)


def _time(data: bytes) -> int:
    seconds = int.from_bytes(data[_STAMP_AT : _STAMP_AT + 4], "little", signed=True)
    return seconds * 1_000_000_000 + int.from_bytes(data[_STAMP_AT + 4 : _STAMP_AT + 8], "little")


def _select(names: list[str], table: dict[str, Topic]) -> list[Topic]:
    for name in names:
        if name not in table:
            raise NameUnknownError("topic", name, table)
    return [table[name] for name in names or table if name != "recorder_status"]


main = entry(RecorderNode)  # ``ros2 run loco_bringup recorder``

if __name__ == "__main__":
    main()
