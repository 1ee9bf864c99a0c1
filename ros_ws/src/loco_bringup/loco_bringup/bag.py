# SPDX-License-Identifier: Apache-2.0
"""Reads a recorded bag: topics as NumPy record arrays, attachments, metadata."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader

from loco_control.exceptions import BagError, MissingFileError, NameUnknownError
from loco_control.ros.codec import Codec

from .bag_writer import LIBRARY


@dataclass(frozen=True)
class TopicInfo:
    """One topic of a bag."""

    name: str
    type: str
    count: int


class Bag:
    """A recorded bag, given as its folder or as its ``.mcap`` file.

    Args:
        path: Folder that holds one ``*.mcap``, or the file itself.

    Raises:
        MissingFileError: There is no such folder or file.
        BagError: The file is not a complete MCAP file.
    """

    def __init__(self, path: str | Path):
        self.path = _mcap_file(Path(path))
        self.folder = self.path.parent
        try:
            with self._open() as reader:
                summary = reader.get_summary()
        except (McapError, EOFError, OSError, ValueError) as error:
            raise BagError(
                f"{self.path} is not a readable MCAP file: {error or 'cut short'}"
            ) from None
        if summary is None or summary.statistics is None:
            raise BagError(f"{self.path} has no summary: the recording was cut short")
        self.summary = summary
        counts = summary.statistics.channel_message_counts
        self.topics = {
            c.topic: TopicInfo(c.topic, summary.schemas[c.schema_id].name, counts.get(i, 0))
            for i, c in sorted(summary.channels.items())
        }

    @property
    def start(self) -> float:
        """Simulated time of the first message [s]."""
        return self.summary.statistics.message_start_time / 1e9

    @property
    def end(self) -> float:
        """Simulated time of the last message [s]."""
        return self.summary.statistics.message_end_time / 1e9

    @cached_property
    def metadata(self) -> dict[str, str]:
        """What the run said of itself: experiment, seed, versions, drops."""
        with self._open() as reader:
            for record in reader.iter_metadata():
                if record.name == LIBRARY:
                    return dict(record.metadata)
        return {}

    def attachment(self, name: str) -> bytes:
        """Content of a file inside the bag.

        Raises:
            NameUnknownError: The bag has no attachment of that name.
        """
        names = []
        with self._open() as reader:
            for record in reader.iter_attachments():
                names.append(record.name)
                if record.name == name:
                    return record.data
        raise NameUnknownError(f"attachment in {self.path.name}", name, names)

    def attachments(self) -> dict[str, int]:
        """Names and sizes [bytes] of the files inside the bag."""
        with self._open() as reader:
            return {record.name: len(record.data) for record in reader.iter_attachments()}

    def raw(self, topic: str) -> tuple[np.ndarray, list[bytes]]:
        """Log times [ns], shape (n,), and serialised messages of one topic, as they arrived."""
        name = self.resolve(topic)
        return self._read([name])[name]

    def records(self, topic: str) -> np.ndarray:
        """Messages of a topic of constant layout as records, shape (n,), fields by path.

        Raises:
            BagError: The topic is empty or its messages differ in layout.
        """
        return self.records_of([topic])[topic]

    def records_of(self, topics: Iterable[str]) -> dict[str, np.ndarray]:
        """Records of several topics, by the names given, in one pass over the file."""
        from rclpy.serialization import deserialize_message

        names = {topic: self.resolve(topic) for topic in topics}
        read, records = self._read(list(names.values())), {}
        for topic, name in names.items():
            _, data = read[name]
            if not data:
                raise BagError(f"{self.path.name} has no message on {name}")
            codec = Codec(deserialize_message(data[0], message_class(self.topics[name].type)))
            records[topic] = codec.decode_many(data)
        return records

    def _read(self, names: list[str]) -> dict[str, tuple[np.ndarray, list[bytes]]]:
        times: dict[str, list[int]] = {name: [] for name in names}
        data: dict[str, list[bytes]] = {name: [] for name in names}
        try:
            with self._open() as reader:
                for _, channel, message in reader.iter_messages(names, log_time_order=False):
                    times[channel.topic].append(message.log_time)
                    data[channel.topic].append(message.data)
        except (McapError, EOFError, ValueError) as error:
            raise BagError(
                f"{self.path}: cannot be read to its end: {error or 'cut short'}"
            ) from None
        return {name: (np.array(times[name], dtype=np.int64), data[name]) for name in names}

    def messages(self, topic: str) -> list[Any]:
        """Messages of a topic as ROS objects, in log order."""
        from rclpy.serialization import deserialize_message

        name = self.resolve(topic)
        kind = message_class(self.topics[name].type)
        return [deserialize_message(d, kind) for d in self.raw(name)[1]]

    def resolve(self, topic: str) -> str:
        """Recorded name of a topic; leading slash and namespace may be left out.

        Raises:
            NameUnknownError: The bag has no such topic, or several namespaces have it.
        """
        if topic in self.topics:
            return topic
        found = [name for name in self.topics if name.endswith("/" + topic.lstrip("/"))]
        if len(found) != 1:
            raise NameUnknownError(f"topic in {self.path.name}", topic, self.topics)
        return found[0]

    def _open(self) -> _Reader:
        return _Reader(self.path)


class _Reader:
    """Context manager: an mcap reader over an open file."""

    def __init__(self, path: Path):
        self._path = path

    def __enter__(self) -> McapReader:
        self._file = open(self._path, "rb")  # noqa: SIM115 (closed in __exit__)
        return make_reader(self._file)

    def __exit__(self, *_: object) -> None:
        self._file.close()


def message_class(name: str) -> type:
    """Message class of ``package/msg/Type``.

    Raises:
        NameUnknownError: The package is not installed or has no such message.
    """
    import importlib

    if not re.fullmatch(r"\w+/msg/\w+", name):
        raise NameUnknownError("message type", name, [])
    package, _, short = name.split("/")
    try:
        module = importlib.import_module(f"{package}.msg")
        return getattr(module, short)
    except (ImportError, AttributeError):
        raise NameUnknownError("installed message type", name, []) from None


def _mcap_file(path: Path) -> Path:
    if path.is_dir():
        files = sorted(path.glob("*.mcap"))
        if len(files) != 1:
            raise MissingFileError(f"{path} holds {len(files)} .mcap files, expected one bag")
        return files[0]
    if not path.is_file():
        raise MissingFileError(f"no bag at {path}; `loco list bags` shows those that are there")
    return path
