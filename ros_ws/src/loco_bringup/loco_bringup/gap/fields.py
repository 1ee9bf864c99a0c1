# SPDX-License-Identifier: Apache-2.0
"""Read a numeric field of a topic by a path such as ``position[knee]`` or ``data[2]``."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from loco_control.exceptions import BagError, NameUnknownError, ParameterError
from loco_learning.gap.recordings.mapping import Column

from ..bag.reader import Bag
from .joint_states import clock, common_clock, two_publishers

_STEP = re.compile(r"([A-Za-z_]\w*)(?:\[([^\]]+)\])?$")


class FieldSource:
    """Columns of a bag that a mapping names by topic and field.

    Args:
        bag: The recording.
        name: Name of the record.
        topics: Topics whose clock the mapping does not say, of all its columns.

    Attributes:
        notes: Sentences on the clocks of the topics read so far.
    """

    header: dict[str, Any] = {}

    def __init__(self, bag: Bag, name: str, topics: Iterable[str] = ()):
        self._bag, self.name = bag, name
        self._topics = sorted(set(topics) & set(bag.topics))
        self._read: dict[str, tuple[np.ndarray, np.ndarray, list]] = {}
        self.notes: list[str] = []

    def series(self, column: Column) -> tuple[np.ndarray, np.ndarray]:
        """Stamps [s] and values of a field, (K,) each, from the messages that contain the element.

        Raises:
            ParameterError: The mapping names no topic, or no such field.
            NameUnknownError: The bag has no such topic.
        """
        if not column.topic:
            names = ", ".join(sorted(self._bag.topics))
            raise ParameterError(
                f"column {column.column!r} must name its topic in the bag, one of {names}"
            )
        stamps, logged, messages = self._messages(column.topic)
        t = clock(stamps, logged, column.topic, self.notes, column.clock or self._clock())
        steps = [_STEP.match(part) for part in column.column.split(".")]
        if not all(steps):
            raise ParameterError(f"{column.column!r} is no path of a field, e.g. position[knee]")
        rows, values, lacking = [], [], None
        owners: dict[tuple[str, ...], int] = {}
        for row, message in enumerate(messages):
            try:
                value, names = _value(message, steps, column)
            except NameUnknownError as error:  # message of another publisher on the topic
                lacking = error
                continue
            rows.append(row)
            values.append(value)
            owners[names] = owners.get(names, 0) + 1
        if lacking and not rows:
            raise lacking
        if len(owners) > 1:
            sizes = list(owners.values())
            raise BagError(two_publishers(self._bag, column.topic, column.column, sizes))
        return t[rows], np.array(values)

    def _clock(self) -> str:
        """Clock that all topics of the mapping have in common, as in `common_clock`."""
        return common_clock([self._messages(topic)[:2] for topic in self._topics])

    def _messages(self, topic: str) -> tuple[np.ndarray, np.ndarray, list]:
        """Header stamps (0 without a header) and log times [ns], and the messages; read once."""
        if topic not in self._read:
            messages = self._bag.messages(topic)
            if not messages:
                raise BagError(f"{self._bag.path.name} has no message on {topic}")
            stamps = np.array([_stamp(message) for message in messages], dtype=np.int64)
            self._read[topic] = stamps, self._bag.raw(topic)[0], messages
        return self._read[topic]


def _stamp(message: Any) -> int:
    stamp = getattr(getattr(message, "header", message), "stamp", None)
    return 0 if stamp is None else 10**9 * stamp.sec + stamp.nanosec


def _value(message: Any, steps: list[re.Match], column: Column) -> tuple[float, tuple[str, ...]]:
    """A number of a message, and the names in the same list, which identify the publisher."""
    value, names = message, ()
    for step in steps:
        field, index = step.groups()
        fields = getattr(value, "get_fields_and_field_types", dict)()
        if field not in fields:
            raise NameUnknownError(f"field on {column.topic}", field, fields)
        owner, value = value, getattr(value, field)
        if index is not None:
            named = [*(getattr(owner, "name", None) or getattr(owner, "joint_names", None) or ())]
            value = _item(named, value, index, column)
            names = tuple(named) if index.isdigit() else tuple(sorted(named))
    if not isinstance(value, (bool, int, float, np.number)):
        raise ParameterError(f"{column.column} on {column.topic} is no number; name one element")
    return float(value), names


def _item(names: list[str], values: Any, index: str, column: Column) -> Any:
    """Element by index, or by a name listed in the message, as in JointState."""
    if index.isdigit():
        row = int(index)
    elif index in names and len(values):
        row = names.index(index)
    else:
        raise NameUnknownError(f"element of {column.column} on {column.topic}", index, names)
    if row >= len(values):
        raise ParameterError(
            f"{column.column} on {column.topic}: there are {len(values)} elements, numbered from 0"
        )
    return values[row]
