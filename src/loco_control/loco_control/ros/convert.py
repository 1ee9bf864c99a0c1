# SPDX-License-Identifier: Apache-2.0
"""Dataclasses of `loco_control.types` to CDR bytes and back, field by field by name."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

import numpy as np

import loco_msgs.msg
from loco_control import types

from .codec import Codec

T = TypeVar("T")

_SHAPES = {"grf": (4, 3), "foot_position": (4, 3), "foot_velocity": (4, 3)}
_MESSAGES = {
    cls: getattr(loco_msgs.msg, cls.__name__)
    for cls in (
        types.RobotState,
        types.GaitTarget,
        types.MotionCommand,
        types.Stance,
        types.TrunkTorque,
        types.LearningState,
    )
}


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
        self._names = names[2:]  # tick and t come first in every class
        self._arrays = {name: self._record[name].ndim > 0 for name in self._names}
        at = self.codec.dtype.names.index
        self._head = at("stamp.sec"), at("stamp.nanosec"), at("tick")
        self._places = [(at(name), _SHAPES.get(name)) for name in self._names]

    def pack(self, value: Any) -> bytes:
        """Serialised message of `value`."""
        record = self._record
        stamp(record, "stamp", value.t)
        record["tick"] = value.tick
        for name in self._names:
            field = getattr(value, name)
            record[name] = field.reshape(-1) if self._arrays[name] else field
        return record.tobytes()

    def unpack(self, record: np.ndarray) -> Any:
        """Dataclass of a decoded record."""
        row = record.item()  # a tuple of all fields: one call instead of one per field
        seconds, nanoseconds, tick = (row[i] for i in self._head)
        values = [row[i].reshape(shape) if shape else row[i] for i, shape in self._places]
        return self.cls(tick, (seconds * 1_000_000_000 + nanoseconds) / 1e9, *values)


def stamp(record: np.ndarray, path: str, t: float) -> None:
    """Write a simulated time [s] into the time field at `path`."""
    record[path + ".sec"], record[path + ".nanosec"] = divmod(round(t * 1e9), 1_000_000_000)
