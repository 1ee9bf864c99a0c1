# SPDX-License-Identifier: Apache-2.0
"""Readings that a log repeats in row after row until the next one arrives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..record import JOINT_SIGNALS, Doubt
from ..tracks import Track
from .params import STALE


def fresh(tracks: Sequence[Track], notes: list[str]) -> list[Track]:
    """Tracks of which each reading is kept once, in the row in which it is new.

    A log that is written faster than signals are read repeats all of a reading together.

    Args:
        tracks: Signals of a file.
        notes: List to which a sentence is appended if readings are left out.
    """
    result = list(tracks)
    measured = [k for k, track in enumerate(tracks) if track.role in JOINT_SIGNALS]
    while measured:
        t = tracks[measured[0]].t
        group = [k for k in measured if np.array_equal(tracks[k].t, t)]
        measured = [k for k in measured if k not in group]
        rows = _new_rows([tracks[k].x for k in group])
        if not len(rows) or not np.all(np.diff(t) > 0.0):  # else rows are repeated, not readings
            continue
        for k in group:
            result[k] = replace(tracks[k], t=t[rows], x=tracks[k].x[rows])
        roles = ", ".join(dict.fromkeys(tracks[k].role for k in group))
        rates = (1.0 / float(np.median(np.diff(each))) for each in (t[rows], t))
        text = "{}: readings of {:.4g} Hz, repeated in rows of {:.4g} Hz: each was kept once"
        notes.append(Doubt(text.format(roles, *rates)))
    return result


def _new_rows(signals: Sequence[np.ndarray]) -> np.ndarray:
    """Rows with a new reading of signals that were read together; empty if rows do not repeat.

    Signals that move by one step of an encoder at a time repeat as well, at no rate of their own.
    """
    steps = [np.abs(np.diff(x)) for x in signals]
    rows = 1 + np.flatnonzero(np.any([step > 0.0 for step in steps], axis=0))
    if len(rows) < STALE.fewest:
        return rows[:0]
    gaps = np.diff(rows)
    usual = float(np.median(gaps))
    if gaps.min() < 2 or np.mean(np.abs(gaps - usual) > STALE.uneven * usual) > STALE.rare:
        return rows[:0]
    sizes = [step[step > 0.0] for step in steps if step.any()]
    varied = any(np.std(size) > STALE.varies * np.mean(size) for size in sizes)
    return rows if varied else rows[:0]
