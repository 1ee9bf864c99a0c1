# SPDX-License-Identifier: Apache-2.0
"""Read a recorded bag: topics as NumPy record arrays, attachments, metadata."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import BagError, NameUnknownError, ParameterError
from loco_control.reading import as_text, parse_json, parse_yaml
from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.plain import Message, deserialize, message_class

from .coding import ROS1, converter, decoded, kind_of, unpacker
from .mcap_chunk import Records, rows_at
from .mcap_file import McapFile, of_channels
from .parts import McapFiles, mcap_paths
from .writer import LIBRARY


@dataclass(frozen=True)
class TopicInfo:
    """One topic of a bag."""

    name: str
    type: str
    count: int


class Bag:
    """A recorded bag, given as its folder or as its ``.mcap`` file.

    Args:
        path: Folder that holds one ``*.mcap`` or those of a split bag, or one file.

    Attributes:
        paths: Files of the bag.
        path: The file, or the folder if there are several files.
        folder: Folder of the files.
        topics: Topics by name.
        channels: Channel ids of each topic.
        form: Format of the files as text, such as ``MCAP``.

    Raises:
        MissingFileError: There is no such folder or file, or one of several is missing.
        BagError: A file is no complete MCAP file, or ``metadata.yaml`` names other files.
    """

    form = "MCAP"

    def __init__(self, path: str | Path):
        self.paths = mcap_paths(Path(path))
        single = len(self.paths) == 1
        self.folder = self.paths[0].parent
        self.path = self.paths[0] if single else self.folder
        self.file = McapFile(self.path) if single else McapFiles(self.paths)
        self.summary = self.file.summary
        counts = self.summary.statistics.channel_message_counts
        self.channels: dict[str, list[int]] = {}
        self._kinds: dict[str, type[Message]] = {}
        self._decoders: dict[str, Callable[[bytes], bytes] | None] = {}
        self.topics: dict[str, TopicInfo] = {}
        for i, c in sorted(self.summary.channels.items()):
            self.channels.setdefault(c.topic, []).append(i)
            kind = self.summary.schemas[c.schema_id].name if c.schema_id else c.message_encoding
            count = sum(counts.get(k, 0) for k in self.channels[c.topic])
            kind = kind_of(kind) if c.message_encoding == ROS1 else kind
            self.topics[c.topic] = TopicInfo(c.topic, kind, count)

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
        """Metadata of the run: experiment, seed, versions, drops."""
        return self.file.metadata(LIBRARY)

    def attachment(self, name: str) -> bytes:
        """Content of a file inside the bag.

        Raises:
            NameUnknownError: The bag has no attachment of that name.
        """
        names = []
        for record in self.file.attachments():
            names.append(record.name)
            if record.name == name:
                return record.data
        raise NameUnknownError(f"attachment in {self.path.name}", name, names)

    @property
    def versions(self) -> dict[str, str]:
        """Versions of the packages that recorded the bag, by name; empty if not recorded."""
        try:
            values = parse_json(self.metadata.get("versions", "{}"), "versions")
        except ParameterError:
            return {}
        return {k: str(v) for k, v in values.items()} if isinstance(values, dict) else {}

    def yaml(self, name: str) -> Any:
        """Values of a YAML file inside the bag.

        Raises:
            NameUnknownError: The bag has no attachment of that name.
            ParameterError: The file is not YAML.
        """
        source = f"{name} in {self.path}"
        return parse_yaml(as_text(self.attachment(name), source), source)

    def attachments(self) -> dict[str, int]:
        """Names and sizes [bytes] of the files inside the bag."""
        return {record.name: len(record.data) for record in self.file.attachments()}

    def raw(self, topic: str) -> tuple[np.ndarray, list[bytes]]:
        """Log times [ns], shape (n,), and serialised messages of one topic, in order of arrival.

        Compressed messages and messages of ROS 1 are converted to CDR.
        """
        name = self.resolve(topic)
        times, data = [np.empty(0, np.int64)], []
        for records, rows in self._blocks(name):
            times.append(records.times[rows])
            starts, stops = records.starts[rows].tolist(), records.stops[rows].tolist()
            data += [records.data[a:b] for a, b in zip(starts, stops, strict=True)]
        return np.concatenate(times), decoded(data, self._decoder(name), self.path.name)

    def check(self) -> None:
        """Read the whole bag and verify every checksum.

        Raises:
            BagError: A chunk or an attachment is damaged.
        """
        for _ in self.file.blocks():
            pass
        list(self.file.attachments())

    def _decoder(self, name: str) -> Callable[[bytes], bytes] | None:
        """Function that converts the stored messages of a topic to CDR; None if they are CDR."""
        if name not in self._decoders:
            channel = self.summary.channels[self.channels[name][0]]
            first = next((r.data[r.starts[i[0]] : r.stops[i[0]]] for r, i in self._blocks(name)
                          if len(i)), b"")  # fmt: skip
            unpack = unpacker(first)
            if channel.message_encoding == ROS1:
                convert, _ = self._of_ros1(name)
                self._decoders[name] = convert if unpack is None else lambda d: convert(unpack(d))
            else:
                self._decoders[name] = unpack
        return self._decoders[name]

    @property
    def coding(self) -> str:
        """Description of the message coding; empty if the messages are plain CDR."""
        if ROS1 in {c.message_encoding for c in self.summary.channels.values()}:
            return "messages of ROS 1"
        filled = [name for name, topic in self.topics.items() if topic.count]
        return "each message packed" if any(map(self._decoder, filled)) else ""

    def _of_ros1(self, name: str) -> tuple[Callable[[bytes], bytes], str]:
        schema = self.summary.schemas[self.summary.channels[self.channels[name][0]].schema_id]
        return converter(schema.name, schema.data.decode("utf-8", "replace"), str(self.path))

    def times(self, topic: str) -> np.ndarray:
        """Log times [ns] of a topic, shape (n,), in order of arrival."""
        blocks = self._blocks(self.resolve(topic))
        return np.concatenate([np.empty(0, np.int64), *(r.times[i] for r, i in blocks)])

    def offered(self, topic: str) -> str:
        """YAML text of the QoS profiles that the writers of a topic offered."""
        channel = self.summary.channels[self.channels[self.resolve(topic)][0]]
        return channel.metadata.get("offered_qos_profiles", "[]")

    def _blocks(self, name: str) -> Iterator[tuple[Records, np.ndarray]]:
        """Chunks, and in each the indices of the messages of a topic."""
        for records in self.file.blocks():
            yield records, of_channels(records, self.channels[name])

    def records(self, topic: str) -> np.ndarray:
        """Messages of a topic of constant layout as records, shape (n,), fields by path.

        Raises:
            BagError: The topic is empty or its messages differ in layout.
        """
        return self.records_of([topic])[topic]

    def records_of(self, topics: Iterable[str]) -> dict[str, np.ndarray]:
        """Records of several topics by the requested names, in one pass over the file.

        Raises:
            BagError: A topic is empty or its messages differ in layout.
        """
        names = {topic: self.resolve(topic) for topic in topics}
        if any(self._decoder(name) for name in names.values()):
            return {topic: records_from(self, name) for topic, name in names.items()}
        columns = {name: _Columns(self, name) for name in names.values()}
        for records in self.file.blocks():
            for name, column in columns.items():
                column.add(records, of_channels(records, self.channels[name]))
        return {topic: columns[name].joined() for topic, name in names.items()}

    def messages(self, topic: str) -> list[Message]:
        """Messages of a topic as objects with the fields of its type, in log order.

        Raises:
            NameUnknownError: The bag has no such topic.
            BagError: A message does not match the type that the bag states.
        """
        name = self.resolve(topic)
        return [self.message(name, data) for data in self.raw(name)[1]]

    def message(self, name: str, data: bytes) -> Message:
        """Deserialised message of the topic that was recorded as `name`.

        Raises:
            BagError: The bytes do not match the type that the bag states.
        """
        try:
            return deserialize(data, self._kind(name))
        except ParameterError as error:
            raise BagError(f"{self.path}: a message on {name}: {error}") from None

    def _kind(self, name: str) -> type[Message]:
        """Class of the messages of a topic, built from the definition in the bag."""
        if name not in self._kinds:
            info, channel = self.topics[name], self.summary.channels[self.channels[name][0]]
            schema = self.summary.schemas.get(channel.schema_id)
            embedded = schema is not None and schema.encoding == "ros2msg"
            text = schema.data.decode("utf-8", "replace") if embedded else ""
            text = self._of_ros1(name)[1] if channel.message_encoding == ROS1 else text
            self._kinds[name] = message_class(info.type, text)
        return self._kinds[name]

    def resolve(self, topic: str) -> str:
        """Recorded name of a topic; leading slash and namespace may be left out.

        Raises:
            NameUnknownError: The bag has no such topic, or has it in several namespaces.
        """
        if topic in self.topics:
            return topic
        names = [name for name in self.topics if name.endswith("/" + topic.lstrip("/"))]
        if len(names) != 1:
            raise NameUnknownError(f"topic in {self.path.name}", topic, self.topics)
        return names[0]


def records_from(bag: Bag, name: str) -> np.ndarray:
    """Messages of a topic of constant layout as records, shape (n,), decoded one by one.

    Args:
        bag: The recording.
        name: Recorded name of the topic.

    Raises:
        BagError: The topic is empty or its messages differ in layout.
    """
    _, data = bag.raw(name)
    if not data:
        raise BagError(f"{bag.path.name} has no message on {name}")
    if len({len(message) for message in data}) > 1:
        raise BagError(f"{bag.path.name}: messages on {name} differ in layout")
    codec = Codec(bag.message(name, data[0]), len(data[0]))
    return np.frombuffer(b"".join(data), codec.dtype)


class _Columns:
    """Messages of one topic, all with the same layout, collected chunk by chunk."""

    def __init__(self, bag: Bag, name: str):
        self._bag, self._name = bag, name
        self._codec: Codec | None = None
        self._filled = 0

    def add(self, records: Records, rows: np.ndarray) -> None:
        """Copy the messages `rows` of a chunk."""
        if not len(rows):
            return
        starts = records.starts[rows]
        if self._codec is None:
            first = records.data[starts[0] : records.stops[rows[0]]]
            self._codec = Codec(self._bag.message(self._name, first), len(first))
            count = self._bag.topics[self._name].count
            self._data = np.empty((count, self._codec.dtype.itemsize), np.uint8)
        size = self._codec.dtype.itemsize
        wrong = np.flatnonzero(records.stops[rows] - starts != size)
        if len(wrong):
            other = int((records.stops[rows] - starts)[wrong[0]])
            raise BagError(
                f"{self._bag.path.name}: messages on {self._name} differ in layout: "
                f"{size} bytes, then {other}"
            )
        end = self._filled + len(rows)
        if end > len(self._data):
            raise BagError(
                f"{self._bag.path.name}: more messages on {self._name} than its summary says, "
                f"{len(self._data)}"
            )
        self._data[self._filled : end] = rows_at(records.bytes, starts, size)
        self._filled = end

    def joined(self) -> np.ndarray:
        """Records, shape (n,)."""
        if self._codec is None:
            raise BagError(f"{self._bag.path.name} has no message on {self._name}")
        return self._data[: self._filled].view(self._codec.dtype).reshape(-1)


def seconds(records: np.ndarray, path: str) -> np.ndarray:
    """Times of a stamp field of records [s], shape (n,).

    Args:
        records: Records of a topic, as `Bag.records` gives them.
        path: Name of the stamp, such as ``header.stamp``.
    """
    nanoseconds = records[f"{path}.sec"].astype(np.int64) * 1_000_000_000
    return (nanoseconds + records[f"{path}.nanosec"]) / 1e9
