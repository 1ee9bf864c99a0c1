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
from .mcap_scan import DAMAGE, HEAD, PRIVATE, Span, parsed

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
    blocks: list[Span] = field(default_factory=list)  # undamaged chunks
    loose: list[Span] = field(default_factory=list)  # messages outside chunks
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

    def _take(self, span: Span) -> None:
        if span.opcode == DAMAGE:
            self.found.lost.append(self._damaged(span))
        elif span.opcode == Opcode.CHUNK:
            self._take_chunk(span)
        elif span.opcode >= PRIVATE:
            if count := self._counts.get(span.start):  # indices follow, so it was a chunk
                lost = Lost(span.start, span.stop, "no whole record", messages=count)
                self.found.lost.append(lost)
        elif span.opcode == Opcode.MESSAGE:
            self.found.loose.append(span)
        else:
            try:
                self._take_record(span)
            except BagError as error:
                self.found.lost.append(Lost(span.start, span.stop, str(error), content=False))

    def _take_chunk(self, span: Span) -> None:
        try:
            records = self.records(span)
            for kind, definitions in ((Channel, self.found.channels), (Schema, self.found.schemas)):
                for inner in records.pieces(_OPCODE[kind]):
                    record = parsed(records.data, inner, kind)
                    definitions.setdefault(record.id, record)
        except BagError as error:
            head, count = chunk_head(self.data, span), self._counts.get(span.start)
            times = _plausible_times(head.first, head.last)
            reason = str(error).partition("is damaged: ")[2] or str(error)
            self.found.lost.append(Lost(span.start, span.stop, reason, times, count))
        else:
            self.found.blocks.append(span)
            if late := int((records.times < 0).sum()):
                reason = "messages with a stamp of 2^63 ns or more"
                self.found.lost.append(Lost(span.start, span.stop, reason, messages=late))

    def _take_record(self, span: Span) -> None:
        for kind, opcode in _OPCODE.items():
            if span.opcode == opcode:
                record = parsed(self.data, span, kind)
                self._seen[kind][record.id] = record
        if span.opcode == Opcode.STATISTICS:
            self.found.statistics = parsed(self.data, span, Statistics)
        elif span.opcode == Opcode.METADATA:
            record = parsed(self.data, span, Metadata)
            self.found.metadata[record.name] = record.metadata
        elif span.opcode == Opcode.ATTACHMENT:
            record = parsed(self.data, span, Attachment)
            if not attachment_whole(self.data, span):
                raise BagError(f"the file {record.name} inside is damaged")
            self.found.attachments.append(record)
        elif span.opcode == Opcode.FOOTER and not summary_whole(self.data, span):
            self.found.statistics = None  # nothing in the summary is reliable
            raise BagError("the check sum of the summary is wrong")

    def _damaged(self, span: Span) -> Lost:
        """A range that is no record: possibly a truncated chunk, or one with a damaged header."""
        cut = span.stop == len(self.data)
        reason = "cut off here" if cut else "no whole record"
        times = None
        chunk = self.data[span.start] == Opcode.CHUNK
        if chunk and span.stop - span.start > _CHUNK_HEAD:
            head = Span(Opcode.CHUNK, span.start + HEAD.size, span.stop)
            times = _plausible_times(*chunk_head(self.data, head)[:2])
        count = self._counts.get(span.start + HEAD.size)
        return Lost(span.start, span.stop, reason, times, count, content=chunk or bool(count))


_OPCODE = {Channel: Opcode.CHANNEL, Schema: Opcode.SCHEMA}


def _plausible_times(first: int, last: int) -> tuple[int, int] | None:
    """Times of a damaged chunk [ns]; None if they are implausible."""
    return (first, last) if first <= last < first + int(1e15) else None
