# SPDX-License-Identifier: Apache-2.0
"""Write a rosbag2 folder: one MCAP file, or several if split, and ``metadata.yaml`` version 9.

Log and publish times of messages are simulated time, as with ``ros2 bag record
--use-sim-time``, so replays and plots do not depend on the host's speed.
"""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import BagError, ParameterError
from loco_control.files import write_whole
from loco_control.ros.messages.definitions import definition, type_hash
from loco_control.ros.messages.topics import Topic

from .mcap_writer import McapWriter
from .progress import Progress

CHUNK_SIZE = 256 * 1024
LIBRARY = "loco"
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)  # C version: faster with many files


@dataclass(frozen=True)
class Limits:
    """Size and time of a file after which the next file of a bag begins.

    Args:
        size: Size without the index at the end of the file [bytes], at least 300,000; 0 for no
            limit.
        duration: Time from the first message of a file [s], at least 0.1; 0 for no limit.

    Raises:
        ParameterError: A limit is too small or not a number.
    """

    size: int = 0
    duration: float = 0.0

    def __post_init__(self) -> None:
        rows = ("size", self.size, 300_000, "bytes"), ("duration", self.duration, 0.1, "s")
        for what, value, minimum, unit in rows:
            if not (value == 0 or value >= minimum):
                raise ParameterError(
                    f"the longest {what} of a file of a bag must be 0 (no limit) or at least "
                    f"{minimum} {unit}, got {value}"
                )


@dataclass
class _Channel:
    id: int
    meta: dict[str, Any]
    about: dict[str, str]  # message definitions and topics


@dataclass(frozen=True)
class _Part:
    """One file of a bag: name, times of its first and last message [ns], message counts."""

    name: str
    span: tuple[int, int]
    messages: int
    counts: dict[int, int]  # messages by channel


