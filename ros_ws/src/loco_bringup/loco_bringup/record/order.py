# SPDX-License-Identifier: Apache-2.0
"""Iterate over the messages of a bag in order of log time, with few chunks in memory."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from loco_control.exceptions import ParameterError

from ..bag.reader import Bag

_COLUMNS = 8  # decompressed chunks in memory


class Order:
    """Iterator over (seconds from the start of the bag, topic, bytes).

    Args:
        bag: The recording.
        names: Topics, as recorded.
        start: Time of the first message [s from the start of the bag].
        end: Time of the last message [s from the start of the bag]; None for no limit.

    Attributes:
        length: Time from the start of the bag to the last selected message [s].
        count: Number of selected messages.

    Raises:
        ParameterError: `start` is outside the bag, or `end` is before `start`.
    """

    def __init__(self, bag: Bag, names: list[str], start: float = 0.0, end: float | None = None):
        length = bag.end - bag.start
        if not 0.0 <= start <= length:
            raise ParameterError(f"start must be within the bag, 0 to {length:.3f} s, got {start}")
        if end is not None and not end >= start:
            raise ParameterError(f"end must not be before start, {start} s, got {end}")
        self._file, self._zero = bag.file, bag.summary.statistics.message_start_time
        self._name = {number: name for name in names for number in bag.channels[name]}
        rows = [self._rows(i, records) for i, records in enumerate(bag.file.blocks())]
        table = np.concatenate(rows) if rows else np.empty((0, 5), np.int64)
        t = (table[:, 0] - self._zero) / 1e9
        table = table[(t >= start) & (t <= (np.inf if end is None else end))]
        self._table = table[np.argsort(table[:, 0], kind="stable")]
        self.count = len(self._table)
        self.length = (self._table[-1, 0] - self._zero) / 1e9 if self.count else 0.0

    def _rows(self, block: int, records) -> np.ndarray:
        """Time, channel, chunk, first byte and end of each selected message, (n, 5)."""
        mask = np.isin(records.channels, list(self._name))
        columns = (
            records.times[mask],
            records.channels[mask],
            np.full(mask.sum(), block, dtype=np.int64),
            records.starts[mask],
            records.stops[mask],
        )
        return np.stack(columns, axis=1)

    def __iter__(self) -> Iterator[tuple[float, str, bytes]]:
        @lru_cache(_COLUMNS)
        def data_of(block: int) -> bytes:
            return self._file.block(block).data

        for time, channel, block, start, stop in self._table.tolist():
            data = data_of(block)
            yield (time - self._zero) / 1e9, self._name[channel], data[start:stop]
