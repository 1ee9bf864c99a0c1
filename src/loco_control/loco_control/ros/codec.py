# SPDX-License-Identifier: Apache-2.0
"""Messages of constant layout as NumPy records over their CDR bytes.

A message whose arrays and texts never change length always has the same CDR
layout, so its serialised bytes *are* a packed record: writing a field is one
slice assignment and a whole bag decodes with one `np.frombuffer`. rclpy's own
path builds a Python object per message and walks it field by field, which for
a 12-joint ``JointState`` costs ten times as much (`loco bench messages`).

The layout follows XCDR1 as Fast DDS writes it: four bytes of encapsulation,
then each primitive aligned to its own size, counted from byte 4. `Codec`
checks it against rclpy's serialiser for the template it is given.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.serialization import serialize_message

from loco_control.exceptions import ParameterError

_HEADER = 4  # encapsulation bytes before the payload
_PRIMITIVES = {
    "boolean": "?",
    "octet": "u1",
    "uint8": "u1",
    "int8": "i1",
    "uint16": "<u2",
    "int16": "<i2",
    "uint32": "<u4",
    "int32": "<i4",
    "uint64": "<u8",
    "int64": "<i8",
    "float": "<f4",
    "double": "<f8",
}


class Codec:
    """Encoder and decoder for one message type at one constant layout.

    Args:
        template: A filled message; its texts and sequence lengths become
            constants, every number stays a field named by its path with dots,
            e.g. ``"header.stamp.sec"`` or ``"position"``.

    Raises:
        ParameterError: The layout does not match what rclpy serialises.
    """

    def __init__(self, template: Any):
        self.type = type(template)
        self._bytes = bytes(serialize_message(template))
        names, formats, offsets = [], [], []
        end = _walk(template, "", _HEADER, names, formats, offsets)
        self.dtype = np.dtype(
            {"names": names, "formats": formats, "offsets": offsets, "itemsize": len(self._bytes)}
        )
        if end > len(self._bytes) or not self._agrees(template):
            raise ParameterError(f"{self.type.__name__} has no constant CDR layout")

    @property
    def template(self) -> bytes:
        """Serialised bytes of the template."""
        return self._bytes

    def record(self) -> np.ndarray:
        """New writable record of shape () that starts as the template."""
        return np.frombuffer(bytearray(self._bytes), dtype=self.dtype)[0:1].reshape(())

    def decode(self, data: bytes) -> np.ndarray:
        """Record of shape () that views `data`.

        Raises:
            ParameterError: `data` does not have the length of the layout.
        """
        if len(data) != self.dtype.itemsize:
            raise ParameterError(
                f"{self.type.__name__} has {self.dtype.itemsize} bytes, got {len(data)}"
            )
        return np.frombuffer(data, dtype=self.dtype).reshape(())

    def decode_many(self, data: list[bytes]) -> np.ndarray:
        """Records of shape (len(data),); one copy, no Python object per message."""
        wrong = [len(d) for d in data if len(d) != self.dtype.itemsize]
        if wrong:
            raise ParameterError(
                f"{self.type.__name__} has {self.dtype.itemsize} bytes, got {wrong[0]}"
            )
        return np.frombuffer(b"".join(data), dtype=self.dtype)

    def _agrees(self, template: Any) -> bool:
        record = self.decode(self._bytes)
        return all(
            np.array_equal(record[name], np.asarray(_follow(template, name)), equal_nan=True)
            for name in self.dtype.names
        )


def _follow(message: Any, path: str) -> Any:
    for part in path.split("."):
        message = message[int(part)] if part.isdigit() else getattr(message, part)
    return message


def _walk(message: Any, prefix: str, at: int, names: list, formats: list, offsets: list) -> int:
    """Append the numeric fields of `message` from byte `at`; return the end."""
    for name, kind in message.get_fields_and_field_types().items():
        at = _field(getattr(message, name), kind, prefix + name, at, names, formats, offsets)
    return at


def _field(
    value: Any, kind: str, path: str, at: int, names: list, formats: list, offsets: list
) -> int:
    element, is_sequence = kind, False
    if kind.startswith("sequence<"):
        element, is_sequence = kind[len("sequence<") : -1].split(",")[0].strip(), True
        at = _aligned(at, 4) + 4
    elif kind.endswith("]"):
        element = kind[: kind.index("[")]
    many = is_sequence or kind.endswith("]")
    if element in _PRIMITIVES:
        code = np.dtype(_PRIMITIVES[element])
        count = len(value) if many else 1
        if many and count == 0:
            return at
        at = _aligned(at, code.itemsize)
        names.append(path)
        formats.append((code, (count,)) if many else code)
        offsets.append(at)
        return at + count * code.itemsize
    for index, item in enumerate(value if many else [value]):
        where = f"{path}.{index}" if many else path
        if element.startswith("string"):
            at = _aligned(at, 4) + 4 + len(item.encode()) + 1
        else:
            at = _walk(item, where + ".", at, names, formats, offsets)
    return at


def _aligned(at: int, size: int) -> int:
    return at + (-(at - _HEADER)) % size
