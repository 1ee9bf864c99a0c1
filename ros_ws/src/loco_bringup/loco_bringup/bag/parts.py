# SPDX-License-Identifier: Apache-2.0
"""Read the files of a split bag (NAME_0.mcap, NAME_1.mcap, …) as one."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, TypedDict

import numpy as np
from mcap.records import Attachment, Channel, Schema, Statistics

from loco_control.checks import check_file
from loco_control.exceptions import BagError, LocoError, MissingFileError
from loco_control.reading import read_yaml, understood

from .coding import plain_name, without_twins
from .mcap_chunk import Records
from .mcap_file import McapFile, Summary

_NAME = re.compile(r"(.+)_(\d+)\.mcap(?:\.zstd|\.zst|\.lz4)?")
_OPEN = 8  # largest number of open files of one bag


class FileRow(TypedDict, total=False):
    """Entry of one file in ``metadata.yaml``."""

    path: str
    message_count: Any  # unreliable; the counts in the files are used


class Information(TypedDict, total=False):
    """Keys of ``metadata.yaml`` that loco reads."""

    relative_file_paths: list[str]
    files: list[FileRow]
    message_count: int
    starting_time: dict[str, int]
    duration: dict[str, int]
    custom_data: dict[str, Any] | None


class Metadata(TypedDict):
    """Contents of ``metadata.yaml``."""

    rosbag2_bagfile_information: Information


class McapFiles:
    """Several complete MCAP files that are read as one, in their order.

    Channels and schemas get new ids, since the ids of different files conflict.

    Args:
        paths: The files.

    Attributes:
        summary: Definitions and statistics of all files together.

    Raises:
        BagError: A file is truncated, damaged, or no MCAP file.
    """

    def __init__(self, paths: Sequence[Path]):
        self._count = len(paths)
        self._open = lru_cache(_OPEN)(lambda i: McapFile(paths[i], paths[i].parent))
        self._numbers: list[np.ndarray] = []  # per file: new channel id, indexed by the old one
        self._blocks: list[tuple[int, int]] = []  # per block: file and index in it
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        self._known: dict[tuple, int] = {}
        counts: Counter[int] = Counter()
        each = []
        for i, file in enumerate(self._files()):
            self._define(file.summary, counts)
            self._blocks += [(i, k) for k in range(file.block_count)]
            each.append(file.summary.statistics)
        self.summary = Summary(self._joined(each, counts), self._channels, self._schemas)

    def _files(self) -> Iterator[McapFile]:
        return map(self._open, range(self._count))

    def _define(self, old: Summary, counts: Counter[int]) -> None:
        """Add the definitions of one file, and count its messages under the new ids."""
        numbers = np.zeros(max(old.channels, default=0) + 2, np.int64)  # last: unknown channels
        for number, c in sorted(old.channels.items()):
            schema = old.schemas.get(c.schema_id)
            about = (schema.name, schema.encoding, schema.data) if schema else ()
            new = self._known.setdefault(
                (c.topic, c.message_encoding, *about), len(self._known) + 1
            )
            if new not in self._channels:
                kind = len(self._schemas) + 1 if schema else 0
                self._channels[new] = Channel(new, c.topic, c.message_encoding, c.metadata, kind)
                if schema:
                    self._schemas[kind] = Schema(kind, schema.data, schema.encoding, schema.name)
            numbers[number] = new
            counts[new] += old.statistics.channel_message_counts.get(number, 0)
        self._numbers.append(numbers)

    def _joined(self, each: list[Statistics], counts: Counter[int]) -> Statistics:
        timed = [s for s in each if s.message_count] or each
        return Statistics(
            attachment_count=sum(s.attachment_count for s in each),
            channel_count=len(self._channels),
            channel_message_counts=dict(counts),
            chunk_count=sum(s.chunk_count for s in each),
            message_count=sum(s.message_count for s in each),
            message_start_time=min(s.message_start_time for s in timed),
            message_end_time=max(s.message_end_time for s in timed),
            metadata_count=sum(s.metadata_count for s in each),
            schema_count=len(self._schemas),
        )

    def block(self, number: int) -> Records:
        """One block of `blocks`; see `McapFile.block`."""
        i, k = self._blocks[number]
        return self._renumbered(i, self._open(i).block(k))

    def blocks(self) -> Iterator[Records]:
        """All messages, one chunk at a time, file after file; see `McapFile.blocks`."""
        for i, file in enumerate(self._files()):
            for records in file.blocks():
                yield self._renumbered(i, records)

    def _renumbered(self, i: int, records: Records) -> Records:
        numbers = self._numbers[i]
        records.channels = numbers[np.minimum(records.channels, len(numbers) - 1)]
        return records

    def attachments(self) -> Iterator[Attachment]:
        """Attachments of all files; see `McapFile.attachments`."""
        for file in self._files():
            yield from file.attachments()

    def metadata(self, name: str) -> dict[str, str]:
        """Metadata with this name; if several files have the same key, the last file's value."""
        values: dict[str, str] = {}
        for file in self._files():
            values |= file.metadata(name)
        return values


