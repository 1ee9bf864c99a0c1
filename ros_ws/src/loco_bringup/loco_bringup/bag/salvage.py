# SPDX-License-Identifier: Apache-2.0
"""Undamaged parts of an MCAP file, and an estimate of what the damaged parts held."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema, Statistics

from loco_control.exceptions import BagError

from .mcap_chunk import chunk_head
from .mcap_file import Mcap, attachment_whole, summary_whole
from .mcap_scan import DAMAGE, HEAD, PRIVATE, Piece, parsed

_CHUNK_HEAD = HEAD.size + 28  # bytes of a truncated chunk that contain its times


@dataclass
class Lost:
    """A range of bytes of a file that cannot be read."""

    start: int
    stop: int
    why: str
    times: tuple[int, int] | None = None  # first and last message [ns], if known
    messages: int | None = None
    content: bool = True  # whether messages or attachments are lost, not only an index

    def __str__(self) -> str:
        count = f", {self.messages} messages" if self.messages is not None else ""
        span = f", {self.times[0] / 1e9:.3f} to {self.times[1] / 1e9:.3f} s" if self.times else ""
        return f"bytes {self.start} to {self.stop}{span}{count}: {self.why}"


@dataclass
class Salvage:
    """Undamaged parts of a file, in file order."""

    size: int
    blocks: list[Piece] = field(default_factory=list)  # undamaged chunks
    loose: list[Piece] = field(default_factory=list)  # messages outside chunks
    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    attachments: list[Attachment] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    statistics: Statistics | None = None
    lost: list[Lost] = field(default_factory=list)


class Salvager(Mcap):
    """Search of a file for undamaged parts, in one pass.

    Args:
        path: The ``.mcap`` file.

    Attributes:
        found: Undamaged parts of the file.
    """

    def __init__(self, path: Path):
        super().__init__(path)
        self.found = Salvage(len(self.data))
        self._seen: dict[type, dict[int, Any]] = {Channel: {}, Schema: {}}
        self._counts: Counter[int] = Counter()  # messages by chunk, from the indices after it
        self._last_chunk = -1
        self._index()
        for span in self.pieces:
            self._take(span)
        # A definition with a checksum (in a chunk) is preferred to one without.
        for kind, records in ((Channel, self.found.channels), (Schema, self.found.schemas)):
            for number, record in self._seen[kind].items():
                records.setdefault(number, record)

    def _index(self) -> None:
        """Count messages by chunk, so that the number in a damaged chunk is known."""
        for span in self.pieces:
            if span.opcode == Opcode.CHUNK:
                self._last_chunk = span.start
            elif span.opcode == DAMAGE:
                self._last_chunk = span.start + HEAD.size
            elif span.opcode >= PRIVATE:
                self._last_chunk = span.start
            elif span.opcode == Opcode.MESSAGE_INDEX:
                self._counts[self._last_chunk] += (span.stop - span.start - 6) // 16

    def _take(self, piece: Piece) -> None:
        if piece.opcode == DAMAGE:
            self.found.lost.append(self._damaged(piece))
        elif piece.opcode == Opcode.CHUNK:
            self._take_chunk(piece)
        elif piece.opcode >= PRIVATE:
            if count := self._counts.get(piece.start):  # indices follow, so it was a chunk
                lost = Lost(piece.start, piece.stop, "no whole record", messages=count)
                self.found.lost.append(lost)
        elif piece.opcode == Opcode.MESSAGE:
            self.found.loose.append(piece)
        else:
            try:
                self._take_record(piece)
            except BagError as error:
                self.found.lost.append(Lost(piece.start, piece.stop, str(error), content=False))

    def _take_chunk(self, piece: Piece) -> None:
        try:
            records = self.records(piece)
            for kind, definitions in ((Channel, self.found.channels), (Schema, self.found.schemas)):
                for inner in records.pieces(_OPCODE[kind]):
                    record = parsed(records.data, inner, kind)
                    definitions.setdefault(record.id, record)
        except BagError as error:
            head, count = chunk_head(self.data, piece), self._counts.get(piece.start)
            times = _believed(head.first, head.last)
            reason = str(error).partition("is damaged: ")[2] or str(error)
            self.found.lost.append(Lost(piece.start, piece.stop, reason, times, count))
        else:
            self.found.blocks.append(piece)
            if late := int((records.times < 0).sum()):
                reason = "messages with a stamp of 2^63 ns or more"
                self.found.lost.append(Lost(piece.start, piece.stop, reason, messages=late))

    def _take_record(self, piece: Piece) -> None:
        for kind, opcode in _OPCODE.items():
            if piece.opcode == opcode:
                record = parsed(self.data, piece, kind)
                self._seen[kind][record.id] = record
        if piece.opcode == Opcode.STATISTICS:
            self.found.statistics = parsed(self.data, piece, Statistics)
        elif piece.opcode == Opcode.METADATA:
            record = parsed(self.data, piece, Metadata)
            self.found.metadata[record.name] = record.metadata
        elif piece.opcode == Opcode.ATTACHMENT:
            record = parsed(self.data, piece, Attachment)
            if not attachment_whole(self.data, piece):
                raise BagError(f"the file {record.name} inside is damaged")
            self.found.attachments.append(record)
        elif piece.opcode == Opcode.FOOTER and not summary_whole(self.data, piece):
            self.found.statistics = None  # nothing in the summary is reliable
            raise BagError("the check sum of the summary is wrong")

    def _damaged(self, piece: Piece) -> Lost:
        """A range that is no record: possibly a truncated chunk, or one with a damaged header."""
        cut = piece.stop == len(self.data)
        reason = "cut off here" if cut else "no whole record"
        times = None
        chunk = self.data[piece.start] == Opcode.CHUNK
        if chunk and piece.stop - piece.start > _CHUNK_HEAD:
            head = Piece(Opcode.CHUNK, piece.start + HEAD.size, piece.stop)
            times = _believed(*chunk_head(self.data, head)[:2])
        count = self._counts.get(piece.start + HEAD.size)
        return Lost(piece.start, piece.stop, reason, times, count, content=chunk or bool(count))


_OPCODE = {Channel: Opcode.CHANNEL, Schema: Opcode.SCHEMA}


def _believed(first: int, last: int) -> tuple[int, int] | None:
    """Times of a damaged chunk [ns]; None if they are implausible."""
    return (first, last) if first <= last < first + int(1e15) else None
