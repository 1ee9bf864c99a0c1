# SPDX-License-Identifier: Apache-2.0
"""Writes a rosbag2 folder: one MCAP file and ``metadata.yaml`` version 9.

Log and publish time of a message are simulated time, as ``ros2 bag record
--use-sim-time`` does; so replays and plots do not depend on the host's speed.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from mcap.writer import CompressionType, Writer

from loco_control.exceptions import BagError
from loco_control.ros.topics import Topic

from .interfaces import definition, type_hash, type_name

CHUNK_SIZE = 256 * 1024
LIBRARY = "loco"


@dataclass
class _Channel:
    id: int
    meta: dict[str, Any]
    count: int = 0


class BagWriter:
    """One bag folder being written.

    Args:
        folder: New folder of the bag; its name is the name of the bag.
        custom_data: Texts kept in the bag's metadata (experiment, seed, versions).

    Raises:
        BagError: The folder holds a bag already.
    """

    def __init__(self, folder: Path, custom_data: dict[str, str] | None = None):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self._path = self.folder / f"{self.folder.name}_0.mcap"
        if self._path.exists():
            raise BagError(f"{self._path} exists already; choose another folder")
        self.custom = custom_data or {}
        self._file = open(self._path, "wb")  # noqa: SIM115 (closed in close)
        self._writer = Writer(self._file, CHUNK_SIZE, CompressionType.ZSTD)
        self._writer.start("ros2", LIBRARY)
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._start: int | None = None
        self._end = 0
        self._write_metadata()

    def add_topic(self, name: str, kind: str, text: str, hash_: str, qos: list[dict]) -> None:
        """Announce a topic.

        Args:
            name: Topic name with its leading slash.
            kind: Message type, ``package/msg/Type``.
            text: Message definition with everything it contains.
            hash_: RIHS01 hash of the type.
            qos: Offered profiles, as `qos_dict` makes them.
        """
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", text.encode())
        profiles = yaml.safe_dump(qos, sort_keys=False)
        channel = self._writer.register_channel(
            name, "cdr", self._schemas[kind],
            {"offered_qos_profiles": profiles, "topic_type_hash": hash_},
        )  # fmt: skip
        meta = {
            "name": name,
            "type": kind,
            "serialization_format": "cdr",
            "offered_qos_profiles": qos,
            "type_description_hash": hash_,
        }
        self._channels[name] = _Channel(channel, meta)

    def add_row(self, name: str, row: Topic) -> None:
        """Announce a topic of the table under the name `name`."""
        kind = type_name(row.type)
        qos = qos_dict(row.qos.reliable, row.qos.latched, row.qos.depth)
        self.add_topic(name, kind, definition(kind), type_hash(kind), [qos])

    def write(self, topic: str, data: bytes, t: int, sequence: int = 0) -> None:
        """Append a serialised message with its simulated time [ns]."""
        channel = self._channels[topic]
        channel.count += 1
        self._start = t if self._start is None else min(self._start, t)
        self._end = max(self._end, t)
        self._writer.add_message(channel.id, t, data, t, sequence)

    @property
    def written(self) -> int:
        """Messages given to the writer so far."""
        return sum(channel.count for channel in self._channels.values())

    def attach(self, name: str, data: bytes, media_type: str = "text/yaml") -> None:
        """Put a file (configuration, weights) inside the bag."""
        self._writer.add_attachment(self._end, self._end, name, media_type, data)

    def flush(self) -> None:
        """Close the chunk in progress and hand it to the system: what a crash cannot take."""
        self._writer.flush()

    def close(self) -> None:
        """Write index, statistics and the final ``metadata.yaml``."""
        if self._file.closed:
            return
        info = yaml.safe_dump(self._information(), sort_keys=False)
        self._writer.add_metadata("rosbag2", {"serialized_metadata": info})
        self._writer.add_metadata(LIBRARY, self.custom)
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()
        self._write_metadata()

    def _write_metadata(self) -> None:
        path = self.folder / "metadata.yaml"
        partial = path.with_suffix(".partial")
        content = {"rosbag2_bagfile_information": self._information()}
        partial.write_text(yaml.safe_dump(content, sort_keys=False))
        partial.replace(path)

    def _information(self) -> dict[str, Any]:
        start = self._start or 0
        length = {"nanoseconds": max(0, self._end - start)}
        begin = {"nanoseconds_since_epoch": start}
        return {
            "version": 9,
            "storage_identifier": "mcap",
            "duration": length,
            "starting_time": begin,
            "message_count": self.written,
            "topics_with_message_count": [
                {"topic_metadata": c.meta, "message_count": c.count}
                for c in self._channels.values()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._path.name],
            "files": [
                {
                    "path": self._path.name,
                    "starting_time": begin,
                    "duration": length,
                    "message_count": self.written,
                }
            ],
            "custom_data": self.custom,
            "ros_distro": "jazzy",
        }


def qos_dict(reliable: bool, latched: bool, depth: int) -> dict[str, Any]:
    """QoS profile in the words of rosbag2's metadata version 9."""
    forever = {"sec": 9223372036, "nsec": 854775807}
    return {
        "history": "keep_last",
        "depth": depth,
        "reliability": "reliable" if reliable else "best_effort",
        "durability": "transient_local" if latched else "volatile",
        "deadline": dict(forever),
        "lifespan": dict(forever),
        "liveliness": "automatic",
        "liveliness_lease_duration": dict(forever),
        "avoid_ros_namespace_conventions": False,
    }
