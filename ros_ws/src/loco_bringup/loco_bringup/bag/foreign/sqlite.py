# SPDX-License-Identifier: Apache-2.0
"""A rosbag2 bag in SQLite (``.db3``), the default of ROS 2 before Jazzy."""

from __future__ import annotations

import contextlib
import operator
import re
import sqlite3
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import quote

import numpy as np

from loco_control.exceptions import BagError, MissingFileError
from loco_control.reading import shown

from ..coding import decoded, is_packed, plain_name, unpacked, unpacker, without_twins
from ..reader import TopicInfo
from .raw import RawBag

SUFFIX = ".db3"
MAX_SIZE = 2**30  # largest size of all messages of a topic [bytes]
# Limit on the steps of SQLite's virtual machine per query; a row takes about ten steps.
_STEPS = 1_000_000  # allowed for any file
_STEPS_A_BYTE = 10
_TABLE = re.compile(r"CREATE TABLE \W?\w+\W?\s*\([^()]*\)", re.IGNORECASE)  # no computed columns
_READ = ("topics", "messages", "message_definitions")
_SAFE = """
PRAGMA query_only = ON; PRAGMA trusted_schema = OFF; PRAGMA ignore_check_constraints = ON;
PRAGMA cell_size_check = ON; PRAGMA mmap_size = 0;
"""


class SqliteBag(RawBag):
    """A bag given as its folder or as one ``.db3`` file, compressed or not.

    Raises:
        MissingFileError: There is no such file.
        BagError: A file is no rosbag2 database.
    """

    form = "SQLite"

    def __init__(self, path: str | Path):
        path = Path(path)
        files = without_twins(path, SUFFIX) if path.is_dir() else [path]
        if not files or not all(file.is_file() for file in files):
            raise MissingFileError(f"there is no {SUFFIX} file at {path}")
        super().__init__(files)
        self._files = files
        if any(map(is_packed, files)):
            self._unpacked = TemporaryDirectory(prefix="loco_")  # exists while the bag is in use
            self._files = [_unpacked(file, Path(self._unpacked.name)) for file in files]
        self._numbers: list[dict[str, set[int]]] = []  # topic ids by topic name, per file
        for file in self._files:
            with _opened(file) as database:
                self._define(file, database)

    def _define(self, file: Path, database: sqlite3.Connection) -> None:
        """Add the topics of a file, their message counts, and the type definitions."""
        counts = Counter(number for (number,) in database.execute("SELECT topic_id FROM messages"))
        numbers: dict[str, set[int]] = {}
        for number, name, kind, encoding in database.execute(
            "SELECT id, name, type, serialization_format FROM topics ORDER BY name"
        ):
            if encoding != "cdr":
                raise BagError(
                    f"{file.name}: {shown(name)} is encoded as {shown(encoding)}, wanted is cdr"
                )
            name = str(name)
            numbers.setdefault(name, set()).add(number)
            before = self.topics[name].count if name in self.topics else 0
            self.topics[name] = TopicInfo(name, str(kind), before + counts[number])
        self._numbers.append(numbers)
        first = database.execute("SELECT data FROM messages LIMIT 1").fetchone()
        if first and isinstance(first[0], bytes) and unpacker(first[0]):
            self.coding = "each message packed"
        if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'"
                            ).fetchone():  # fmt: skip
            self.definitions |= {
                str(kind): str(text)
                for kind, text in database.execute(
                    "SELECT topic_type, encoded_message_definition FROM message_definitions "
                    "WHERE encoding = 'ros2msg'"
                )
            }

    def raw(self, topic: str) -> tuple[np.ndarray, list[bytes]]:
        """Log times [ns], shape (n,), and serialised messages of one topic, sorted by time."""
        name, rows, total = self.resolve(topic), [], 0
        for file, numbers in zip(self._files, self._numbers, strict=True):
            topic_ids = numbers.get(name, set())
            with _opened(file) as database:
                for number, time, data in database.execute(
                    "SELECT topic_id, timestamp, data FROM messages"
                ):
                    if number not in topic_ids:
                        continue
                    if type(time) is not int or not isinstance(data, bytes):
                        raise BagError(f"{file.name}: {name} holds rows that are no messages")
                    rows.append((time, data))
                    total += len(data)
                    if total > MAX_SIZE:
                        raise BagError(f"{file.name}: {name} has more than {MAX_SIZE} bytes")
        rows.sort(key=operator.itemgetter(0))
        data = [data for _, data in rows]
        decode = unpacker(data[0]) if data else None
        return np.array([t for t, _ in rows], dtype=np.int64), decoded(data, decode, self.path.name)


def _unpacked(file: Path, folder: Path) -> Path:
    if not is_packed(file):
        return file
    path = folder / plain_name(file.name)
    path.write_bytes(unpacked(file))
    return path


@contextlib.contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """A database of plain tables, opened read-only; the work per query is bounded by its size.

    The page structure is checked first: no page is used twice, no value is longer than the file.

    Raises:
        BagError: The file is no database, is damaged, or has a computed table.
    """
    left = _STEPS + _STEPS_A_BYTE * file.stat().st_size

    def stop() -> bool:
        nonlocal left
        left -= 1000
        return left < 0

    try:
        uri = f"file:{quote(str(file.resolve()))}?mode=ro"
        with contextlib.closing(sqlite3.connect(uri, uri=True)) as database:
            database.set_progress_handler(stop, 1000)
            database.executescript(_SAFE)
            for (problem,) in database.execute("PRAGMA quick_check(1)"):
                if problem != "ok":
                    raise BagError(f"{file} is damaged: {shown(problem)}")
            for name, kind, root, text in database.execute(
                f"SELECT name, type, rootpage, sql FROM sqlite_master WHERE name IN {_READ}"
            ):
                if kind != "table" or not root or not _TABLE.fullmatch(" ".join(text.split())):
                    raise BagError(f"{file}: {name} is no plain table, as those of rosbag2 are")
            yield database
    except (sqlite3.Error, UnicodeDecodeError) as error:
        reason = "it takes too long" if left < 0 else shown(str(error))
        raise BagError(f"{file} is no rosbag2 database: {reason}") from None
