# SPDX-License-Identifier: Apache-2.0
"""Decompression and check of MCAP chunks, and a compiled search for their messages."""

from __future__ import annotations

import struct
import zlib
from functools import cached_property
from typing import NamedTuple

import lz4.frame
import numpy as np
import zstandard
from numba import njit

from loco_control.exceptions import BagError
from loco_control.packed import check_room

from .mcap_scan import Span

_HEAD = struct.Struct("<QQQI")  # start and end time [ns], unpacked size, CRC
MESSAGE = np.dtype([("channel", "<u2"), ("sequence", "<u4"), ("time", "<i8"), ("publish", "<i8")])


class ChunkHead(NamedTuple):
    """Header of a chunk: times [ns], decompressed size, and place of its compressed bytes."""

    first: int
    last: int
    size: int
    crc: int
    compression: str
    start: int
    stop: int


def chunk_head(data: bytes, span: Span) -> ChunkHead:
    """Header of a chunk; `span` may be truncated after the header."""
    first, last, size, crc = _HEAD.unpack_from(data, span.start)
    at = span.start + _HEAD.size
    length = int.from_bytes(data[at : at + 4], "little")
    name = bytes(data[at + 4 : at + 4 + length]).decode("ascii", "replace")
    return ChunkHead(first, last, size, crc, name, at + 12 + length, span.stop)


def unpack(data: bytes, span: Span) -> bytes:
    """Decompressed records of a chunk.

    Raises:
        BagError: The chunk is damaged, or its compression is not supported.
    """
    head = chunk_head(data, span)
    packed = data[head.start : head.stop]
    try:
        records = _unpacked(head, packed)
    except BagError:
        raise
    except Exception as error:  # each compression library has its own exceptions
        raise BagError(f"chunk at byte {span.start} is damaged: {error}") from None
    if len(records) != head.size:
        raise BagError(f"chunk at byte {span.start} is damaged: its length is wrong")
    if head.crc and zlib.crc32(records) != head.crc:
        raise BagError(f"chunk at byte {span.start} is damaged: its check sum is wrong")
    return records


def _unpacked(head: ChunkHead, packed: bytes) -> bytes:
    if head.compression == "":
        return bytes(packed)
    check_room(head.size, len(packed))
    if head.compression == "lz4":
        if lz4.frame.get_frame_info(packed)["content_size"] not in (0, head.size):
            raise BagError("its length is wrong")
        return lz4.frame.decompress(packed)
    if head.compression == "zstd":
        size = zstandard.get_frame_parameters(packed).content_size
        if size not in (head.size, zstandard.CONTENTSIZE_UNKNOWN):
            raise BagError("its length is wrong")
        return zstandard.ZstdDecompressor().decompress(packed, max_output_size=head.size)
    raise BagError(f"chunks packed with {head.compression!r} cannot be read: only zstd, lz4, none")


class Records:
    """Records of one decompressed chunk.

    Args:
        data: Bytes of the decompressed chunk.

    Attributes:
        starts: Index of the first byte of each message, after its header.
        stops: Index after the last byte of each message.
        channels: Channel id of each message.
        times: Log time of each message [ns].

    Raises:
        BagError: The lengths of the records do not add up to the length of the chunk.
    """

    def __init__(self, data: bytes):
        self.data = data
        self.bytes = np.frombuffer(data, np.uint8)
        ok, other_records, messages = _find(self.bytes)
        if not ok:
            raise BagError("records in a chunk do not add up")
        self._others = other_records
        self.starts, self.stops, self.channels, self.times = np.ascontiguousarray(messages.T)

    def pieces(self, opcode: int) -> list[Span]:
        """Records with this opcode."""
        return [Span(*row) for row in self._others.tolist() if row[0] == opcode]

    @cached_property
    def heads(self) -> np.ndarray:
        """Channel, sequence number and times of each message, dtype `MESSAGE`."""
        rows = rows_at(self.bytes, self.starts - MESSAGE.itemsize, MESSAGE.itemsize)
        return rows.view(MESSAGE).reshape(-1)


@njit(cache=True)
def _number(data, at, size):
    value = np.int64(0)
    for k in range(size - 1, -1, -1):
        value = (value << 8) | data[at + k]
    return value


@njit(cache=True)
def _find(data):
    """Messages (first byte, end, channel, time) and other records (opcode, first byte, end)."""
    size, at, many, n_others = len(data), 0, 0, 0
    ok = True
    while at < size:
        length = _number(data, at + 1, 8) if size - at >= 9 else np.int64(-1)
        message = data[at] == 5
        if length < 0 or length > size - at - 9 or (message and length < 22):
            ok = False
            break
        at += 9 + length
        many += message
        n_others += not message
    messages, other_records = np.empty((many, 4), np.int64), np.empty((n_others, 3), np.int64)
    at, i, k = 0, 0, 0
    while i + k < many + n_others:
        stop = at + 9 + _number(data, at + 1, 8)
        if data[at] == 5:
            messages[i, 0], messages[i, 1] = at + 31, stop
            messages[i, 2] = _number(data, at + 9, 2)
            messages[i, 3] = _number(data, at + 15, 8)
            i += 1
        else:
            other_records[k, 0], other_records[k, 1], other_records[k, 2] = data[at], at + 9, stop
            k += 1
        at = stop
    return ok, other_records, messages


def rows_at(data: np.ndarray, starts: np.ndarray, size: int) -> np.ndarray:
    """The `size` bytes that begin at each of `starts`, (n, size)."""
    if not len(starts):  # perhaps in fewer bytes than one row has
        return np.empty((0, size), np.uint8)
    return np.lib.stride_tricks.sliding_window_view(data, size)[starts]
