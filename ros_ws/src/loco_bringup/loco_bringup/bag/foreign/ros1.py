# SPDX-License-Identifier: Apache-2.0
"""Bags of ROS 1, read by the rosbags library."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import BagError, MissingFileError

from ..coding import converter, decoded, kind_of, library
from ..reader import TopicInfo
from .raw import RawBag

SUFFIX = ".bag"


class Ros1Bag(RawBag):
    """A bag of ROS 1, given as its folder or as one ``.bag`` file.

    Raises:
        MissingFileError: There is no such file.
        MissingPackageError: rosbags is not installed.
        BagError: A file is no bag of ROS 1.
    """

    form = "ROS 1"

    def __init__(self, path: str | Path):
        path = Path(path)
        files = sorted(path.glob(f"*{SUFFIX}")) if path.is_dir() else [path]
        if not files or not all(file.is_file() for file in files):
            raise MissingFileError(f"there is no {SUFFIX} file at {path}")
        super().__init__(files)
        self._converters: dict[str, Callable[[bytes], bytes]] = {}
        for file in files:
            with self._opened(file) as reader:
                for connection in reader.connections:
                    self._add(connection, file)

    def _opened(self, file: Path) -> Any:
        rosbag1 = library("rosbag1", str(file))
        try:
            reader = rosbag1.Reader(file)
            reader.open()
            reader.close()
        except Exception as error:  # noqa: BLE001  (the reader of a broken file raises anything)
            raise BagError(f"{file} is no readable bag of ROS 1: {error}") from None
        return rosbag1.Reader(file)

    def _add(self, connection: Any, file: Path) -> None:
        kind = kind_of(connection.msgtype)
        before = self.topics.get(connection.topic, TopicInfo(connection.topic, kind, 0))
        if before.type != kind:
            raise BagError(f"{file}: {connection.topic} has messages of {before.type} and {kind}")
        count = before.count + connection.msgcount
        self.topics[connection.topic] = TopicInfo(connection.topic, kind, count)
        if kind not in self._converters:
            text = getattr(connection.msgdef, "data", connection.msgdef)
            self._converters[kind], self.definitions[kind] = converter(kind, text, str(file))

    def raw(self, topic: str) -> tuple[np.ndarray, list[bytes]]:
        """Log times [ns], shape (n,), and messages of one topic as CDR, sorted by time."""
        name, times, data = self.resolve(topic), [], []
        convert = self._converters[self.topics[name].type]
        for file in self.paths:
            with self._opened(file) as reader:
                matches = [c for c in reader.connections if c.topic == name]
                for _, time, message in reader.messages(connections=matches) if matches else ():
                    times.append(time)
                    data.append(bytes(message))
        return np.array(times, dtype=np.int64), decoded(data, convert, self.path.name)
