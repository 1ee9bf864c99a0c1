# SPDX-License-Identifier: Apache-2.0
"""Safe unpacking of compressed input files, with a limit on the unpacked size.

Nothing is unpickled, and a size stated by a file is checked against its actual bytes.
Errors are those of the parsers; `reading` converts them into a `LocoError`.
"""

from __future__ import annotations

import io
import zipfile
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np

FREE = 64 * 2**20  # bytes that any file may unpack to: a log of constants compresses a thousandfold
RATIO = 100  # largest ratio of unpacked to packed size of larger files
MOST_BYTES = 2**30  # largest size of a file, packed or unpacked [bytes]
_MEMBERS = 100_000  # largest number of files in a zip
_DTYPE_KINDS = "biufcUS"  # accepted kinds of NumPy types: numbers, booleans and texts


def limit(size: int) -> int:
    """Largest unpacked size of a packed file of this size, both in bytes."""
    return min(MOST_BYTES, max(FREE, RATIO * size))


def check_room(filled: int, size: int) -> None:
    """Refuse contents larger than `limit`.

    Args:
        filled: Size once unpacked [bytes].
        size: Size of the file [bytes].

    Raises:
        ValueError: The contents are larger.
    """
    if filled > limit(size):
        raise ValueError(
            f"unpacked it has {filled} bytes, at most {limit(size)} are unpacked of {size}"
        )


def unzip(data: bytes) -> dict[str, bytes]:
    """Contents of each file in a zip, by name.

    Raises:
        ValueError: The contents exceed `limit`, or use a compression method other than deflation.
        zipfile.BadZipFile: The data is not a zip, or a checksum is wrong.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as files:
        members = files.infolist()
        check_room(sum(member.file_size for member in members), len(data))
        if len(members) > _MEMBERS:
            raise ValueError(f"it holds {len(members)} files, at most {_MEMBERS} are read")
        for member in members:
            if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
                raise ValueError("it is packed by another method than deflation")
        return {member.filename: files.read(member) for member in members}


def array(data: bytes) -> np.ndarray:
    """Array of the bytes of a ``.npy`` file.

    Raises:
        ValueError: The data is not a ``.npy`` file, has elements other than numbers and texts, or
            its length does not match its shape.
    """
    import numpy as np  # here, since importing NumPy delays the command line

    file = io.BytesIO(data)
    version = np.lib.format.read_magic(file)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"its arrays are of version {version}, read are 1.0 and 2.0")
    head = (np.lib.format.read_array_header_1_0 if version == (1, 0)
            else np.lib.format.read_array_header_2_0)  # fmt: skip
    shape, by_columns, kind = head(file)
    if kind.kind not in _DTYPE_KINDS or not kind.itemsize:
        raise ValueError(f"an array holds {kind}, read are numbers and texts")
    count, rest = 1, len(data) - file.tell()
    for number in shape:
        count *= number
    if min(shape, default=0) < 0 or count * kind.itemsize != rest:
        raise ValueError(f"an array of shape {shape} has {rest} bytes")
    values = np.frombuffer(data[file.tell() :], kind).copy()
    return values.reshape(shape, order="F" if by_columns else "C")
