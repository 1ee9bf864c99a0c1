# SPDX-License-Identifier: Apache-2.0
"""Write an MCAP file so that its chunks stay complete after a crash or on a full disk.

Each chunk is written in one piece; a partial write is undone by truncating the file. The
end of the file (attachments, summary) is built in memory; if the disk has no
space for it, the last chunks can be removed to make room.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import zstandard
from mcap import records as mcap
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode

from .mcap_scan import HEAD, MAGIC

_MESSAGE = struct.Struct("<BQHIQQ")  # record head, channel, sequence, log and publish time [ns]
_ENTRY = struct.Struct("<QQ")  # entry of a message index: time, offset in the chunk
# Summary of a chunk until the file is closed, as bytes: there can be many thousand chunks.
# Start, length, index length, compressed and uncompressed size [bytes], first and last time [ns].
_CHUNK = struct.Struct("<QQQQQQQ")
_COUNT = struct.Struct("<HQI")  # per channel: id, offset of its index, number of messages


class McapWriter:
    """One file being written; chunks are compressed with zstd.

    Args:
        path: The file; it is overwritten.
        chunk_size: Uncompressed size after which a chunk is written [bytes].
        library: Name of the writing program, for the header of the file.

    Attributes:
        messages: Number of messages in the file.
        pending: Number of messages whose chunk is not written yet.

    Raises:
        OSError: The file cannot be created.
    """

    def __init__(self, path: Path, chunk_size: int, library: str):
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o644)
        self._offset = 0
        self._chunk_size = chunk_size
        self._packer = zstandard.ZstdCompressor()
        self._schemas: list[mcap.Schema] = []
        self._channels: list[mcap.Channel] = []
        self._chunks: list[bytes] = []  # `_CHUNK`, then `_COUNT` for each channel
        self._tail: list[Callable[[], mcap.Attachment | mcap.Metadata]] = []
        self.messages = 0
        self._clear()
        self._put(MAGIC + _bytes(mcap.Header("ros2", library)))

    def schema(self, name: str, encoding: str, data: bytes) -> int:
        """Register a message type; returns its id."""
        self._schemas.append(
            mcap.Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        )
        self._define(self._schemas[-1])
        return len(self._schemas)

    def channel(self, topic: str, encoding: str, schema: int, metadata: dict[str, str]) -> int:
        """Register a topic; returns its id."""
        number = len(self._channels) + 1
        self._channels.append(mcap.Channel(number, topic, encoding, metadata, schema))
        self._define(self._channels[-1])
        return number

    def _define(self, record: mcap.McapRecord) -> None:
        """Write a definition to the file now, and again in the next chunk, which has a checksum."""
        data = _bytes(record)
        self._put(data)
        self._buffer += data

    def message(self, channel: int, time: int, data: bytes, publish: int, sequence: int) -> None:
        """Append a message; its chunk is written when it is full.

        Raises:
            OSError: A chunk was full and could not be written; its messages are lost.
        """
        size = _MESSAGE.size - HEAD.size + len(data)
        entry = _ENTRY.pack(time, len(self._buffer))
        self._buffer += _MESSAGE.pack(Opcode.MESSAGE, size, channel, sequence, time, publish)
        self._buffer += data
        self._index[channel].append(entry)
        self._first = time if self._first is None or time < self._first else self._first
        self._last = time if time > self._last else self._last
        self.pending += 1
        if len(self._buffer) > self._chunk_size:
            self.flush()

    def attachment(self, time: int, name: str, media_type: str, data: bytes) -> None:
        """Add an attachment; it is written when the file is finished."""
        self._tail.append(lambda: mcap.Attachment(time, time, name, media_type, data))

    def metadata(self, name: str, values: Callable[[], dict[str, str]]) -> None:
        """Add a metadata record; `values` is called when the file is finished."""
        self._tail.append(lambda: mcap.Metadata(metadata=values(), name=name))

    @property
    def size(self) -> int:
        """Size of the file plus the uncompressed size of the pending messages [bytes]."""
        return self._offset + len(self._buffer)

    def flush(self) -> None:
        """Write the chunk in progress.

        Raises:
            OSError: The disk is full; the messages of the chunk are lost, the file is unchanged.
        """
        if not self._buffer:
            return
        records, index, first, last = self._buffer, self._index, self._first or 0, self._last
        count = self.pending
        self._clear()
        packed = self._packer.compress(records)
        chunk = _bytes(mcap.Chunk("zstd", packed, last, first, zlib.crc32(records), len(records)))
        offsets, tables, at = [], [], self._offset + len(chunk)
        for channel, entries in index.items():
            offsets.append(_COUNT.pack(channel, at, len(entries)))
            data = b"".join(entries)
            tables.append(struct.pack("<BQHI", 7, 6 + len(data), channel, len(data)) + data)
            at += len(tables[-1])
        start = self._put(chunk + b"".join(tables))
        row = _CHUNK.pack(
            start, len(chunk), at - start - len(chunk), len(packed), len(records), first, last
        )
        self._chunks.append(row + b"".join(offsets))
        self.messages += count

    def _clear(self) -> None:
        self._buffer = bytearray()
        self._index: dict[int, list[bytes]] = defaultdict(list)
        self._first: int | None = None
        self._last = 0
        self.pending = 0

    def _put(self, data: bytes) -> int:
        """Append data, all or nothing; returns its offset in the file."""
        start, view = self._offset, memoryview(data)
        try:
            while view:
                view = view[os.write(self._fd, view) :]
        except OSError:
            self._rewind(start)
            raise
        self._offset += len(data)
        return start

    def _rewind(self, offset: int) -> None:
        os.ftruncate(self._fd, offset)
        os.lseek(self._fd, offset, os.SEEK_SET)
        self._offset = offset

    @property
    def span(self) -> tuple[int, int]:
        """Times of the first and last message in the file [ns]; zeros when there is none."""
        rows = [_CHUNK.unpack_from(row) for row in self._chunks if len(row) > _CHUNK.size]
        return min((row[5] for row in rows), default=0), max((row[6] for row in rows), default=0)

    def counts(self) -> dict[int, int]:
        """Number of messages in the file by channel."""
        total: dict[int, int] = defaultdict(int)
        for row in self._chunks:
            for channel, _, count in _channels_in(row):
                total[channel] += count
        return dict(total)

    def finish(
        self, then: Callable[[], None] = lambda: None, make_room: bool = False, sync: bool = True
    ) -> None:
        """Write attachments, metadata and summary; on a full disk the file stays open.

        Args:
            then: A function that writes the rest of the bag, e.g. ``metadata.yaml``.
            make_room: Whether to remove the last chunks if the disk is full.
            sync: Whether to wait until the data is on the disk (fsync).

        Raises:
            OSError: The disk is full even so; the file is complete up to its last chunk.
        """
        while not self._ended(then, make_room and bool(self._chunks)):
            row = self._chunks.pop()
            self.messages -= sum(count for _, _, count in _channels_in(row))
            self._rewind(_CHUNK.unpack_from(row)[0])
        if sync:
            os.fsync(self._fd)
        self.close()

    def close(self) -> None:
        """Close the file without writing anything more."""
        os.close(self._fd)

    def _ended(self, then: Callable[[], None], may_fail: bool) -> bool:
        start = self._offset
        try:
            self._put(self._ending())
            then()
        except OSError:
            self._rewind(start)
            if not may_fail:
                raise
            return False
        return True

    def _ending(self) -> bytes:
        """Everything after the last chunk."""
        out, files, metadata = bytearray(), [], []
        for make in self._tail:
            record = make()
            at, data = self._offset + len(out), _bytes(record)
            out += data
            if isinstance(record, mcap.Metadata):
                metadata.append(mcap.MetadataIndex(length=len(data), name=record.name, offset=at))
            else:
                files.append(
                    mcap.AttachmentIndex(
                        at, len(data), record.log_time, record.create_time, len(record.data),
                        record.name, record.media_type,
                    )
                )  # fmt: skip
        out += _bytes(mcap.DataEnd(0))
        start = self._offset + len(out)
        chunks = [_chunk_index(row) for row in self._chunks]
        numbers = self._statistics(len(files), len(metadata))
        groups = [self._schemas, self._channels, [numbers], chunks, files, metadata]
        return bytes(out) + _summary([g for g in groups if g], start) + MAGIC

    def _statistics(self, files: int, metadata: int) -> mcap.Statistics:
        first, last = self.span
        return mcap.Statistics(
            attachment_count=files, channel_count=len(self._channels),
            channel_message_counts=self.counts(), chunk_count=len(self._chunks),
            message_count=self.messages, metadata_count=metadata,
            message_start_time=first, message_end_time=last, schema_count=len(self._schemas),
        )  # fmt: skip


def _summary(groups: list[list[mcap.McapRecord]], start: int) -> bytes:
    """Summary section that begins at `start`, with its offsets and footer."""
    out, offsets = bytearray(), bytearray()
    for group in groups:
        data = b"".join(map(_bytes, group))
        offsets += _bytes(mcap.SummaryOffset(Opcode(data[0]), start + len(out), len(data)))
        out += data
    at = start + len(out)
    out += offsets
    head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, at)
    return bytes(out) + _bytes(mcap.Footer(start, at, zlib.crc32(head, zlib.crc32(out))))


def _channels_in(row: bytes) -> Iterator[tuple[int, int, int]]:
    """Id, offset of the index, and number of messages for each channel of a chunk."""
    return _COUNT.iter_unpack(row[_CHUNK.size :])


def _chunk_index(row: bytes) -> mcap.ChunkIndex:
    start, length, index, packed, size, first, last = _CHUNK.unpack_from(row)
    return mcap.ChunkIndex(
        chunk_length=length, chunk_start_offset=start, compression="zstd",
        compressed_size=packed, message_end_time=last, message_start_time=first,
        message_index_length=index, uncompressed_size=size,
        message_index_offsets={channel: at for channel, at, _ in _channels_in(row)},
    )  # fmt: skip


def _bytes(record: mcap.McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
