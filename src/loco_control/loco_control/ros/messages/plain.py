# SPDX-License-Identifier: Apache-2.0
"""Message classes generated from definitions, and deserialisation of CDR bytes, without ROS.

They have the fields of the ROS message classes and the same method
`get_fields_and_field_types`. So bags are read, and messages of constant layout are written
(`codec`), with or without ROS.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import cache, partial
from typing import Any, ClassVar

import numpy as np

from ...exceptions import NameUnknownError, ParameterError
from .definitions import PRIMITIVES, Field, fields_of, split

_HEADER = 4  # bytes of encapsulation before the payload
_BIG_ENDIAN, _LITTLE_ENDIAN = b"\x00\x00", b"\x00\x01"
_CODES = {base: code for base, (_, _, code) in PRIMITIVES.items() if code}
_STRUCTS = {
    (order, base): struct.Struct(order + code) for base, code in _CODES.items() for order in "<>"
}


class Message:
    """Base of all message classes that are generated from definitions.

    Args:
        values: Values of fields; others have the default of the definition, else zero or empty.

    Raises:
        NameUnknownError: The message has no such field.
    """

    __slots__ = ()
    _fields: ClassVar[tuple[Field, ...]] = ()
    _type_name: ClassVar[str] = ""  # ``package/msg/Type``
    _inner: ClassVar[Mapping[str, type[Message]]] = {}  # classes of the fields that are messages

    def __init__(self, **values: Any):
        for field in self._fields:
            is_set = field.name in values
            setattr(self, field.name, values.pop(field.name) if is_set else self._default(field))
        for name in values:
            raise NameUnknownError(f"field of {self._type_name}", name, self.__slots__)

    def _default(self, field: Field) -> Any:
        if field.default is not None:
            return field.default
        if field.array in ("bounded", "sequence"):
            return []
        zero = self._zero(field)
        return [self._zero(field) for _ in range(field.count)] if field.array else zero

    def _zero(self, field: Field) -> Any:
        if field.is_message:
            return self._inner[field.base]()
        if field.base.endswith("string"):
            return ""
        return np.zeros((), _CODES[field.base]).item()

    def __repr__(self) -> str:
        values = ", ".join(f"{name}={getattr(self, name)!r}" for name in self.__slots__)
        return f"{self._type_name}({values})"

    @classmethod
    def get_fields_and_field_types(cls) -> dict[str, str]:
        """Types of the fields, in the notation of the ROS message classes."""
        return {field.name: field.kind for field in cls._fields}


def message_class(name: str, text: str | None = None) -> type[Message]:
    """Message class for a definition.

    Args:
        name: Full name, ``package/msg/Type``.
        text: Definition with its nested messages, as in bags; default the definition of the
            installed packages or of loco's topics.

    Raises:
        NameUnknownError: There is no definition of the message or of a nested message.
        ParameterError: The text is not a message definition.
    """
    short = name.replace("/msg/", "/")
    return _from_text(short, text) if text else _class(short)


@cache
def _class(short: str) -> type[Message]:
    fields = fields_of(short)
    return _classes(short, fields, {f.base: _class(f.base) for f in fields if f.is_message})


@cache
def _from_text(short: str, text: str) -> type[Message]:
    sections = split(text, short)
    done: dict[str, type[Message]] = {}
    todo = [short]
    while todo:
        name = todo[-1]
        if name not in sections:  # Some recorders omit common types, such as Time.
            done[name] = _class(name)
        missing = [f.base for f in sections.get(name, ()) if f.is_message and f.base not in done]
        if any(base in todo for base in missing):
            raise ParameterError(f"{short}: {name} contains itself")
        todo += missing
        if not missing:
            todo.pop()
            if name not in done:
                inner = {f.base: done[f.base] for f in sections[name] if f.is_message}
                done[name] = _classes(name, sections[name], inner)
    return done[short]


def _classes(
    short: str, fields: tuple[Field, ...], inner: Mapping[str, type[Message]]
) -> type[Message]:
    values = {
        "__slots__": tuple(f.name for f in fields), "__doc__": f"A message {short}.",
        "_fields": fields, "_type_name": short.replace("/", "/msg/"), "_inner": inner,
    }  # fmt: skip
    return type(short.rpartition("/")[2], (Message,), values)


# ---- bytes to messages ----------------------------------------------------------------------


def deserialize(data: bytes, cls: type[Message]) -> Message:
    """Message deserialised from CDR bytes, the format of every ROS 2 middleware.

    Arrays of numbers become NumPy arrays; arrays of texts and messages become lists.

    Args:
        data: Bytes, including the encapsulation header.
        cls: Class from `message_class`.

    Raises:
        ParameterError: The bytes are not a message of this class.
    """
    try:
        return _Cursor(data).message(cls)
    except (struct.error, ValueError, IndexError):
        raise ParameterError(f"{len(data)} bytes are no {cls._type_name}") from None


class _Cursor:
    """Read position in the bytes of a message.

    Raises:
        ValueError: The encapsulation is not plain CDR.
    """

    def __init__(self, data: bytes):
        if data[:2] not in (_BIG_ENDIAN, _LITTLE_ENDIAN):
            raise ValueError("not plain CDR")
        self.data, self.at = data, _HEADER
        self.order = "<" if data[:2] == _LITTLE_ENDIAN else ">"

    def message(self, cls: type[Message]) -> Message:
        message = cls.__new__(cls)
        for name, read in _readers(cls):
            setattr(message, name, read(self))
        if not cls._fields:  # skip the dummy byte of an empty message
            self.at += 1
        return message

    def number(self, base: str) -> Any:
        kind = _STRUCTS[self.order, base]
        at = self.at + (_HEADER - self.at) % kind.size
        self.at = at + kind.size
        return kind.unpack_from(self.data, at)[0]

    def numbers(self, base: str, count: int) -> np.ndarray:
        kind = np.dtype(self.order + _CODES[base])
        if not count:
            return np.zeros(0, kind.newbyteorder("="))
        self.at += (_HEADER - self.at) % kind.itemsize
        values = np.frombuffer(self.data, kind, count, self.at)
        self.at += values.nbytes
        return values.astype(kind.newbyteorder("="))

    def text(self) -> str:
        length = self.number("uint32")
        at, self.at = self.at, self.at + length
        if self.at > len(self.data):
            raise ValueError("text beyond the end")
        return bytes(self.data[at : self.at]).removesuffix(b"\0").decode("utf-8", "replace")

    def wide_text(self) -> str:
        return "".join(map(chr, self.numbers("uint16", self.number("uint32")).tolist()))

    def array(self, field: Field, element: Callable[[_Cursor], Any]) -> Any:
        count = field.count if field.array == "fixed" else self.number("uint32")
        if count > len(self.data) - self.at:  # each element has at least one byte
            raise ValueError("more elements than bytes")
        if field.base in _CODES:
            return self.numbers(field.base, count)
        return [element(self) for _ in range(count)]


_Reader = Callable[[_Cursor], Any]


@cache
def _readers(cls: type[Message]) -> list[tuple[str, _Reader]]:
    """Name and reading function of each field."""
    return [(field.name, _reader(field, cls)) for field in cls._fields]


def _reader(field: Field, cls: type[Message]) -> _Reader:
    inner = cls._inner.get(field.base)
    if inner is not None:
        element: _Reader = partial(_Cursor.message, cls=inner)
    elif field.base == "string":
        element = _Cursor.text
    elif field.base == "wstring":
        element = _Cursor.wide_text
    else:
        element = partial(_Cursor.number, base=field.base)
    return partial(_Cursor.array, field=field, element=element) if field.array else element
