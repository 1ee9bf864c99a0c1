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
        data = bytes(serialize_message(template))
        layout = _Layout()
        end = _walk(template, "", _HEADER, layout)
        if end > len(data):
            raise ParameterError(f"{self.type.__name__} has no constant CDR layout")
        self.dtype = np.dtype({**layout.fields, "itemsize": len(data)})
        # Fast CDR leaves padding as it finds it in memory; ours is zero, so that
        # equal messages are equal bytes.
        clean = bytearray(len(data))
        for start, stop in [(0, _HEADER), *layout.constants]:
            clean[start:stop] = data[start:stop]
        values = np.frombuffer(data, self.dtype)
        np.frombuffer(clean, self.dtype)[:] = values
        self._bytes = bytes(clean)
        if not self._agrees(template):
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


class _Layout:
    """Numeric fields for `np.dtype`, and the spans that hold texts and lengths."""

    def __init__(self) -> None:
        self.fields: dict[str, list] = {"names": [], "formats": [], "offsets": []}
        self.constants: list[tuple[int, int]] = []

    def add(self, path: str, kind: Any, at: int) -> None:
        for key, value in zip(self.fields, (path, kind, at), strict=True):
            self.fields[key].append(value)


def _walk(message: Any, prefix: str, at: int, layout: _Layout) -> int:
    """Add the fields of `message` from byte `at` on; return where it ends."""
    for name, kind in message.get_fields_and_field_types().items():
        at = _field(getattr(message, name), kind, prefix + name, at, layout)
    return at


def _field(value: Any, kind: str, path: str, at: int, layout: _Layout) -> int:
    element, is_sequence = kind, kind.startswith("sequence<")
    if is_sequence:
        element = kind[len("sequence<") : -1].split(",")[0].strip()
        at = _constant(at, 4, 4, layout)
    elif kind.endswith("]"):
        element = kind[: kind.index("[")]
    many = is_sequence or kind.endswith("]")
    if element in _PRIMITIVES:
        return _numbers(value if many else None, np.dtype(_PRIMITIVES[element]), path, at, layout)
    for index, item in enumerate(value if many else [value]):
        if element.startswith("string"):
            at = _constant(at, 4, 4 + len(item.encode()) + 1, layout)
        else:
            at = _walk(item, f"{path}.{index}." if many else path + ".", at, layout)
    return at


def _numbers(values: Any, code: np.dtype, path: str, at: int, layout: _Layout) -> int:
    """Add one number (`values` None) or an array of them."""
    if values is None:
        at = _aligned(at, code.itemsize)
        layout.add(path, code, at)
        return at + code.itemsize
    if len(values) == 0:
        return at
    at = _aligned(at, code.itemsize)
    layout.add(path, (code, (len(values),)), at)
    return at + len(values) * code.itemsize


def _constant(at: int, alignment: int, length: int, layout: _Layout) -> int:
    at = _aligned(at, alignment)
    layout.constants.append((at, at + length))
    return at + length


def _aligned(at: int, size: int) -> int:
    return at + (-(at - _HEADER)) % size
