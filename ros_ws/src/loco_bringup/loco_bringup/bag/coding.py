# SPDX-License-Identifier: Apache-2.0
"""Files and messages as other recorders code them, as CDR: compressed (zstd, lz4), or of ROS 1."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard

from loco_control.exceptions import BagError, MissingPackageError

PACKINGS = (".zstd", ".zst", ".lz4")
MAX_SIZE = 1 << 32  # largest decompressed file [bytes]
_PART = 1 << 14  # compressed bytes read at a time; a few hundred can decompress to many
_ZSTD, _LZ4 = b"\x28\xb5\x2f\xfd", b"\x04\x22\x4d\x18"  # first bytes of frames; CDR has others
ROS1 = "ros1"  # message encoding of an MCAP channel
_HEADER = "std_msgs/msg/Header"


def is_packed(path: Path) -> bool:
    """Whether the file name has the extension of a compressed file."""
    return path.suffix in PACKINGS


def plain_name(name: str) -> str:
    """Name of a file without the extension of its compression."""
    return next((name.removesuffix(end) for end in PACKINGS if name.endswith(end)), name)


def without_twins(folder: Path, suffix: str) -> list[Path]:
    """Sorted files of a folder; if a file exists plain and compressed, the plain one.

    Args:
        folder: Folder of a bag.
        suffix: Extension of the plain files.
    """
    every = {path.name: path for path in folder.iterdir() if path.is_file()}  # no FIFOs
    names = [name for name in every if plain_name(name).endswith(suffix)]
    return [every[n] for n in sorted(names) if plain_name(n) == n or plain_name(n) not in every]


def unpacked(path: Path, max_size: int = MAX_SIZE) -> bytes:
    """Decompressed content of a file.

    Args:
        path: File whose extension is one of `PACKINGS`.
        max_size: Largest decompressed size [bytes].

    Raises:
        BagError: The file is damaged, or its content exceeds `max_size` bytes.
    """
    hand = f"unpack it with `{'lz4' if path.suffix == '.lz4' else 'zstd'} -d {path.name}`"
    parts, size = [], 0
    try:
        for part in _lz4_parts(path) if path.suffix == ".lz4" else _zstd_parts(path):
            size += len(part)
            if size > max_size:
                raise BagError(f"{path} is packed and has more than {max_size} bytes; {hand}")
            parts.append(part)
    except (RuntimeError, EOFError, zstandard.ZstdError) as error:
        raise BagError(f"{path} is packed and cut short, or damaged: {error}") from None
    return b"".join(parts)


def _lz4_parts(path: Path) -> Iterator[bytes]:
    with lz4.frame.open(path, "rb") as stream:
        yield from iter(lambda: stream.read(_PART), b"")


def _zstd_parts(path: Path) -> Iterator[bytes]:
    """Decompressed parts of a file with one or more frames; the last frame must be complete."""
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
    data: list[bytes], decode: Callable[[bytes], bytes] | None, what: str, max_size: int = 1 << 30
) -> list[bytes]:
    """Messages of a topic as CDR.

    Args:
        data: Messages as stored in the file.
        decode: Function that converts one message to CDR; None if they are CDR already.
        what: Name of the file for error messages.
        max_size: Largest total size of the decoded messages [bytes].

    Raises:
        BagError: A message is damaged, or the total size exceeds `max_size`.
    """
    if decode is None:
        return data
    outputs, size = [], 0
    for message in data:
        outputs.append(decode(message))
        size += len(outputs[-1])
        if size > max_size:
            raise BagError(f"{what}: messages of one topic unpack to more than {max_size} bytes")
    return outputs


def unpacker(data: bytes) -> Callable[[bytes], bytes] | None:
    """Function that decompresses messages of this format; None if `data` is not compressed."""
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


def library(name: str, what: str) -> Any:
    """A module of rosbags.

    Args:
        name: Name of the module inside the package ``rosbags``.
        what: File that needs it, for error messages.

    Raises:
        MissingPackageError: rosbags is not installed.
    """
    try:
        return importlib.import_module(f"rosbags.{name}")
    except ModuleNotFoundError:
        raise MissingPackageError(
            f"{what} holds messages of ROS 1: reading them needs rosbags, which comes with "
            "`./loco install ros1`; or convert the bag with `rosbags-convert`"
        ) from None


def kind_of(name: str) -> str:
    """ROS 2 name, ``package/msg/Type``, of a ROS 1 type."""
    return name if "/msg/" in name else name.replace("/", "/msg/", 1)


def converter(name: str, text: str, what: str) -> tuple[Callable[[bytes], bytes], str]:
    """Function that converts serialised ROS 1 messages to CDR, and the ROS 2 definition.

    Args:
        name: Type of the messages, in the notation of ROS 1 or ROS 2.
        text: ROS 1 definition, including the definitions of nested types.
        what: File name for error messages.

    Raises:
        BagError: The text is not a valid definition.
        MissingPackageError: rosbags is not installed.
    """
    types, kind = library("typesys", what), kind_of(name)
    store = types.get_typestore(types.Stores.EMPTY)
    ros2 = types.get_typestore(types.Stores.ROS2_JAZZY)
    try:
        definitions = types.get_types_from_msg(text, kind)
        for base in (_HEADER, "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
            definitions[base] = ros2.fielddefs[base]  # a header of ROS 2 has no seq
        store.register(definitions)
        definition, _ = store.generate_msgdef(kind, ros_version=2)
    except Exception as error:  # noqa: BLE001  (its parser raises whatever a text leads to)
        raise BagError(f"{what}: the definition of {name} cannot be read: {error}") from None

    def convert(data: bytes) -> bytes:
        try:
            return bytes(store.ros1_to_cdr(data, kind))
        except Exception as error:  # noqa: BLE001  (as above)
            raise BagError(f"{what}: {len(data)} bytes are no {name} of ROS 1: {error}") from None

    return convert, definition
