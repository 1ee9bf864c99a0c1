# SPDX-License-Identifier: Apache-2.0
"""Messages of constant layout as NumPy records over their CDR bytes.

A message whose arrays and texts never change length always has the same CDR
layout, so its serialised bytes *are* a packed record: writing a field is one
slice assignment and a whole bag decodes with one `np.frombuffer`. rclpy's own
path builds a Python object per message and walks it field by field, which for
a 12-joint ``JointState`` costs ten times as much (`loco bench messages`).

The layout follows XCDR1 as Fast DDS writes it: four bytes of encapsulation,
then each primitive aligned to its own size, counted from byte 4. Messages without
texts and sequences end at a multiple of four bytes. Fast DDS reserves padding in front of empty
sequences at the end, unused by its Python interface; it is omitted here, since strict readers,
such as rosbags, refuse it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ...exceptions import ParameterError
from .definitions import PRIMITIVES

_HEADER = 4  # encapsulation bytes before the payload
_TYPES = {kind: np.dtype(f"<{code}") for kind, _, code in PRIMITIVES.values() if code}


class Codec:
    """Encoder and decoder for one message type at one constant layout.

    Args:
        template: A filled message, of ROS or of `plain`; its texts and sequence lengths
            become constants, every number becomes a field named by its dotted path,
            e.g. ``"header.stamp.sec"`` or ``"position"``.
        size: Size of messages written by other programs, which may pad the end [bytes].

    Raises:
        ParameterError: A field does not fit into a record, or the template is longer than `size`.
    """

    def __init__(self, template: Any, size: int | None = None):
        self.type = type(template)
        layout = _Layout()
        layout.message(template, "")
        needed = len(layout.data) + (-len(layout.data) % 4 if layout.fixed else 0)
        if size is not None and size < len(layout.data):
            raise ParameterError(f"{self.type.__name__} has {len(layout.data)} bytes, got {size}")
        self._bytes = bytes(layout.data).ljust(size or needed, b"\0")
        self.dtype = np.dtype({**layout.fields, "itemsize": len(self._bytes)})

    @property
    def template(self) -> bytes:
        """Serialised bytes of the template."""
        return self._bytes

    def record(self) -> np.ndarray:
        """New writable record of shape (), initialised with the template."""
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


class _Layout:
    """Serialised bytes of a message under construction, and the offsets of its numbers.

    Attributes:
        data: Bytes written so far, padded with zeros.
        fields: Names, formats and offsets for `np.dtype`.
        fixed: Whether all messages of the type have the same length.
    """

    def __init__(self) -> None:
        self.data = bytearray(b"\x00\x01\x00\x00")
        self.fields: dict[str, list] = {"names": [], "formats": [], "offsets": []}
        self.fixed = True

    def _put(self, data: bytes, alignment: int = 1) -> None:
        """Append bytes at the next multiple of `alignment` after the encapsulation."""
        if data:
            self.data += bytes((_HEADER - len(self.data)) % alignment) + data

    def message(self, message: Any, prefix: str) -> None:
        """Append all fields of a message; a message without fields has one byte."""
        types = message.get_fields_and_field_types()
        for name, kind in types.items():
            self._field(getattr(message, name), kind, prefix + name)
        if not types:
            self._put(b"\0")

    def _field(self, value: Any, kind: str, path: str) -> None:
        element, many = kind, kind.endswith("]")
        if kind.startswith("sequence<"):
            element, many = kind[len("sequence<") : -1].split(",")[0].strip(), True
            self._length(len(value))
        elif many:
            element = kind[: kind.index("[")]
        if element == "octet":  # rclpy represents each octet as bytes
            value = [_octet(v) for v in value] if many else _octet(value)
        if element in _TYPES:
            self._numbers(value, _TYPES[element], path, many)
            return
        for index, item in enumerate(value if many else [value]):
            if element.startswith("string"):
                self._length(len(item.encode()) + 1)
                self._put(item.encode() + b"\0")
            elif "/" in element:
                self.message(item, f"{path}.{index}." if many else path + ".")
            else:
                raise ParameterError(f"{path} is of type {kind}, which no record can hold")

    def _length(self, count: int) -> None:
        self.fixed = False
        self._put(count.to_bytes(4, "little"), 4)

    def _numbers(self, value: Any, code: np.dtype, path: str, many: bool) -> None:
        """Append one number or an array of numbers."""
        data = np.asarray(value, code).tobytes()
        self._put(data, code.itemsize)
        if data:
            place = path, (code, (len(value),)) if many else code, len(self.data) - len(data)
            for column, what in zip(self.fields.values(), place, strict=True):
                column.append(what)


def _octet(value: bytes | int) -> int:
    return value[0] if isinstance(value, bytes) else value
