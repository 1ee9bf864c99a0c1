# SPDX-License-Identifier: Apache-2.0
"""Any numeric field of any topic, by a path such as ``position[knee]`` or ``data[2]``."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from loco_control.exceptions import BagError, NameUnknownError, ParameterError
from loco_learning.gap.recordings.mapping import Column

from ..bag.reader import Bag

_STEP = re.compile(r"([A-Za-z_]\w*)(?:\[([^\]]+)\])?$")


class FieldSource:
    """Columns of a bag whose topics a mapping names.

    Args:
        bag: The recording.
        name: Name of the record.
    """

    header: dict[str, Any] = {}

    def __init__(self, bag: Bag, name: str):
        self._bag, self.name = bag, name
        self._read: dict[str, tuple[np.ndarray, list]] = {}

    def series(self, column: Column) -> tuple[np.ndarray, np.ndarray]:
        """Stamps [s] and values of a field, each (K,).

        Raises:
            ParameterError: The mapping names no topic, or no such field.
            NameUnknownError: The bag has no such topic.
        """
        if not column.topic:
            topics = ", ".join(sorted(self._bag.topics))
            raise ParameterError(
                f"column {column.column!r} must name its topic in the bag, one of {topics}"
            )
        if column.topic not in self._read:
            self._read[column.topic] = self._messages(column.topic)
        t, messages = self._read[column.topic]
        steps = [_STEP.match(part) for part in column.column.split(".")]
        if not all(steps):
            raise ParameterError(f"{column.column!r} is no path of a field, e.g. position[knee]")
        return t, np.array([_value(message, steps, column) for message in messages])

    def _messages(self, topic: str) -> tuple[np.ndarray, list]:
        """Stamps of the headers, else times of logging [s], and the messages."""
        messages = self._bag.messages(topic)
        if not messages:
            raise BagError(f"{self._bag.path.name} has no message on {topic}")
        t = self._bag.raw(topic)[0] / 1e9
        stamps = [_stamp(message) for message in messages]
        return (np.array(stamps) if any(stamps) else t), messages


def _stamp(message: Any) -> float:
    stamp = getattr(getattr(message, "header", message), "stamp", None)
    return 0.0 if stamp is None else stamp.sec + 1e-9 * stamp.nanosec


def _value(message: Any, steps: list[re.Match], column: Column) -> float:
    value = message
    for step in steps:
        field, index = step.groups()
        fields = getattr(value, "get_fields_and_field_types", dict)()
        if field not in fields:
            raise NameUnknownError(f"field on {column.topic}", field, fields)
        owner, value = value, getattr(value, field)
        if index is not None:
            value = _item(owner, value, index, column)
    if not isinstance(value, (bool, int, float, np.number)):
        raise ParameterError(f"{column.column} on {column.topic} is no number; name one element")
    return float(value)


def _item(owner: Any, values: Any, index: str, column: Column) -> Any:
    """Element by number, or by a name that the message lists, as JointState does."""
    names = list(getattr(owner, "name", None) or getattr(owner, "joint_names", None) or [])
    if index.isdigit():
        row = int(index)
    elif index in names:
        row = names.index(index)
    else:
        raise NameUnknownError(f"element of {column.column} on {column.topic}", index, names)
    if row >= len(values):
        raise ParameterError(
            f"{column.column} on {column.topic}: there are {len(values)} elements, numbered from 0"
        )
    return values[row]
