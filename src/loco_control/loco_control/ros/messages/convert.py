# SPDX-License-Identifier: Apache-2.0
"""Conversion of the dataclasses of `loco_control.types` to CDR bytes and back, by field name."""

from __future__ import annotations

import dataclasses
from functools import lru_cache
from operator import attrgetter
from typing import Any, TypeVar

import numpy as np

from ... import types
from .codec import Codec
from .plain import message_class

T = TypeVar("T")

TICK = slice(12, 20)  # bytes of the tick in every message that has one: after header and stamp
SHAPES = {"grf": (4, 3), "foot_position": (4, 3), "foot_velocity": (4, 3)}
_MESSAGES = {
    cls: message_class(f"loco_msgs/msg/{cls.__name__}")
    for cls in (
        types.RobotState,
        types.GaitTarget,
        types.MotionCommand,
        types.Stance,
        types.TrunkTorque,
        types.LearningState,
    )
}


# Caches by class, since all nodes of a process receive the same bytes: the newest message that
# was decoded, and the newest that was finite.
_LAST: dict[type, tuple[bytes, Any]] = {}
_FINITE: dict[type, bytes] = {}


class Converter:
    """Packs one dataclass into the bytes of its message, and unpacks it.

    Args:
        cls: Dataclass of `loco_control.types` that has a message of its name.
    """

    def __init__(self, cls: type):
        self.cls = cls
        self.codec = Codec(_MESSAGES[cls]())
        self._record = self.codec.record()
        names = [f.name for f in dataclasses.fields(cls)]
        names = names[2:]  # without tick and t, the first fields of every class
        # Views are created once: looking up a field of a record takes as long as writing it.
        self._views = [(attrgetter(name), self._reshape(name)) for name in names]
        self._tick = field_view(self._record, "tick")
        self._stamp = stamp_views(self._record, "stamp")
        at = self.codec.dtype.names.index
        self._head = at("stamp.sec"), at("stamp.nanosec"), at("tick")
        self._fields = [(at(name), SHAPES.get(name)) for name in names]

    def _reshape(self, name: str) -> np.ndarray:
        view = field_view(self._record, name)
        return view.reshape(SHAPES.get(name, view.shape))

    def pack(self, value: Any) -> bytes:
        """Serialised message of `value`."""
        write_stamp(self._stamp, value.t)
        self._tick[...] = value.tick
        for get, view in self._views:
            view[...] = get(value)
        return self._record.tobytes()

    def read(self, data: bytes) -> Any:
        """Dataclass of serialised bytes; nodes of one process share one instance per message."""
        last = _LAST.get(self.cls)
        if last is not None and last[0] == data:
            return last[1]
        value = self.unpack(self.codec.decode(data))
        _LAST[self.cls] = (data, value)
        return value

    def finite(self, data: bytes, value: Any) -> bool:
        """Whether all doubles of a message are finite.

        Checks all words of eight bytes from the stamp on at once: doubles are aligned to them, and
        the other contents (stamp, tick, booleans) never have the exponent of infinity.
        """
        if _FINITE.get(self.cls) is data:
            return True
        doubles = np.frombuffer(data, np.float64, len(data) - 4 >> 3, 4)
        finite = bool(np.logical_and.reduce(np.isfinite(doubles)))
        if finite:
            _FINITE[self.cls] = data
        return finite

    def unpack(self, record: np.ndarray) -> Any:
        """Dataclass of a decoded record."""
        row = record.item()  # a tuple of all fields: one call instead of one per field
        seconds, nanoseconds, tick = (row[i] for i in self._head)
        values = [row[i].reshape(shape) if shape else row[i] for i, shape in self._fields]
        return self.cls(tick, (seconds * 1_000_000_000 + nanoseconds) / 1e9, *values)


def blank(cls: type) -> Any:
    """A message of zeros in received form; a first step with it compiles the kernels."""
    converter = Converter(cls)
    return converter.unpack(converter.codec.decode(converter.codec.template))


def field_view(record: np.ndarray, path: str) -> np.ndarray:
    """Writable view of one field of a record, of shape () for a number."""
    return record.reshape(1)[path][0:1].reshape(record[path].shape)


def block_view(record: np.ndarray, path: str, count: int) -> np.ndarray:
    """Writable view of `count` doubles that begin with the field at `path`, shape (count,)."""
    at = record.dtype.fields[path][1]
    return record.reshape(1).view(np.uint8)[at : at + 8 * count].view(np.float64)


def stamp_views(record: np.ndarray, path: str) -> tuple[np.ndarray, np.ndarray]:
    """Views of seconds and nanoseconds of the time field at `path`."""
    return field_view(record, path + ".sec"), field_view(record, path + ".nanosec")


def write_stamp(views: tuple[np.ndarray, np.ndarray], t: float) -> None:
    """Write a simulated time [s] into the views of a time field."""
    views[0][...], views[1][...] = _split(t)


@lru_cache(maxsize=8)  # cached: all messages of a tick have the same time
def _split(t: float) -> tuple[int, int]:
    return divmod(round(t * 1e9), 1_000_000_000)
