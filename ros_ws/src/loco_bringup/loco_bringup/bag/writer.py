# SPDX-License-Identifier: Apache-2.0
"""Writes a rosbag2 folder: one MCAP file and ``metadata.yaml`` version 9.

Log and publish time of a message are simulated time, as ``ros2 bag record
--use-sim-time`` does; so replays and plots do not depend on the host's speed.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import BagError
from loco_control.files import write_whole
from loco_control.ros.messages.definitions import definition, type_hash
from loco_control.ros.messages.topics import Topic

from .mcap_writer import McapWriter
from .progress import Progress

CHUNK_SIZE = 256 * 1024
LIBRARY = "loco"


@dataclass
class _Channel:
    id: int
    meta: dict[str, Any]


class BagWriter:
    """One bag folder being written.

    A full disk ends the recording, not the program: what came before stays, as a whole bag,
    and `failed` says why.

    Args:
        folder: New folder of the bag; its name is the name of the bag.
        custom_data: Texts kept in the bag's metadata (experiment, seed, versions).
        chunk_size: Bytes of messages after which a chunk is written.

    Attributes:
        written: Messages given to the writer so far.
        failed: Why nothing more is written; empty while all is well.

    Raises:
        BagError: The folder holds a bag already, or cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        custom_data: dict[str, str] | None = None,
        chunk_size: int = CHUNK_SIZE,
    ):
        self.folder = Path(folder)
        self._path = self.folder / f"{self.folder.name}_0.mcap"
        self.custom = custom_data or {}
        self.written, self.failed = 0, ""
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, int] = {}
        self._end = 0
        self._open = True
        if self._path.exists():
            raise BagError(f"{self._path} exists already; choose another folder")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._writer = McapWriter(self._path, chunk_size, LIBRARY)
            self._write_metadata()
        except OSError as error:
            raise BagError(f"no bag can be written in {self.folder}: {error}") from None
        self._progress = Progress(self.folder)

    def add_topic(self, name: str, kind: str, text: str, hash_: str, qos: list[dict]) -> None:
        """Announce a topic.

        Args:
            name: Topic name with its leading slash.
            kind: Message type, ``package/msg/Type``.
            text: Message definition with everything it contains.
            hash_: RIHS01 hash of the type.
            qos: Offered profiles, as `qos_dict` makes them.
        """
        profiles = yaml.safe_dump(qos, sort_keys=False)
        about = {"offered_qos_profiles": profiles, "topic_type_hash": hash_}
        meta = {
            "name": name,
            "type": kind,
            "serialization_format": "cdr",
            "offered_qos_profiles": qos,
            "type_description_hash": hash_,
        }
        self._channels[name] = _Channel(len(self._channels) + 1, meta)
        with self._until_full():
            if kind not in self._schemas:
                self._schemas[kind] = self._writer.schema(kind, "ros2msg", text.encode())
            self._writer.channel(name, "cdr", self._schemas[kind], about)

    def add_row(self, name: str, row: Topic) -> None:
        """Announce a topic of the table under the name `name`."""
        qos = qos_dict(row.qos.reliable, row.qos.latched, row.qos.depth)
        self.add_topic(name, row.kind, definition(row.kind), type_hash(row.kind), [qos])

    def write(
        self, topic: str, data: bytes, t: int, sequence: int = 0, publish: int | None = None
    ) -> None:
        """Append a serialised message with its simulated time [ns]; it is the publish time too."""
        self.written += 1
        if self.failed:
            return
        self._end = max(self._end, t)
        self._progress.tell(self.written, self._end)
        try:
            sent = t if publish is None else publish
            self._writer.message(self._channels[topic].id, t, data, sent, sequence)
        except OSError as error:
            self._fail(error)

    def attach(self, name: str, data: bytes, media_type: str = "text/yaml") -> None:
        """Put a file (configuration, weights) inside the bag."""
        self._writer.attachment(self._end, name, media_type, data)

    def flush(self) -> None:
        """Close the chunk in progress and hand it to the system: what a crash cannot take."""
        with self._until_full():
            self._writer.flush()

    @contextlib.contextmanager
    def _until_full(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        if not self.failed:
            self.failed = f"{error.strerror or error} ({self._path})"
            self.custom["recording_stopped"] = self.failed

    def close(self) -> None:
        """Write index, statistics and the final ``metadata.yaml``.

        Raises:
            BagError: There is no room even for this; ``loco recover`` makes a bag of the file.
        """
        if not self._open:
            return
        self._open = False
        if not self.failed:
            self.flush()
        self._writer.metadata("rosbag2", self._serialized)
        self._writer.metadata(LIBRARY, lambda: self.custom)
        try:
            self._writer.finish(self._write_metadata, make_room=True)
        except OSError as error:
            raise BagError(
                f"{self._path} could not be closed: {error.strerror or error}; "
                f"`loco recover {self.folder}` makes a bag of what is there"
            ) from None
        self._progress.done()

    @property
    def kept(self) -> tuple[int, float]:
        """Messages in the file, and simulated time of the newest [s]."""
        return self._writer.messages, self._writer.span[1] / 1e9

    def _serialized(self) -> dict[str, str]:
        return {"serialized_metadata": yaml.safe_dump(self._information(), sort_keys=False)}

    def _write_metadata(self) -> None:
        content = {"rosbag2_bagfile_information": self._information()}
        write_whole(self.folder / "metadata.yaml", yaml.safe_dump(content, sort_keys=False))

    def _information(self) -> dict[str, Any]:
        start, end = self._writer.span
        counts = self._writer.counts()
        length = {"nanoseconds": end - start}
        begin = {"nanoseconds_since_epoch": start}
        return {
            "version": 9,
            "storage_identifier": "mcap",
            "duration": length,
            "starting_time": begin,
            "message_count": self._writer.messages,
            "topics_with_message_count": [
                {"topic_metadata": c.meta, "message_count": counts.get(c.id, 0)}
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
                    "message_count": self._writer.messages,
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
