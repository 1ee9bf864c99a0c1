# SPDX-License-Identifier: Apache-2.0
"""Ticks at absolute times, and how late they begin.

Tick n is due n periods after the start, on the clock that nobody can set. Nothing adds up:
a tick that began late does not move the next one.
"""

from __future__ import annotations

import ctypes
import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

_LIBC = ctypes.CDLL(None, use_errno=True)
_CLOCK_MONOTONIC, _TIMER_ABSTIME = 1, 1
_FINE, _PER_DECADE, _DECADES = 1e-6, 100, 7  # bins of lateness: from 1 µs to 10 s, 2.3 % each


class Lateness:
    """Lateness of ticks, as counts in bins, so that a long run takes no more memory.

    Attributes:
        worst: The latest [s].
    """

    def __init__(self) -> None:
        self._counts = np.zeros(_PER_DECADE * _DECADES + 1, dtype=np.int64)
        self.worst = 0.0

    def add(self, late: float) -> None:
        """A tick began so late [s]."""
        self.worst = max(self.worst, late)
        bin_ = math.log10(max(late, _FINE) / _FINE) * _PER_DECADE
        self._counts[min(int(bin_), len(self._counts) - 1)] += 1

    def quantile(self, share: float) -> float:
        """Lateness that this share of the ticks does not pass [s], to 2.3 %; 0 without ticks."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        bin_ = int(np.searchsorted(np.cumsum(self._counts), share * total))
        return min(_FINE * 10.0 ** ((bin_ + 1) / _PER_DECADE), self.worst)


class Deadlines:
    """When ticks are due, at a rate that does not drift.

    After a stall the ticks that were missed are made up at once, `catch_up` at most. The
    others are dropped: the ticks after them are due that much later.

    Args:
        rate: Ticks per second [Hz].
        catch_up: Ticks that are made up after one stall, at most.
        clock: Time [s] that only grows.

    Attributes:
        lateness: Lateness of all ticks [s].
        missed: Ticks that began a period or more too late.
        dropped: Ticks that were left out.
    """

    def __init__(self, rate: float, catch_up: int, clock: Callable[[], float] = time.monotonic):
        self._rate, self._catch_up, self._clock = rate, catch_up, clock
        self.lateness = Lateness()
        self.missed = self.dropped = 0
        self._start, self._tick = clock(), 0

    @property
    def next(self) -> float:
        """When the next tick is due [s]."""
        return self._start + (self._tick + 1) / self._rate

    def due(self) -> int:
        """The number of ticks to be done now; they count as done."""
        late = self._clock() - self.next
        if late < 0.0:
            return 0
        ticks = int(late * self._rate) + 1
        self.missed += ticks - 1
        if ticks > self._catch_up:
            dropped, ticks = ticks - self._catch_up, self._catch_up
            self.dropped += dropped
            self._start += dropped / self._rate
        for k in range(ticks):
            self.lateness.add(late - k / self._rate)
        self._tick += ticks
        return ticks

    def report(self) -> dict[str, Any]:
        """Figures for /diagnostics, since the start."""
        late = self.lateness
        return {
            "lateness_p50_ms": 1e3 * late.quantile(0.5),
            "lateness_p99_ms": 1e3 * late.quantile(0.99),
            "lateness_max_ms": 1e3 * late.worst,
            "missed_ticks": self.missed,
            "dropped_ticks": self.dropped,
        }


class _Timespec(ctypes.Structure):
    _fields_ = (("seconds", ctypes.c_long), ("nanoseconds", ctypes.c_long))


def sleep_until(deadline: float) -> None:
    """Sleep until a time of `time.monotonic` [s], or until a signal."""
    seconds = int(deadline)
    until = _Timespec(seconds, int((deadline - seconds) * 1e9))
    _LIBC.clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(until), None)