@understood("bag")
def mcap_paths(path: Path) -> list[Path]:
    """The ``.mcap`` files of a bag folder in their order, or the file itself.

    Raises:
        MissingFileError: There is no such folder or file, it holds no bag or several, or a file of
            a bag is missing.
        BagError: ``metadata.yaml`` names a file outside its folder, or not all files of the folder.
    """
    if not path.is_dir():
        if not path.is_file():
            raise MissingFileError(f"no bag at {path}; `loco list bags` shows those that are there")
        return [path]
    files = numbered(path)
    stated = stated_counts(path)
    present = {file.name for file in files}
    names = None
    if stated is not None:  # a compressed file may have been decompressed by hand
        plain_names = {name: plain_name(name) for name in stated}
        names = [twin if twin in present else name for name, twin in plain_names.items()]
    if names is None:
        absent = missing(files)
        names = [file.name for file in files]
    else:
        outside = next((name for name in names if Path(name).name != name), None)
        if outside is not None:
            raise BagError(
                f"{path}/metadata.yaml names {outside!r:.80}, which is not in its folder; "
                f"`loco recover {path}` makes a bag of what is there"
            )
        absent = [name for name in names if name not in present]
    if absent:
        raise MissingFileError(
            f"{path} lacks {absent[0]!r:.80}; `loco recover {path}` makes a bag of the rest"
        )
    extra = present - set(names)
    if extra:
        raise BagError(
            f"{path}/metadata.yaml does not name {min(extra)}; `loco recover {path}` makes a bag "
            "of all files"
        )
    return [path / name for name in names]


def numbered(folder: Path) -> list[Path]:
    """The ``.mcap`` files of a bag folder in the order of the numbers in their names.

    Raises:
        MissingFileError: The folder holds no such file, or files of several bags.
    """
    files = without_twins(folder, ".mcap")
    if len(files) == 1:
        return files
    names = [_NAME.fullmatch(file.name) for file in files]
    parts = sorted((int(name[2]), file) for name, file in zip(names, files, strict=True) if name)
    if not files or len(parts) < len(files) or len({name[1] for name in names if name}) > 1:
        raise MissingFileError(
            f"{folder} holds {len(files)} .mcap files, expected those of one bag"
        )
    return [file for _, file in parts]


def missing(files: Sequence[Path]) -> list[str]:
    """Missing names in the series NAME_0.mcap, NAME_1.mcap, … up to its highest number."""
    names = [_NAME.fullmatch(file.name) for file in files]
    numbers = {int(name[2]): name[1] for name in names if name}
    if len(files) < 2 or len(numbers) < len(files):
        return []
    name = next(iter(numbers.values()))
    return [f"{name}_{i}.mcap" for i in range(min(max(numbers), 1 << 16)) if i not in numbers]


def stated_counts(folder: Path) -> dict[str, Any] | None:
    """Files named in ``metadata.yaml`` with their stated message counts (None if not stated).

    The result is None if ``metadata.yaml`` is missing or names no file.
    """
    try:
        stated = information(folder)
    except LocoError:
        return None
    counts: dict[str, Any] = dict.fromkeys(stated.get("relative_file_paths", ()))
    for row in stated.get("files", ()):
        if row.get("path") in counts:
            counts[row["path"]] = row.get("message_count")
    return counts or None


def information(folder: Path) -> Information:
    """Keys and values of the ``metadata.yaml`` of a bag.

    Raises:
        MissingFileError: The folder has no ``metadata.yaml``.
        ParameterError: The file is not YAML, or a key has a wrong value.
    """
    path = folder / "metadata.yaml"
    content = read_yaml(path)
    check_file(content, Metadata, path)
    return content["rosbag2_bagfile_information"]
