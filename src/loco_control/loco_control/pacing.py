# SPDX-License-Identifier: Apache-2.0
"""Schedule of ticks at absolute times, and statistics of their lateness.

Tick n is due n periods after the start, on the monotonic clock. Errors do not accumulate:
a late tick does not delay the next one.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np

_FINE, _PER_DECADE, _DECADES = 1e-6, 100, 7  # bins of lateness: from 1 µs to 10 s, 2.3 % each


class Lateness:
    """Histogram of the lateness of ticks, with constant memory.

    Attributes:
        maximum: Largest lateness [s].
    """

    def __init__(self) -> None:
        self._counts = np.zeros(_PER_DECADE * _DECADES + 1, dtype=np.int64)
        self.maximum = 0.0

    def add(self, late: float) -> None:
        """Count a tick that began `late` [s] after it was due."""
        self.maximum = max(self.maximum, late)
        bin_ = math.log10(max(late, _FINE) / _FINE) * _PER_DECADE
        self._counts[min(int(bin_), len(self._counts) - 1)] += 1

    def quantile(self, share: float) -> float:
        """Quantile of the lateness [s], accurate to 2.3 %; `share` in [0, 1]; 0 without ticks."""
        total = int(self._counts.sum())
        if not total:
            return 0.0
        bin_ = int(np.searchsorted(np.cumsum(self._counts), share * total))
        return min(_FINE * 10.0 ** ((bin_ + 1) / _PER_DECADE), self.maximum)


class Deadlines:
    """Due times of ticks at a constant rate, without drift.

    After a stall, up to `catch_up` missed ticks are executed at once. The other missed ticks are
    dropped, and later ticks are due that much later.

    Args:
        rate: Ticks per second [Hz].
        catch_up: Maximum number of missed ticks that are executed after one stall.
        clock: Function that returns a monotonic time [s].

    Attributes:
        lateness: Lateness of all ticks [s].
        missed: Number of ticks that began a period or more too late.
        dropped: Number of ticks that were skipped.
    """

    def __init__(self, rate: float, catch_up: int, clock: Callable[[], float] = time.monotonic):
        self._rate, self._catch_up, self._clock = rate, catch_up, clock
        self.lateness = Lateness()
        self.missed = self.dropped = 0
        self._start, self._tick = clock(), 0

    @property
    def next(self) -> float:
        """Time at which the next tick is due [s]."""
        return self._start + (self._tick + 1) / self._rate

    def due(self) -> int:
        """Number of ticks that are due now; they are counted as executed."""
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
            "lateness_max_ms": 1e3 * late.maximum,
            "missed_ticks": self.missed,
            "dropped_ticks": self.dropped,
        }
