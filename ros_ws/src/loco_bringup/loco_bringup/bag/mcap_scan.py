# SPDX-License-Identifier: Apache-2.0
"""Iterate over the records of an MCAP file; after damage, find the next complete record.

The lengths inside a record must add up to its own length; this distinguishes a
record from bytes that resemble one by chance (https://mcap.dev/spec).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import NamedTuple, TypeVar

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import McapRecord

from loco_control.exceptions import BagError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode and length: header of every record
DAMAGE = 0  # opcode of a `Span` that is not a valid record

# Layout of records: fixed bytes (a number), text or block with its length in 4 bytes
# ("s"), and block with its length in 8 bytes ("b").
_SHAPES = {
    Opcode.HEADER: ("s", "s"),
    Opcode.FOOTER: (20,),
    Opcode.SCHEMA: (2, "s", "s", "s"),
    Opcode.CHANNEL: (4, "s", "s", "s"),
    Opcode.CHUNK: (28, "s", "b"),
    Opcode.MESSAGE_INDEX: (2, "s"),
    Opcode.CHUNK_INDEX: (32, "s", 8, "s", 16),
    Opcode.ATTACHMENT: (16, "s", "s", "b", 4),
    Opcode.ATTACHMENT_INDEX: (40, "s", "s"),
    Opcode.STATISTICS: (42, "s"),
    Opcode.METADATA: ("s", "s"),
    Opcode.METADATA_INDEX: (16, "s"),
    Opcode.SUMMARY_OFFSET: (17,),
    Opcode.DATA_END: (4,),
}
_MESSAGE_HEAD = 22
PRIVATE = 0x80  # opcodes from here on are for private use: skipped if a record follows
# A record shorter than 4 GiB: opcode, and a length whose upper half is zero.
_CANDIDATE = re.compile(rb"(?=[\x01-\x0f][\s\S]{4}\x00{4})")

R = TypeVar("R", bound=McapRecord)


class Span(NamedTuple):
    """A record in a file: its opcode and the bytes [start, stop) after its header.

    With the opcode `DAMAGE` it is a range of bytes that is not a complete record.
    """

    opcode: int
    start: int
    stop: int


def walk(data: bytes, start: int = len(MAGIC)) -> Iterator[Span]:
    """Pieces of a file, contiguous from `start` to the closing magic or the last byte."""
    at, end = start, len(data)
    if bytes(data[end - len(MAGIC) : end]) == MAGIC and end >= start + len(MAGIC):
        end -= len(MAGIC)
    while at < end:
        span = piece_at(data, at, end)
        if span is None:
            span = Span(DAMAGE, at, _next(data, at + 1, end))
        yield span
        at = span.stop


def piece_at(data: bytes, at: int, end: int) -> Span | None:
    """The complete record that begins at `at`; None if there is none."""
    if end - at < HEAD.size:
        return None
    opcode, length = HEAD.unpack_from(data, at)
    start, stop = at + HEAD.size, at + HEAD.size + length
    if stop > end:
        return None
    if opcode == Opcode.MESSAGE:
        return Span(opcode, start, stop) if length >= _MESSAGE_HEAD else None
    if opcode >= PRIVATE:
        following = data[stop] if stop < end else Opcode.DATA_END
        valid = following in _SHAPES or following == Opcode.MESSAGE or following >= PRIVATE
        return Span(opcode, start, stop) if valid else None
    shape = _SHAPES.get(opcode)
    if shape is None or not _adds_up(data, shape, start, stop):
        return None
    return Span(opcode, start, stop)


def _adds_up(data: bytes, shape: tuple, at: int, stop: int) -> bool:
    for part in shape:
        if part == "s" or part == "b":
            size = 4 if part == "s" else 8
            if at + size > stop:
                return False
            at += size + int.from_bytes(data[at : at + size], "little")
        else:
            at += part
        if at > stop:
            return False
    return at == stop


def _next(data: bytes, at: int, end: int) -> int:
    """Start of the next complete record, or `end`."""
    for candidate in _CANDIDATE.finditer(data, at, end):
        # A message has no inner lengths, so arbitrary bytes can look like a message.
        span = piece_at(data, candidate.start(), end)
        if span and span.opcode != Opcode.MESSAGE:
            return candidate.start()
    return end


def parsed(data: bytes, span: Span, kind: type[R]) -> R:
    """A record as an object of the mcap library.

    Raises:
        BagError: The bytes are not a valid record of this kind.
    """
    try:
        return kind.read(ReadDataStream(BytesIO(data[span.start : span.stop])))
    except Exception as error:  # with damaged bytes the library raises exceptions of many types
        raise BagError(f"{kind.__name__} at byte {span.start} is damaged: {error}") from None