class BagWriter:
    """One bag folder being written.

    A full disk ends the recording, not the program: the messages before stay in a complete
    bag, and `failed` gives the reason.

    Args:
        folder: New folder of the bag; its name is the name of the bag.
        custom_data: Texts for the bag's metadata (experiment, seed, versions).
        chunk_size: Size of messages after which a chunk is written [bytes].
        limits: Size and time after which the next file begins.

    Attributes:
        written: Number of messages passed to the writer so far.
        failed: Reason why the recording ended; empty while there was no error.

    Raises:
        BagError: The folder holds a bag already, or cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        custom_data: dict[str, str] | None = None,
        chunk_size: int = CHUNK_SIZE,
        limits: Limits | None = None,
    ):
        limits = limits or Limits()
        self.folder = Path(folder)
        self._chunk_size = chunk_size
        self._max_size, self._max_time = limits.size, limits.duration * 1e9  # [bytes], [ns]
        self._parts: list[_Part] = []  # closed files
        self._begun: int | None = None  # time of the first message of the open file [ns]
        self._path = self._part_path(0)
        self._has_last = True  # whether the open file is part of the bag
        self.custom = custom_data or {}
        self.written, self.failed = 0, ""
        self._channels: dict[str, _Channel] = {}
        self._schemas: dict[str, bytes] = {}  # definitions by message type
        self._end = 0
        self._open = True
        if self._path.exists():
            raise BagError(f"{self._path} exists already; choose another folder")
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            self._writer = self._begin(self._path)
            self._write_metadata()
        except OSError as error:
            raise BagError(f"no bag can be written in {self.folder}: {error}") from None
        self._progress = Progress(self.folder)

    def add_topic(self, name: str, kind: str, text: str, hash_: str, qos: list[dict]) -> None:
        """Register a topic.

        Args:
            name: Topic name with its leading slash.
            kind: Message type, ``package/msg/Type``.
            text: Message definition, including nested types.
            hash_: RIHS01 hash of the type.
            qos: Offered profiles, as returned by `qos_dict`.
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
        self._channels[name] = _Channel(len(self._channels) + 1, meta, about)
        with self._until_full():
            if kind not in self._schemas:
                self._schemas[kind] = text.encode()
                self._writer.schema(kind, "ros2msg", self._schemas[kind])
            self._writer.channel(name, "cdr", self._number(kind), about)

    def _number(self, kind: str) -> int:
        """Schema id of a message type, the same in every file."""
        return list(self._schemas).index(kind) + 1

    def _part_path(self, number: int) -> Path:
        return self.folder / f"{self.folder.name}_{number}.mcap"

    def _begin(self, path: Path) -> McapWriter:
        """Open a new file and register the types and topics of the bag.

        Raises:
            OSError: The disk is full; the file does not exist.
        """
        writer = None
        try:
            writer = McapWriter(path, self._chunk_size, LIBRARY)
            for kind, text in self._schemas.items():
                writer.schema(kind, "ros2msg", text)
            for name, channel in self._channels.items():
                writer.channel(name, "cdr", self._number(channel.meta["type"]), channel.about)
        except OSError:
            if writer is not None:
                writer.close()
            path.unlink(missing_ok=True)
            raise
        writer.metadata("rosbag2", lambda: {"serialized_metadata": _text(self._information())})
        writer.metadata(LIBRARY, lambda: self.custom)
        return writer

    def add_row(self, name: str, row: Topic) -> None:
        """Register a topic of the topic table under the name `name`."""
        qos = qos_dict(row.qos.reliable, row.qos.latched, row.qos.depth)
        self.add_topic(name, row.kind, definition(row.kind), type_hash(row.kind), [qos])

    def write(
        self, topic: str, data: bytes, t: int, sequence: int = 0, publish: int | None = None
    ) -> None:
        """Append a serialised message with its simulated time [ns], the default publish time."""
        self.written += 1
        full = 0 < self._max_size <= self._writer.size
        if self._begun is not None and (full or 0 < self._max_time <= t - self._begun):
            self.split()
        if self.failed:
            return
        self._begun = t if self._begun is None else min(t, self._begun)
        self._end = max(self._end, t)
        self._progress.tell(self.written, self._end)
        try:
            sent = t if publish is None else publish
            self._writer.message(self._channels[topic].id, t, data, sent, sequence)
        except OSError as error:
            self._fail(error)

    def split(self) -> None:
        """Close the file and begin the next one; does nothing if the file has no message yet.

        If the disk has no space for both, the recording ends with the file that was open.
        """
        if self.failed or self._begun is None:
            return
        before, path = self._writer, self._path
        with self._until_full():
            before.flush()
            self._path = self._part_path(len(self._parts) + 1)
            try:
                self._writer = self._begin(self._path)
                self._parts.append(_part(path, before))
                before.finish(self._write_metadata, sync=False)
            except OSError:
                if self._writer is not before:
                    self._writer.close()
                    self._path.unlink()
                self._parts = [part for part in self._parts if part.name != path.name]
                self._writer, self._path = before, path
                raise
            self._begun = None

    def attach(self, name: str, data: bytes, media_type: str = "text/yaml") -> None:
        """Store a file (configuration, weights) as an attachment of the bag."""
        self._writer.attachment(self._end, name, media_type, data)

    def flush(self) -> None:
        """Write the chunk in progress to the file, so that it survives a crash of the process."""
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
            BagError: The disk has no space for the index; use ``loco recover`` on the file.
        """
        if not self._open:
            return
        self._open = False
        if not self.failed:
            self.flush()
        try:
            self._writer.finish(self._write_metadata, make_room=True)
        except OSError as error:
            self._writer.close()
            self._fail(error)
            if not self._left_out():
                raise BagError(
                    f"{self._path} could not be closed: {error.strerror or error}; "
                    f"`loco recover {self.folder}` makes a bag of what is there"
                ) from None
        self._progress.done()

    def _left_out(self) -> bool:
        """Remove the last file if its end cannot be written; the others form a complete bag."""
        if not self._parts:
            return False
        self._has_last = False
        try:
            self._path.unlink()
            self._write_metadata()
        except OSError:
            return False
        return True

    @property
    def kept(self) -> tuple[int, float]:
        """Number of messages in the files, and simulated time of the newest [s]."""
        files = self._files()
        return sum(f.messages for f in files), max(f.span[1] for f in files) / 1e9

    def _files(self) -> list[_Part]:
        """All files; the open one is last."""
        return [*self._parts, *([_part(self._path, self._writer)] if self._has_last else [])]

    def _write_metadata(self) -> None:
        content = {"rosbag2_bagfile_information": self._information()}
        write_whole(self.folder / "metadata.yaml", _text(content))

    def _information(self) -> dict[str, Any]:
        files = self._files()
        spans = [f.span for f in files if f.messages] or [(0, 0)]
        start, end = min(s[0] for s in spans), max(s[1] for s in spans)
        counts = sum((Counter(f.counts) for f in files), Counter[int]())
        return {
            "version": 9,
            "storage_identifier": "mcap",
            "duration": {"nanoseconds": end - start},
            "starting_time": {"nanoseconds_since_epoch": start},
            "message_count": sum(f.messages for f in files),
            "topics_with_message_count": [
                {"topic_metadata": c.meta, "message_count": counts[c.id]}
                for c in self._channels.values()
            ],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [f.name for f in files],
            "files": [
                {
                    "path": f.name,
                    "starting_time": {"nanoseconds_since_epoch": f.span[0]},
                    "duration": {"nanoseconds": f.span[1] - f.span[0]},
                    "message_count": f.messages,
                }
                for f in files
            ],
            "custom_data": self.custom,
            "ros_distro": "jazzy",
        }


def _text(content: dict[str, Any]) -> str:
    return yaml.dump(content, Dumper=_DUMPER, sort_keys=False)


def _part(path: Path, writer: McapWriter) -> _Part:
    return _Part(path.name, writer.span, writer.messages, writer.counts())


def qos_dict(reliable: bool, latched: bool, depth: int) -> dict[str, Any]:
    """QoS profile in the notation of rosbag2's metadata version 9."""
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
