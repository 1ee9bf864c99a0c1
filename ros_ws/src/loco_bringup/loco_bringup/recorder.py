# SPDX-License-Identifier: Apache-2.0
"""Node `recorder`: every topic of the table into one bag, in a process of its own.

It tells the plant how far it is (`recorder_status`), so that a lockstep run
waits for the disk and loses nothing; ticks that are missing are counted.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from loco_control.exceptions import NameUnknownError
from loco_control.ros.convert import TICK
from loco_control.ros.node import LocoNode, run_nodes
from loco_control.ros.topics import TOPICS, Topic, to_stamp
from loco_msgs.msg import RecorderStatus

from .bag_writer import BagWriter

_STATUS_EVERY = 20  # ticks between two recorder_status messages
_STAMP_AT = 4  # bytes: after the CDR header


class RecorderNode(LocoNode):
    """Raw subscriptions to the table's topics, written as they arrive."""

    def __init__(self) -> None:
        super().__init__("recorder")
        folder = Path(self.declare_parameter("bag", "bags/unnamed").value)
        custom = json.loads(self.declare_parameter("custom_data", "{}").value)
        wanted = self.declare_parameter("topics", [""]).value
        # With flow control no queue can overflow, and acknowledging each message would
        # cost the writers more than writing it.
        self._reliable = self.declare_parameter("reliable", True).value
        self._attachments = [Path(p) for p in self.declare_parameter("attach", [""]).value if p]
        self.writer = BagWriter(folder, {str(k): str(v) for k, v in custom.items()})
        self._now = 0  # simulated time of the newest robot_state [ns]
        self._tick = self._told = -1
        self._received = self._dropped = 0
        self._next_tick: dict[str, int] = {}
        self._status = self.output("recorder_status")
        for row in _chosen([name for name in wanted if name]):
            self._subscribe(row)
        self.create_timer(0.1, self._tell_if_new)
        self.create_timer(1.0, self.writer.flush)
        self.announce_ready()

    def _subscribe(self, row: Topic) -> None:
        name = self.resolve_topic_name(row.name)
        self.writer.add_row(name, row)
        fields = list(row.type.get_fields_and_field_types())
        ticked = fields[:2] == ["stamp", "tick"] and row.rate > 0
        # Topics of other people and /diagnostics are stamped with wall time.
        stamped = fields[0] in ("stamp", "header") and (row.writer != "any" or row.name == "events")
        write = self.writer.write

        def receive(data: bytes) -> None:
            self._received += 1
            t = self._now
            if stamped:
                t = _time(data)
            if ticked:
                self._count(row.name, int.from_bytes(data[TICK], "little"), t)
            write(name, data, t)

        self._inputs[row.name] = self.create_subscription(
            row.type, row.name, receive, row.qos.tap(self._reliable), raw=True
        )

    def _count(self, name: str, tick: int, t: int) -> None:
        expected = self._next_tick.get(name, tick)
        self._dropped += max(0, tick - expected)
        self._next_tick[name] = tick + 1
        if name == "robot_state":
            self._now, self._tick = t, tick
            if tick - self._told >= _STATUS_EVERY or tick == 0:
                self._tell()

    def _tell_if_new(self) -> None:
        if self._tick > self._told:
            self._tell()

    def _tell(self) -> None:
        self._told = self._tick
        self._status.publish(
            RecorderStatus(
                stamp=to_stamp(self._now / 1e9),
                tick=max(0, self._tick),
                received=self._received,
                written=self.writer.written,
                dropped=self._dropped,
            )
        )

    def diagnose(self) -> dict[str, Any]:
        """Messages received and ticks missing."""
        return {"received": self._received, "dropped": self._dropped, "tick": self._tick}

    def close(self) -> None:
        """Attach the run's files, then write index and metadata."""
        for path in self._attachments:
            if path.is_file():
                self.writer.attach(path.name, path.read_bytes(), "application/octet-stream")
        self.writer.custom["received"] = str(self._received)
        self.writer.custom["dropped"] = str(self._dropped)
        self.writer.close()


def _time(data: bytes) -> int:
    seconds = int.from_bytes(data[_STAMP_AT : _STAMP_AT + 4], "little", signed=True)
    return seconds * 1_000_000_000 + int.from_bytes(data[_STAMP_AT + 4 : _STAMP_AT + 8], "little")


def _chosen(names: list[str]) -> list[Topic]:
    for name in names:
        if name not in TOPICS:
            raise NameUnknownError("topic", name, TOPICS)
    return [TOPICS[name] for name in names or TOPICS if name != "recorder_status"]


def main(args: list[str] | None = None) -> None:
    """Entry point of ``ros2 run loco_bringup recorder``."""
    sys.exit(run_nodes([RecorderNode], args))


if __name__ == "__main__":
    main()
