# SPDX-License-Identifier: Apache-2.0
"""Reader of an MCAP file: definitions, statistics, chunks, attachments and messages."""

from __future__ import annotations

import mmap
import zlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Footer, Metadata, Schema, Statistics

from loco_control.exceptions import BagError

from .coding import is_packed, unpacked
from .mcap_chunk import Records, unpack
from .mcap_scan import DAMAGE, HEAD, MAGIC, Span, parsed, walk

_FOREVER = 1 << 63  # [ns], later than any ROS time


@dataclass
class Summary:
    """The definitions and statistics at the end of a file."""

    statistics: Statistics
    channels: dict[int, Channel]
    schemas: dict[int, Schema]


class Mcap:
    """Bytes of an MCAP file, complete or damaged, and its records.

    Args:
        path: The file.

    Attributes:
        data: Bytes of the file, memory-mapped: read on access.
    """

    def __init__(self, path: Path):
        if is_packed(path):
            self.data = unpacked(path)
            return
        with open(path, "rb") as stream:
            full = path.stat().st_size > 0
            self.data = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) if full else b""

    @cached_property
    def pieces(self) -> list[Span]:
        """Records of the file in file order, and the damaged parts between them."""
        return list(walk(self.data)) if len(self.data) > len(MAGIC) else []

    def kind(self, opcode: int) -> list[Span]:
        """Records with this opcode."""
        return [p for p in self.pieces if p.opcode == opcode]

    def records(self, chunk: Span) -> Records:
        """Messages of one chunk.

        Raises:
            BagError: The chunk is damaged.
        """
        return Records(unpack(self.data, chunk))

    def loose(self) -> Records:
        """Messages outside chunks."""
        messages = self.kind(Opcode.MESSAGE)
        return Records(b"".join(self.data[p.start - HEAD.size : p.stop] for p in messages))


class McapFile(Mcap):
    """A complete MCAP file; each checksum is verified when its bytes are read.

    Args:
        path: The file.
        bag: Bag that contains the file, named in error messages with the command that recovers
            it; default the file itself.

    Raises:
        BagError: The file is truncated, damaged, or no MCAP file.
    """

    def __init__(self, path: Path, bag: Path | None = None):
        super().__init__(path)
        self.path, self._bag = path, bag or path
        if bytes(self.data[: len(MAGIC)]) != MAGIC:
            raise self._error("it does not begin as MCAP files do")
        if len(self.data) < 2 * len(MAGIC) or bytes(self.data[-len(MAGIC) :]) != MAGIC:
            raise self._error("cut short")
        for damage in self.kind(DAMAGE):
            raise self._error(f"bytes {damage.start} to {damage.stop} are damaged")
        try:
            self.summary = self._summary()
        except BagError as error:
            raise self._error(str(error)) from None

    def _error(self, reason: str) -> BagError:
        return BagError(
            f"{self.path} is not a readable MCAP file: {reason}; "
            f"`loco recover {self._bag}` restores what is whole"
        )

    def _summary(self) -> Summary:
        footers = self.kind(Opcode.FOOTER)
        if len(footers) != 1:
            raise BagError("it has no footer")
        footer = parsed(self.data, footers[0], Footer)
        if not summary_whole(self.data, footers[0]):
            raise BagError("the check sum of its summary is wrong")
        last = [p for p in self.pieces if p.start > footer.summary_start > 0]
        statistics = [p for p in last if p.opcode == Opcode.STATISTICS]
        if not statistics:
            raise BagError("it has no summary")
        channels = [parsed(self.data, p, Channel) for p in last if p.opcode == Opcode.CHANNEL]
        schemas = [parsed(self.data, p, Schema) for p in last if p.opcode == Opcode.SCHEMA]
        summary = Summary(
            parsed(self.data, statistics[0], Statistics),
            {c.id: c for c in channels},
            {s.id: s for s in schemas},
        )
        count, actual = summary.statistics.chunk_count, len(self.chunks)
        if count != actual:
            raise BagError(f"{actual} chunks of {count} are there")
        if summary.statistics.message_end_time >= _FOREVER:
            raise BagError("its messages have stamps of 2^63 ns or more")
        missing = {c.schema_id for c in channels} - set(summary.schemas) - {0}
        if missing:
            raise BagError(f"schema {min(missing)} is missing")
        return summary

    def attachments(self) -> Iterator[Attachment]:
        """Attachments of the file.

        Raises:
            BagError: An attachment is damaged.
        """
        for span in self.kind(Opcode.ATTACHMENT):
            if not attachment_whole(self.data, span):
                raise self._error(f"the attachment at byte {span.start} is damaged")
            yield parsed(self.data, span, Attachment)

    def metadata(self, name: str) -> dict[str, str]:
        """Metadata record with this name; empty if there is none."""
        for span in self.kind(Opcode.METADATA):
            record = parsed(self.data, span, Metadata)
            if record.name == name:
                return dict(record.metadata)
        return {}

    @property
    def chunks(self) -> list[Span]:
        """Places of the chunks."""
        return self.kind(Opcode.CHUNK)

    @property
    def block_count(self) -> int:
        """Number of blocks that `blocks` yields."""
        return len(self.chunks) or int(bool(self.kind(Opcode.MESSAGE)))

    def block(self, number: int) -> Records:
        """One block of `blocks`: a chunk, or all messages of a file without chunks.

        Raises:
            BagError: The chunk is damaged.
        """
        chunks = self.chunks
        return self._dated(self.records(chunks[number]) if chunks else self.loose())

    def blocks(self) -> Iterator[Records]:
        """All messages, one chunk at a time, in file order.

        A second thread decompresses the next chunk in the meantime.

        Raises:
            BagError: A chunk is damaged.
        """
        chunks = self.chunks
        if not chunks and self.kind(Opcode.MESSAGE):
            yield self._dated(self.loose())
        with ThreadPoolExecutor(1) as pool:
            ahead = [pool.submit(unpack, self.data, chunk) for chunk in chunks[:1]]
            for i in range(len(chunks)):
                ahead += [pool.submit(unpack, self.data, c) for c in chunks[i + 1 : i + 2]]
                try:
                    records = Records(ahead.pop(0).result())
                except BagError as error:
                    raise self._error(str(error)) from None
                yield self._dated(records)

    def _dated(self, records: Records) -> Records:
        if (records.times < 0).any():
            raise self._error("a message has a stamp of 2^63 ns or more")
        return records


def attachment_whole(data: bytes, span: Span) -> bool:
    """Whether the checksum of an attachment is correct or absent."""
    check = int.from_bytes(data[span.stop - 4 : span.stop], "little")
    return check in (0, zlib.crc32(data[span.start : span.stop - 4]))


def summary_whole(data: bytes, footer: Span) -> bool:
    """Whether the checksum of summary and footer is correct or absent."""
    record = parsed(data, footer, Footer)
    start = record.summary_start or footer.start - HEAD.size
    check = record.summary_crc
    return start < footer.stop and check in (0, zlib.crc32(data[start : footer.stop - 4]))


def of_channels(records: Records, channels: list[int]) -> np.ndarray:
    """Indices of the messages of the given channels."""
    mask = records.channels == channels[0]
    for channel in channels[1:]:
        mask |= records.channels == channel
    return np.flatnonzero(mask)
