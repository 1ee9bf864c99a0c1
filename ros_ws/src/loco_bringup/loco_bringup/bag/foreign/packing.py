# SPDX-License-Identifier: Apache-2.0
"""Files and messages that `ros2 bag record --compression-mode` packed, by zstd or lz4."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
import zstandard

from loco_control.exceptions import BagError

PACKINGS = (".zstd", ".zst", ".lz4")
MOST = 1 << 32  # bytes of an unpacked file
_PART = 1 << 14  # bytes that are unpacked at a time: a few hundred unpack to many
_ZSTD, _LZ4 = b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18"  # with which frames begin, and no CDR does


def is_packed(path: Path) -> bool:
    """The name of a file says that it is packed."""
    return path.suffix in PACKINGS


def plain_name(name: str) -> str:
    """Name of a file without the ending of its packing."""
    return next((name.removesuffix(end) for end in PACKINGS if name.endswith(end)), name)


def without_twins(folder: Path, suffix: str) -> list[Path]:
    """Files of a folder by name, packed or not; of a file that lies there twice the plain one.

    Args:
        folder: Folder of a bag.
        suffix: Ending of the plain files.
    """
    every = {path.name: path for path in folder.iterdir() if path.is_file()}  # a FIFO has no end
    names = [name for name in every if plain_name(name).endswith(suffix)]
    return [every[n] for n in sorted(names) if plain_name(n) == n or plain_name(n) not in every]


def unpacked(path: Path, most: int = MOST) -> bytes:
    """Content of a packed file.

    Args:
        path: File whose name ends as one of `PACKINGS`.
        most: Bytes that are believed.

    Raises:
        BagError: It is damaged, or unpacks to more than `most` bytes.
    """
    hand = f"unpack it with `{'lz4' if path.suffix == '.lz4' else 'zstd'} -d {path.name}`"
    parts, size = [], 0
    try:
        for part in _lz4_parts(path) if path.suffix == ".lz4" else _zstd_parts(path):
            size += len(part)
            if size > most:
                raise BagError(f"{path} is packed and has more than {most} bytes; {hand}")
            parts.append(part)
    except (RuntimeError, EOFError, zstandard.ZstdError) as error:
        raise BagError(f"{path} is packed and cut short, or damaged: {error}") from None
    return b"".join(parts)


def _lz4_parts(path: Path) -> Iterator[bytes]:
    with lz4.frame.open(path, "rb") as stream:
        yield from iter(lambda: stream.read(_PART), b"")


def _zstd_parts(path: Path) -> Iterator[bytes]:
    """Content of a file of one frame or several, of which the last one has to end."""
    frame = None
    with open(path, "rb") as stream:
        for packed in iter(lambda: stream.read(_PART), b""):
            while packed:
                frame = frame or zstandard.ZstdDecompressor().decompressobj()
                yield frame.decompress(packed)
                packed = frame.unused_data if frame.eof else b""
                frame = None if frame.eof else frame
    if frame is not None:
        raise EOFError("its last frame does not end")


def decoded(
    data: list[bytes], decode: Callable[[bytes], bytes] | None, what: str, most: int = 1 << 30
) -> list[bytes]:
    """Messages of a topic as CDR.

    Args:
        data: Messages as they lie in the file.
        decode: Function that makes CDR of one; None where they are CDR.
        what: File, for messages.
        most: Bytes of all together that are believed.

    Raises:
        BagError: A message is damaged, or they are more.
    """
    if decode is None:
        return data
    made, size = [], 0
    for message in data:
        made.append(decode(message))
        size += len(made[-1])
        if size > most:
            raise BagError(f"{what}: messages of one topic unpack to more than {most} bytes")
    return made


def unpacker(data: bytes) -> Callable[[bytes], bytes] | None:
    """Function that unpacks messages like this one; None where it is not packed."""
    if data[:4] == _ZSTD:
        return _zstd
    return _lz4 if data[:4] == _LZ4 else None


def _zstd(data: bytes) -> bytes:
    try:
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=1 << 28)
    except zstandard.ZstdError as error:
        raise BagError(f"a message that zstd packed is damaged: {error}") from None


def _lz4(data: bytes) -> bytes:
    try:
        return lz4.frame.decompress(data)
    except RuntimeError as error:
        raise BagError(f"a message that lz4 packed is damaged: {error}") from None
