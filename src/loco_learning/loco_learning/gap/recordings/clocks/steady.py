# SPDX-License-Identifier: Apache-2.0
"""Correction of arrival time stamps: the even clock by which signals were read or commanded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..record import Doubt
from ..tracks import INPUTS, Track, quantum
from . import ticks
from .params import LINES, TICKS


def steadied(tracks: Sequence[Track], notes: list[str]) -> list[Track]:
    """Signals with the time stamps of the even clock by which they were read or commanded.

    A log may stamp a reading when it arrives, with a variable delay. The earliest stamps then lie
    on a line over the count of readings, an edge of the lower hull (Moon, Skelly and Towsley 1999),
    and the others above it. Readings that were dropped are counted too. Stamps without such a line
    are kept; so are stamps along which the motion is as smooth as along the line, since a program
    that reads unevenly but stamps at once has correct stamps.

    Args:
        tracks: Signals in the order of their time stamps.
        notes: List to which a sentence is appended for each corrected clock.
    """
    clocks: dict[tuple[bytes, bool], list[Track]] = {}
    for track in tracks:
        if track.role not in INPUTS:
            clocks.setdefault(_clock_of(track), []).append(track)
    lines = {stamps: even_clock(group[0].t) for (stamps, _), group in clocks.items()}
    moved = {}
    for key, group in clocks.items():
        even = lines[key[0]]
        if even is not None and _smoother(group, even):
            moved[key] = even
            late = 1e3 * (group[0].t - even)
            notes.append(
                Doubt(
                    f"{', '.join(dict.fromkeys(t.role for t in group))}: stamps are up to "
                    f"{late.max():.2f} ms late, {late.mean():.2f} ms on average, on readings "
                    f"{1e3 * np.diff(even).min():.4g} ms apart, and were put back"
                )
            )
    return [replace(k, t=moved[_clock_of(k)]) if _clock_of(k) in moved else k for k in tracks]


def _clock_of(track: Track) -> tuple[bytes, bool]:
    """Time stamps as bytes, and whether they are of a command, which may be sent on a reading."""
    return track.t.tobytes(), track.role.startswith("command_") or track.role in INPUTS


def even_clock(t: np.ndarray) -> np.ndarray | None:
    """Even times [s] below all time stamps; None if the stamps have no such line or are even."""
    if len(t) < LINES.fewest or np.any(np.diff(t) < 0.0) or not t[-1] > t[0]:
        return None  # `align` reports the problem
    count = _count(t)
    period = _period(t, count)
    late = t - period * count
    round_one, (slope, error) = _round_period(period), _slope(late, count)
    if abs(round_one - period - slope) < error:
        late, period = t - round_one * count, round_one
    late -= np.min(late)
    minima = [part.min() for part in np.array_split(late, LINES.parts)]
    if max(minima) > LINES.on_line * period or np.ptp(late) < LINES.even * period:
        return None
    return t - late


def _count(t: np.ndarray) -> np.ndarray:
    """Number of each reading, (K,), with those between that were dropped.

    Readings are numbered one by one where some are not nearest to a period of their own.
    """
    step = np.diff(t)
    if not np.median(step) > 0.0:
        return np.arange(len(t), dtype=float)
    period = ticks.period(t)
    lengths = np.round(step / period)
    error = np.sqrt(np.mean((step / period - lengths) ** 2))
    if error > TICKS.dropped or np.any(lengths < 1.0):
        lengths = np.ones(len(step))
    return np.concatenate([[0.0], np.cumsum(lengths)])


def _period(t: np.ndarray, count: np.ndarray) -> float:
    """Slope [s] of the lower hull of time stamps over their count, at half of the count."""
    hull: list[int] = []
    for k in range(len(t)):
        while len(hull) > 1 and (t[hull[-1]] - t[hull[-2]]) * (count[k] - count[hull[-1]]) >= (
            t[k] - t[hull[-1]]
        ) * (count[hull[-1]] - count[hull[-2]]):
            hull.pop()
        hull.append(k)
    index = max(1, int(np.searchsorted(count[hull], 0.5 * count[-1])))
    a, b = hull[index - 1], hull[index]
    return float((t[b] - t[a]) / (count[b] - count[a]))


def _round_period(period: float) -> float:
    """Period [s] of the closest rate that is a multiple of 10 Hz; unchanged below 10 Hz."""
    return 1.0 / (10.0 * round(0.1 / period)) if 0.0 < period < 0.1 else period


def _slope(late: np.ndarray, count: np.ndarray) -> tuple[float, float]:
    """Drift of the earliest readings of the parts of a record and its error [s per reading]."""
    parts = np.array_split(np.arange(len(late)), LINES.parts)
    rows = [part[np.argmin(late[part])] for part in parts]
    at = count[rows] - np.mean(count[rows])
    deviation = late[rows] - np.mean(late[rows])
    slope = float(at @ deviation / (at @ at))
    variance = float(np.sum(np.square(deviation - slope * at))) / (len(rows) - 2)
    return slope, LINES.sure * float(np.sqrt(variance / (at @ at))) + LINES.rounding / len(late)


def _smoother(tracks: Sequence[Track], even: np.ndarray) -> bool:
    """True if readings are closer to the line between neighbours with even times than with stamps.

    Either more often or by more, since a joint that mostly rests informs by its few movements only.
    Where both lines differ by less than a step of the encoder, rounding hides uneven times.
    """
    t, gain, variance, wins, count = tracks[0].t, 0.0, 0.0, 0, 0
    span = t[2:] - t[:-2]
    number = np.round((even - even[0]) / np.diff(even).min())
    middle = (number[1:-1] - number[:-2]) / (number[2:] - number[:-2])  # where none was dropped
    share = np.where(span > 0.0, (t[1:-1] - t[:-2]) / np.where(span > 0.0, span, 1.0), middle)
    for track in tracks:
        x, rise = track.x, track.x[2:] - track.x[:-2]
        resolved = np.abs((share - middle) * rise) > (quantum(track) or 0.0)
        if not resolved.any():
            continue
        errors = [np.square(x[1:-1] - x[:-2] - part * rise)[resolved] for part in (share, middle)]
        size = float(np.mean(errors))
        wins += int(np.sum(errors[1] < errors[0]))
        count += int(np.sum(errors[1] != errors[0]))
        if size > 0.0:
            gain += float(np.sum(errors[0] - errors[1])) / size
            variance += float(np.sum(np.square(errors[0] - errors[1]))) / size**2
    return gain > LINES.sure * np.sqrt(variance) or wins - 0.5 * count > LINES.sure * np.sqrt(count)
