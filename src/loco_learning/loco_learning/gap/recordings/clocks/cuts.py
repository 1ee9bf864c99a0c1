# SPDX-License-Identifier: Apache-2.0
"""Division of records where their clock was set back, and where angles and commands pause."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loco_control.exceptions import ParameterError

from ..record import Doubt
from ..tracks import Track
from .params import CUTS


def parts(
    name: str, tracks: Sequence[Track], fewest: int, shortest: float = 0.0
) -> tuple[list[list[Track]], list[str]]:
    """Divide tracks where a model cannot follow them, with a sentence for each cut and loss.

    Args:
        name: Name of the record, for messages.
        tracks: Signals in the order in which they were written.
        fewest: Smallest number of readings of an angle in a part; shorter parts are left out.
        shortest: Shortest time of these readings [s].

    Raises:
        ParameterError: The clocks of some signals were set back, those of others were not.
    """
    tracks, stray = _put_between(tracks)
    segments, notes = _set_back(name, tracks)
    notes = [*stray, *notes]
    for segment in segments:
        notes += _pauses(segment)
    segments = [part for segment in segments for part in _between_pauses(segment)]
    sizes = [max((len(k.t) for k in part if k.role == "q"), default=0) for part in segments]
    spans = [max((_span(k.t) for k in part if k.role == "q"), default=0.0) for part in segments]
    brief = [n < fewest or time < shortest for n, time in zip(sizes, spans, strict=True)]
    if all(brief):
        return segments, notes
    for i, (size, time, short) in enumerate(zip(sizes, spans, brief, strict=True), 1):
        reason = (
            f"has {size} readings, fewer than {fewest}"
            if size < fewest
            else (f"lasts {time:.3g} s, less than {shortest:g} s")
        )
        notes += [Doubt(f"part {i} {reason}, and was left out")] * short
    return [part for part, short in zip(segments, brief, strict=True) if not short], notes


def _span(t: np.ndarray) -> float:
    """Time between the first and the last stamp [s]."""
    valid = t[np.isfinite(t)]
    return float(np.ptp(valid)) if len(valid) else 0.0


def _put_between(tracks: Sequence[Track]) -> tuple[list[Track], list[str]]:
    """Tracks with stray stamps put between their neighbours, and a sentence on them.

    A few rows whose stamps go back, while those of the next rows go on as if nothing had been, are
    no clock that was set back: a logger may read the seconds before the milliseconds.
    """
    clocks: dict[bytes, list[Track]] = {}
    for track in tracks:
        clocks.setdefault(track.t.tobytes(), []).append(track)
    times: dict[bytes, np.ndarray] = {}
    notes = []
    for stamps, group in clocks.items():
        t, count, furthest = group[0].t.copy(), 0, 0.0
        usual = float(np.median(np.abs(np.diff(t)))) if len(t) > 1 else 0.0
        for row in cut_rows(group):
            ahead = np.flatnonzero(t[row : row + CUTS.run] > t[row - 1])
            stop = row + int(ahead[0]) if len(ahead) else row
            periods = (t[stop] - t[row - 1]) / max(usual, 1e-300)
            if stop > row and stop - row + 0.5 < periods < CUTS.silence:
                furthest = max(furthest, float(t[row - 1] - np.min(t[row:stop])))
                t[row:stop] = np.linspace(t[row - 1], t[stop], stop - row + 2)[1:-1]
                count += stop - row
        if count:
            notes.append(
                Doubt(
                    f"{count} stamps of {group[0].label} go back, by up to {furthest:.3g} s, and "
                    "those after them go on: they were put between their neighbours"
                )
            )
        times[stamps] = t
    return [replace(track, t=times[track.t.tobytes()]) for track in tracks], notes


def _set_back(name: str, tracks: Sequence[Track]) -> tuple[list[list[Track]], list[str]]:
    """Divide tracks where their clock was set back, with a sentence for each cut.

    A late reading is later sorted between its neighbours. Readings of two stretches of motion must
    not be interleaved, since the result would be a motion that did not occur.

    Raises:
        ParameterError: The clocks of some signals were set back, those of others were not.
    """
    clocks: dict[bytes, list[Track]] = {}
    for track in tracks:
        clocks.setdefault(track.t.tobytes(), []).append(track)
    cuts = {stamps: cut_rows(group) for stamps, group in clocks.items()}
    first = max(cuts, key=lambda stamps: len(cuts[stamps]), default=b"")
    if not cuts.get(first):
        return [list(tracks)], []
    t, label = clocks[first][0].t, clocks[first][0].label
    jumps = [(t[row - 1], t[row]) for row in cuts[first]]
    messages = [
        f"the time of {label} jumps back by {high - low:.6g} s at row {row}"
        for row, (high, low) in zip(cuts[first], jumps, strict=True)
    ]
    segments: list[list[Track]] = [[] for _ in range(len(jumps) + 1)]
    for track in tracks:
        rows = cuts[track.t.tobytes()] or _between(track.t, jumps)
        if len(rows) != len(jumps):
            raise ParameterError(
                f"{name}: {messages[0]}, that of {track.label} does not: are there several "
                "experiments in one file, or clocks of two machines? Cut them with rows: "
                "[first, stop], or leave the stretch out with from and to"
            )
        for part, start, stop in zip(segments, [0, *rows], [*rows, len(track.t)], strict=True):
            part.append(replace(track, t=track.t[start:stop], x=track.x[start:stop]))
    return segments, [Doubt(f"{text}: cut there") for text in messages]


def _pauses(tracks: Sequence[Track]) -> list[str]:
    """A sentence for each pause of angles and commands."""
    first = next((k for k in tracks if k.role == "q"), None)
    notes = []
    for start, stop in pauses(tracks):
        row = int(np.sum(first.t <= start)) if first else 0
        if stop - start <= CUTS.pause:
            notes.append(
                Doubt(
                    f"the time of {first.label} jumps forward by {stop - start:.6g} s at row "
                    f"{row}, over which its motion goes on: its clock was set forward, cut there"
                )
            )
            continue
        notes.append(
            Doubt(
                f"angles and commands pause for {stop - start:.6g} s at row {row} of {first.label}: "
                "cut there, as nobody knows what was commanded"
            )
        )
    return notes


def _between_pauses(tracks: Sequence[Track]) -> list[list[Track]]:
    edges = [0.5 * (start + stop) for start, stop in pauses(tracks)]
    parts: list[list[Track]] = []
    for low, high in zip([-np.inf, *edges], [*edges, np.inf], strict=True):
        masks = [(k, (k.t > low) & (k.t <= high) | ~np.isfinite(k.t)) for k in tracks]
        parts.append([replace(k, t=k.t[rows], x=k.x[rows]) for k, rows in masks])
    return parts if edges else [list(tracks)]


def pauses(tracks: Sequence[Track]) -> list[tuple[float, float]]:
    """Start and end of pauses [s], in order, without any angle reading or command.

    A signal that is typically silent for that long does not pause. Shorter gaps are included if the
    clock was set forward there.
    """
    clocks = {k.t.tobytes(): k.t for k in tracks if k.role == "q" or k.role.startswith("command_")}
    common, shortest = [(-np.inf, np.inf)], 0.0
    for t in clocks.values():
        stamps = np.unique(t[np.isfinite(t)])
        step = np.diff(stamps)
        if len(step) < CUTS.run:
            return []
        shortest = max(shortest, CUTS.silence * float(np.median(step)))
        rows = np.flatnonzero(step > shortest)
        gaps = list(zip(stamps[rows].tolist(), stamps[rows + 1].tolist(), strict=True))
        common = [(max(a, c), min(b, d)) for a, b in common for c, d in gaps]
        common = [(start, stop) for start, stop in common if stop > start]
    return [
        (start, stop)
        for start, stop in common
        if shortest < stop - start < np.inf
        and (stop - start > CUTS.pause or set_forward(tracks, start, stop))
    ]


def set_forward(tracks: Sequence[Track], start: float, stop: float) -> bool:
    """True if positions go on over a gap in their stamps [s] as from one reading to the next.

    Parabolas through readings on both sides of the gap fit without it as well as elsewhere, and
    with it do not.
    """
    misfits = []
    for track in tracks:
        if track.role != "q" or not np.all(np.isfinite(track.x)) or np.ptp(track.x) == 0.0:
            continue
        order = np.argsort(track.t, kind="stable")
        t, x = track.t[order], track.x[order]
        row, count = int(np.searchsorted(t, start, side="right")), CUTS.around
        if not count <= row <= len(t) - count:
            return False
        even = _beside_parabola(np.arange(2.0 * count))
        windows = np.lib.stride_tricks.sliding_window_view(x, 2 * count)
        usual = np.percentile(np.linalg.norm(windows @ even, axis=1), 95.0)
        usual = max(float(usual), 1e-9 * float(np.ptp(x)))
        window = slice(row - count, row + count)
        real = _beside_parabola(t[window] - t[row])
        misfits.append([float(np.linalg.norm(x[window] @ by)) / usual for by in (real, even)])
    return bool(misfits) and (
        max(real for real, _ in misfits) > CUTS.misfit
        and max(even for _, even in misfits) < CUTS.continues
    )


def _beside_parabola(t: np.ndarray) -> np.ndarray:
    """Matrix (K, K) that leaves of values at K times what no parabola through them explains."""
    basis, _ = np.linalg.qr(np.stack([t**0, t, t**2], axis=1))
    return np.eye(len(t)) - basis @ basis.T


def cut_rows(tracks: Sequence[Track]) -> list[int]:
    """Rows at which the common clock of some tracks was set back, in order.

    Readings that fit better in the order of their time stamps were delivered late and are no cut.
    """
    t = tracks[0].t
    if len(t) < CUTS.run or not np.all(np.isfinite(t)):
        return []
    moving = [k.x for k in tracks if np.all(np.isfinite(k.x)) and np.ptp(k.x) > 0.0]
    usual, cuts, start = float(np.median(np.abs(np.diff(t)))), [], 0
    for row in np.flatnonzero(np.diff(t) < 0.0) + 1:
        latest = float(t[start:row].max())
        if t[row] >= latest or t[row - 1] - t[row] <= CUTS.late * usual:
            continue
        ahead = np.flatnonzero(t[row:] > latest)
        stop = row + int(ahead[0]) if len(ahead) else len(t)
        overlap = start + np.flatnonzero(t[start:row] >= t[row])
        if stop - row < CUTS.run:
            cut = _misfit(t[start:], [x[start:] for x in moving], row - start, stop - start)
        else:
            rows = np.arange(max(int(overlap[0]) - 1, start), min(stop + 1, len(t)))
            order = rows[np.argsort(t[rows], kind="stable")]
            longer = [_path(x[order]) / max(_path(x[rows]), 1e-12 * np.ptp(x)) for x in moving]
            cut = sum(longer) >= len(longer)
        if cut:
            cuts.append(int(row))
            start = int(row)
    return cuts


def _path(x: np.ndarray) -> float:
    return float(np.sum(np.abs(np.diff(x))))


def _misfit(t: np.ndarray, values: Sequence[np.ndarray], row: int, stop: int) -> bool:
    """True if rows `row` to `stop` are far from the line between the neighbours of their stamps."""
    remaining = np.delete(np.arange(len(t)), np.arange(row, stop))
    remaining = remaining[np.argsort(t[remaining], kind="stable")]
    for x in values:
        line = np.interp(t[row:stop], t[remaining], x[remaining])
        size = np.percentile(np.abs(x[1:-1] - 0.5 * (x[2:] + x[:-2])), 95.0)
        if np.max(np.abs(x[row:stop] - line)) > CUTS.misfit * max(size, 1e-9 * np.ptp(x)):
            return True
    return False


def _between(t: np.ndarray, jumps: Sequence[tuple[float, float]]) -> list[int]:
    """Rows of slow time stamps at the jumps of a faster clock; empty if the clocks differ."""
    cuts, start = [], 0
    for high, low in jumps:
        row = start + int(np.searchsorted(t[start:], low))
        if np.sum((t[start:] >= low) & (t[start:] <= high)) > 1:
            return []
        cuts.append(row)
        start = row
    return cuts
