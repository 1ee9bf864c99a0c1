# SPDX-License-Identifier: Apache-2.0
"""`loco record`: record topics of any running ROS graph to a bag.

Types and QoS are taken from the discovered publishers; topics that appear
later are recorded from then on. Message bytes are written unchanged.
"""

from __future__ import annotations

import re
import time
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from rclpy.node import Node

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.ros.messages.definitions import definition, type_hash
from loco_control.ros.messages.installed import ros_class

from ..bag.writer import BagWriter, Limits, qos_dict
from ..client import GraphClient, kind_of, matching
from ..terminal import console

DEPTH = 1000  # queue length, for a slow disk
_CHECK_PERIOD = 0.25  # wall time between two checks for new topics [s]
_FLUSH = 1.0  # wall time after which a chunk is written even if it is not full [s]
_HIDDEN = ("/rosout", "/parameter_events")  # recorded only if requested by name


def record(
    topics: Sequence[str] = (),
    out: Path | None = None,
    exclude: str = "",
    duration: float = 0.0,
    stamps: bool = False,
    messages: int = 0,
    limits: Limits | None = None,
) -> int:
    """Record until Ctrl-C, a time limit, a number of messages, or a full disk.

    Args:
        topics: Names; empty for all topics except ``/rosout`` and ``/parameter_events``.
        out: New bag folder; default ``bags/record_TIME``.
        exclude: Regular expression of names to leave out.
        duration: Wall time after which to stop [s]; 0 for no limit.
        stamps: Whether log times are message stamps (for messages without a stamp, the newest
            stamp) in place of arrival times.
        messages: Approximate number of messages after which to stop (they arrive in batches); 0
            for no limit.
        limits: Size and time after which the next file of the bag begins.

    Returns:
        Exit code: 0, or 1 if no message arrived or the disk was full.

    Raises:
        ParameterError: `exclude` is no regular expression, or `duration` is negative.
        BagError: The folder holds a bag, or cannot be written.
    """
    if not duration >= 0.0:
        raise ParameterError(f"duration must be 0 or more seconds, got {duration}")
    try:
        pattern = re.compile(exclude) if exclude else None
    except re.error as error:
        raise ParameterError(f"--exclude must be a regular expression: {error}") from None
    folder = out or Path("bags") / f"record_{datetime.now():%Y%m%d-%H%M%S}"
    custom = {"recorded_at": datetime.now().astimezone().isoformat()}
    writer = BagWriter(folder, custom, limits=limits)
    client = GraphClient("loco_record")
    tap = Tap(client.node, writer, topics, pattern, stamps)
    try:
        _spin(client, tap, duration, messages)
    except KeyboardInterrupt:
        pass
    finally:
        client.close()
        writer.custom["log_time"] = "stamp" if stamps else "arrival"
        writer.close()
    return _print_summary(tap, writer)


def _spin(client: GraphClient, tap: Tap, duration: float, messages: int) -> None:
    began = flushed = time.monotonic()
    while not tap.writer.failed:
        tap.look()
        client.spin(_CHECK_PERIOD)
        time_now = time.monotonic()
        if time_now - flushed > _FLUSH:
            flushed = time_now
            tap.writer.flush()
        if (duration and time_now - began >= duration) or 0 < messages <= tap.counts.total():
            return


def _print_summary(tap: Tap, writer: BagWriter) -> int:
    count, _ = writer.kept
    console.print(f"{count} messages of {len(tap.counts)} topics: {writer.folder}")
    for name, reason in tap.refused.items():
        console.print(f"  not recorded: {name}: {reason}")
    if tap.missing:
        console.print(f"  never seen: {', '.join(sorted(tap.missing))}")
    if writer.failed:
        console.print(f"  recording stopped: {writer.failed}")
    return 0 if count and not writer.failed else 1


class Tap:
    """Subscriber to all discovered topics, which writes their messages to a bag.

    Args:
        node: Node that subscribes.
        writer: The bag.
        topics: Names of the topics; empty for all.
        exclude: Regular expression of names to leave out.
        stamps: Whether log times are message stamps; see `record`.

    Attributes:
        counts: Number of messages by topic.
        refused: Reason why a topic cannot be recorded, by name.
    """

    def __init__(
        self,
        node: Node,
        writer: BagWriter,
        topics: Sequence[str],
        exclude: re.Pattern[str] | None,
        stamps: bool,
    ):
        self.writer, self.counts, self.refused = writer, Counter[str](), dict[str, str]()
        self._node, self._exclude, self._stamps = node, exclude, stamps
        self._requested = {name if name.startswith("/") else f"/{name}" for name in topics}
        self._newest = 0  # newest stamp [ns]

    @property
    def missing(self) -> set[str]:
        """Requested topics that never appeared."""
        return self._requested - set(self.counts) - set(self.refused)

    def look(self) -> None:
        """Subscribe to new topics of the graph."""
        for name, types in self._node.get_topic_names_and_types():
            if name in self.counts or name in self.refused or not self._wants(name):
                continue
            offers = self._node.get_publishers_info_by_topic(name)
            if not offers:
                continue
            try:
                self._subscribe(name, types, offers)
            except NameUnknownError as error:
                self.refused[name] = str(error)

    def _wants(self, name: str) -> bool:
        if self._exclude and self._exclude.search(name):
            return False
        return name in self._requested if self._requested else name not in _HIDDEN

    def _subscribe(self, name: str, types: list[str], offers: list[Any]) -> None:
        if len(types) != 1:
            raise NameUnknownError("one message type among", ", ".join(types), [])
        kind = ros_class(types[0])
        text, hash_ = definition(types[0]), type_hash(types[0])
        fields = list(kind.get_fields_and_field_types().items())
        stamped = fields and fields[0][1] in ("builtin_interfaces/Time", "std_msgs/Header")
        offered_profiles = [offer.qos_profile for offer in offers]
        profiles = [qos_dict(*kind_of(qos), qos.depth or 1) for qos in offered_profiles]
        self.writer.add_topic(name, types[0], text, hash_, profiles)
        self.counts[name] = 0

        def receive(data: bytes) -> None:
            self.counts[name] += 1
            self.writer.write(name, data, self._time(data, bool(stamped)))

        self._node.create_subscription(kind, name, receive, matching(offers, DEPTH), raw=True)

    def _time(self, data: bytes, stamped: bool) -> int:
        """Log time of a message [ns]."""
        if not self._stamps:
            return time.time_ns()
        if stamped:
            seconds = int.from_bytes(data[4:8], "little", signed=True)
            self._newest = seconds * 1_000_000_000 + int.from_bytes(data[8:12], "little")
        return self._newest
