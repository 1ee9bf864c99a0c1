# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 bag in SQLite (``.db3``), the default of ROS 2 before Jazzy, for `loco gap`."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from loco_control.exceptions import BagError, MissingFileError
from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.plain import Message, message_class

from ..bag.reader import Bag, TopicInfo

SUFFIX = ".db3"
MOST = 2**30  # bytes of all messages of a topic


class SqliteBag(Bag):
    """A bag given as its folder or as one ``.db3`` file; read as a `Bag` of MCAP is.

    Raises:
        MissingFileError: There is no such file.
        BagError: A file is no rosbag2 database, or is compressed.
    """

    def __init__(self, path: str | Path):
        path = Path(path)
        self._files = sorted(path.glob(f"*{SUFFIX}")) if path.is_dir() else [path]
        if not self._files or not all(file.is_file() for file in self._files):
            raise MissingFileError(f"there is no {SUFFIX} file at {path}")
        self.path, self.folder = self._files[0], self._files[0].parent
        self.topics: dict[str, TopicInfo] = {}
        self._kinds: dict[str, type[Message]] = {}
        self._definitions: dict[str, str] = {}
        for file in self._files:
            for name, kind, encoding, count in self._ask(
                file,
                "SELECT name, type, serialization_format, COUNT(m.id) FROM topics t "
                "LEFT JOIN messages m ON m.topic_id = t.id GROUP BY t.id ORDER BY name",
            ):
                if encoding != "cdr":
                    raise BagError(f"{file.name}: {name} is encoded as {encoding!r}, wanted is cdr")
                before = self.topics[name].count if name in self.topics else 0
                self.topics[str(name)] = TopicInfo(str(name), str(kind), before + int(count))
            if self._ask(file, "SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'"):
                self._definitions |= dict(
                    self._ask(
                        file,
                        "SELECT topic_type, encoded_message_definition FROM message_definitions "
                        "WHERE encoding = 'ros2msg'",
                    )
                )

    def _ask(self, file: Path, query: str, *values: Any) -> list[tuple]:
        """Rows of a query; the file is opened for reading only."""
        try:
            database = sqlite3.connect(f"file:{quote(str(file.resolve()))}?mode=ro", uri=True)
            try:
                return database.execute(query, values).fetchall()
            finally:
                database.close()
        except sqlite3.Error as error:
            raise BagError(f"{file} is no rosbag2 database: {error}") from None

    def attachments(self) -> dict[str, int]:
        """Files inside the bag: a database has none."""
        return {}

    def raw(self, topic: str) -> tuple[np.ndarray, list[bytes]]:
        """Log times [ns], shape (n,), and serialised messages of one topic, by time."""
        name, rows = self.resolve(topic), []
        for file in self._files:
            size = "SELECT SUM(LENGTH(data)) FROM messages m JOIN topics t ON m.topic_id = t.id "
            ((total,),) = self._ask(file, f"{size} WHERE t.name = ?", name)
            if (total or 0) > MOST:
                raise BagError(f"{file.name}: {name} has {total} bytes, more than {MOST}")
            rows += self._ask(
                file,
                "SELECT m.timestamp, m.data FROM messages m JOIN topics t ON m.topic_id = t.id "
                "WHERE t.name = ? ORDER BY m.timestamp, m.id",
                name,
            )
        if not all(type(t) is int and isinstance(data, bytes) for t, data in rows):
            raise BagError(f"{self.path.name}: {name} holds rows that are no messages")
        return np.array([t for t, _ in rows], dtype=np.int64), [data for _, data in rows]

    def records_of(self, topics: Any) -> dict[str, np.ndarray]:
        """Records of several topics of constant layout, by the names given."""
        return {topic: self._records(self.resolve(topic)) for topic in topics}

    def _records(self, name: str) -> np.ndarray:
        _, data = self.raw(name)
        if not data:
            raise BagError(f"{self.path.name} has no message on {name}")
        if len({len(message) for message in data}) > 1:
            raise BagError(f"{self.path.name}: messages on {name} differ in layout")
        codec = Codec(self.message(name, data[0]), len(data[0]))
        return np.frombuffer(b"".join(data), codec.dtype)

    def _kind(self, name: str) -> type[Message]:
        if name not in self._kinds:
            kind = self.topics[name].type
            self._kinds[name] = message_class(kind, self._definitions.get(kind, ""))
        return self._kinds[name]
