# SPDX-License-Identifier: Apache-2.0
"""Conversion of job results to and from JSON: plain values, arrays and dataclasses.

A value is restored with the same types and bytes. Nothing is unpickled: a file can only
contain arrays of numbers and the dataclasses that its reader names.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.packed import check_room
from loco_control.reading import shown

_NUMBERS = "biufc"  # kinds of NumPy data types
_KIND, _OF = "is", "of"


def dump(value: Any) -> Any:
    """A value in a form that JSON can store.

    Args:
        value: Plain value, list, tuple, mapping, array, number of NumPy or dataclass of such.

    Raises:
        TypeError: The value contains another type.
    """
    if value is None or type(value) in (bool, int, float, str):
        return value
    if type(value) is list:
        return [dump(entry) for entry in value]
    if type(value) is tuple:
        return {_KIND: "tuple", _OF: [dump(entry) for entry in value]}
    if type(value) is dict:
        return {_KIND: "dict", _OF: [[dump(k), dump(v)] for k, v in value.items()]}
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in _NUMBERS:
        return _dump_array(value)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: dump(getattr(value, f.name)) for f in dataclasses.fields(value)}
        return {_KIND: type(value).__qualname__, _OF: fields}
    raise TypeError(f"a {type(value).__name__} cannot be kept as JSON")


def _dump_array(value: Any) -> dict[str, Any]:
    by_columns = value.flags.f_contiguous and not value.flags.c_contiguous
    data = zlib.compress(value.tobytes("F" if by_columns else "C"), 1)
    kind = "array" if isinstance(value, np.ndarray) else "number"
    about = [value.dtype.str, list(value.shape), "F" if by_columns else "C"]
    return {_KIND: kind, _OF: [*about, base64.b64encode(data).decode()]}


def load(value: Any, types: Sequence[type] = ()) -> Any:
    """Inverse of `dump`.

    Args:
        value: Value from JSON.
        types: Dataclasses that it may contain.

    Raises:
        ParameterError: The value is not from `dump`, or names another class.
    """
    try:
        return _load(value, {kind.__qualname__: kind for kind in types})
    except (ValueError, TypeError, KeyError, RecursionError, MemoryError, binascii.Error,
            zlib.error, OverflowError) as error:  # fmt: skip
        raise ParameterError(f"it holds no result: {shown(str(error), 200)}") from None


def _load(value: Any, types: Mapping[str, type]) -> Any:
    if isinstance(value, list):
        return [_load(entry, types) for entry in value]
    if not isinstance(value, dict):
        return value
    kind, inside = value[_KIND], value[_OF]
    if kind == "tuple":
        return tuple(_load(entry, types) for entry in inside)
    if kind == "dict":
        return {_load(key, types): _load(entry, types) for key, entry in inside}
    if kind in ("array", "number"):
        array = _load_array(*inside)
        return array if kind == "array" else array[()]
    if kind not in types:
        raise ValueError(f"a result of kind {shown(kind)}")
    if list(inside) != [f.name for f in dataclasses.fields(types[kind])]:
        raise ValueError(f"other fields than those of {kind}")
    instance = object.__new__(types[kind])
    for name, entry in inside.items():
        object.__setattr__(instance, name, _load(entry, types))
    return instance


def _load_array(kind: str, shape: list[int], order: str, text: str) -> np.ndarray:
    dtype, packed = np.dtype(kind), base64.b64decode(text, validate=True)
    if dtype.kind not in _NUMBERS or order not in ("C", "F"):
        raise ValueError(f"an array of {shown(kind)}")
    size = dtype.itemsize
    for number in shape:
        size *= number
    check_room(size, len(packed))
    data = zlib.decompressobj().decompress(packed, size + 1)
    if min(shape, default=0) < 0 or len(data) != size:
        raise ValueError(f"an array of shape {shown(shape)} with {len(data)} bytes")
    return np.frombuffer(bytearray(data), dtype).reshape(shape, order=order)
