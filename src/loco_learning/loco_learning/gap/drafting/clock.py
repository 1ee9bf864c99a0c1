# SPDX-License-Identifier: Apache-2.0
"""Column of a table that is the time of its rows."""

from __future__ import annotations

import numpy as np

from ..importing import tables
from ..recordings import units
from . import words
from .lines import quoted

RATES = (5.0, 5e3)  # plausible rates of logs [Hz]; other units of time are rejected (taste)
EVEN = 0.01  # largest difference between steps of a clock, over the step (taste)


def time_column(table: tables.Table) -> tuple[str, float, list[str]]:
    """Name of the time column, empty if there is none, its step [s], and its lines of the mapping.

    Of several columns, those that rise from row to row and that are times by their content are
    preferred. If no name is a time, a column that rises evenly, and does not count rows, is taken.
    """
    candidates: list[tuple[bool, bool, bool, str, float, list[str]]] = []
    for name, values in table.columns.items():
        is_clock = name in table.clocks
        unit, finite = "s" if is_clock else words.time_unit(name), values[np.isfinite(values)]
        is_named = unit is not None
        if len(finite) < 3 or np.mean(np.diff(finite) >= 0.0) < 0.9:
            continue
        if not is_named and (words.counts(name) or not _rises_evenly(finite)):
            continue
        step = float(np.median(np.diff(finite)))
        fits = [
            u for u in ("s", "ms", "us", "ns")
            if step > 0.0 and RATES[0] <= 1.0 / (step * units.factor(u)) <= RATES[1]
        ]  # fmt: skip
        if not is_named and not fits:
            continue
        symbol = unit or (fits or ["s"])[0]
        rate = 1.0 / (step * units.factor(symbol)) if step > 0.0 else 0.0
        comment = f"rises by {step:.6g}, {rate:.4g} Hz" if rate else "does not rise in most rows"
        counts = not unit and np.all(np.diff(finite) == 1.0)
        comment += "; or a count of rows? Then say the rate: time: {rate: }" * bool(counts)
        comment += "" if is_named else ", and no name is a time: this?"
        line = f"time: {{column: {quoted(name)}, unit: {symbol}}}  # {comment}"
        step *= units.factor(symbol)
        candidates.append((is_named, step > 0.0, is_clock, name, step, [line]))
    if candidates:
        return max(candidates, key=lambda entry: entry[:3])[3:]
    msg = next((msg for name, msg in table.texts.items() if words.time_unit(name) is not None), "")
    msg = " ".join((msg or "no column of times").split())
    return "", 0.0, [f"# time: {{rate: }}  # {msg}: add this line with the rate of the log in Hz"]


def _rises_evenly(values: np.ndarray) -> bool:
    """True if values rise by the same step from row to row, but not by 1 as a counter does."""
    steps = np.diff(values)
    return steps.min() > 0.0 and np.ptp(steps) < EVEN * steps.max() and abs(steps[0] - 1.0) > EVEN
