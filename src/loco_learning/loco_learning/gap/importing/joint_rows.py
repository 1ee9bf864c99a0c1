# SPDX-License-Identifier: Apache-2.0
"""Tables with a row for each joint, made into tables with a column for each joint."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from . import foreign

# Name of a column that says of which joint its row is, such as motor_id.
_NAME = re.compile(
    r"(?:motor|joint|servo|axis|actuator|drive|dxl)s?"
    r"[_ .]?(?:ids?|names?|index|idx|number|nr|no)?|id",
    re.IGNORECASE,
)
_ID = re.compile(r"\d+|[^\W\d]\w*")
_CLOCK = re.compile(
    r".*(?:time|zeit|stamp|clock|secs?\b|seconds|millis|micros).*|t|ts|[mun]?s", re.IGNORECASE
)
MAX_JOINTS = 64  # joints whose rows take turns (taste)
MIN_ROWS = 4  # rows of each joint (taste)
IN_TURN = 0.9  # share of rows that are followed by a row of the same joint as others (taste)
RISING = 0.9  # share of the steps of a clock or counter that go on (taste)

Cells = Mapping[str, Sequence[Any]]


def divided(cells: Cells, number: Callable[[Any], float | None]) -> tuple[Cells, tuple[str, ...]]:
    """Columns divided by the joint of each row, empty in the rows of others, and a note.

    Joints take turns, as on a bus that is polled. Columns of times and counters, and those that do
    not change, stay whole. Columns of other tables are not changed.

    Args:
        cells: Cells of each column.
        number: Number of a cell, also of a date; NaN if it is empty, None if it is a text.
    """
    name = next((name for name, ids in cells.items() if _NAME.fullmatch(name.strip())
                 and _take_turns([str(x).strip() for x in ids])), None)  # fmt: skip
    if name is None:
        return cells, ()
    ids = [str(x).strip() for x in cells[name]]
    joints = list(dict.fromkeys(ids))
    if len(cells) * len(joints) > foreign.MOST_COLUMNS:
        return cells, ()
    result: dict[str, Sequence[Any]] = {}
    for column, values in cells.items():
        if column == name:
            continue
        if _is_shared(column, values, number):
            result[column] = values
            continue
        for joint in joints:
            pairs = zip(values, ids, strict=True)
            result[f"{column}.{joint}"] = [x if i == joint else "" for x, i in pairs]
    example = next((x for x in result if x not in cells), "")
    text = f"{name} says the joint of each row ({', '.join(joints)}): columns such as {example!r}"
    return result, (text,)


def _take_turns(ids: Sequence[str]) -> bool:
    """True if rows are of a few joints that take turns, each followed by the same one."""
    counts = Counter(ids)
    if not 1 < len(counts) <= MAX_JOINTS or min(counts.values()) < MIN_ROWS:
        return False
    if not all(map(_ID.fullmatch, counts)):
        return False
    pairs = Counter(zip(ids, ids[1:]))  # noqa: B905  (pairs of neighbours)
    usual: dict[str, int] = {}
    for (first, second), count in pairs.items():
        if first != second:
            usual[first] = max(usual.get(first, 0), count)
    return sum(usual.values()) > IN_TURN * (len(ids) - 1)


def _is_shared(name: str, values: Sequence[Any], number: Callable[[Any], float | None]) -> bool:
    """True for a clock, a counter, and what is the same in all rows.

    A clock may stand still from one joint to the next, if the name says that it is one.
    """
    if len({*map(str, values)}) == 1:
        return True
    numbers = [number(x) for x in values]
    if None in numbers:
        return False
    steps = np.diff(np.array(numbers, dtype=float))
    goes_on = steps >= 0.0 if _CLOCK.fullmatch(name.strip()) else steps > 0.0
    return bool(np.mean(goes_on) > RISING)
