# SPDX-License-Identifier: Apache-2.0
"""Signals with their own time stamps at the even times of a record.

Commands act at their stamps, so the times are theirs where they are even. Readings of a motion
are moved from their stamps to the closest time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..tracks import Track
from .params import CUTS, TICKS


def axis(tracks: Sequence[Track], start: float, end: float, rate: float) -> np.ndarray:
    """Even times [s], from the first angle within the common time span; at even commands."""
    stamps = next(k.t for k in tracks if k.role == "q")
    first = stamps[min(np.searchsorted(stamps, start - 1e-9), len(stamps) - 1)]
    command_times = [k.t for k in tracks if k.role.startswith("command_")]
    phase = [(t - command_times[0][0]) * rate for t in command_times]
    if all(np.max(np.abs(p - np.round(p))) <= TICKS.even for p in phase):
        first = command_times[0][0] + round((first - command_times[0][0]) * rate) / rate
    return first + np.arange(max(int((end - first) * rate + 1e-6) + 1, 0)) / rate


def period(t: np.ndarray) -> float:
    """Typical time between time stamps [s]: the mean without gaps.

    Where single readings were dropped the time to the next is a whole number of periods.
    """
    step = np.diff(t)
    usual = step[step <= CUTS.silence * np.median(step)]
    lengths = usual / np.median(step)
    periods = np.round(lengths)
    error = np.sqrt(np.mean((lengths - periods) ** 2))
    return float(np.mean(usual) / (np.mean(periods) if error <= TICKS.dropped else 1.0))


def bridged(tracks: Sequence[Track], rate: float) -> list[Track]:
    """Tracks in which commands that were dropped with a reading are on the line about them.

    They were not held meanwhile, if commands are logged in the rows of the readings and one by one.

    Args:
        tracks: Signals with increasing time stamps.
        rate: Rate of the common axis [Hz].
    """
    rows = {track.t.tobytes() for track in tracks if track.role == "q"}
    return [
        _bridged(track, rate)
        if track.role.startswith("command_") and not track.between and track.t.tobytes() in rows
        and abs(period(track.t) * rate - 1.0) <= TICKS.whole else track
        for track in tracks
    ]  # fmt: skip


def _bridged(track: Track, rate: float) -> Track:
    lengths = np.round(np.diff(track.t) * rate).astype(int)
    lengths[lengths > CUTS.silence] = 1
    row = np.repeat(np.arange(len(track.t)), np.append(lengths, 1).clip(1))
    part = (np.arange(len(row)) - np.searchsorted(row, row)) / np.append(lengths, 1).clip(1)[row]
    following = (row + 1).clip(max=len(track.t) - 1)
    t, x = (v[row] + part * (v[following] - v[row]) for v in (track.t, track.x))
    return replace(track, t=t, x=x)


def hold(track: Track, axis: np.ndarray) -> np.ndarray:
    """Command at each time, (T,): zero-order hold, or interpolated if the track is linear.

    A command acts from the time that is closest to its stamp. From the next time on it would act
    late by half a step on average, and by a whole one where stamps are just behind the times.
    """
    if track.between == "line":
        return np.interp(axis, track.t, track.x)
    margin = (0.5 - TICKS.even) * _step(axis) if len(axis) > 1 else 0.0
    row = np.searchsorted(track.t, axis + margin, side="right") - 1
    return track.x[np.maximum(row, 0)]


def sample(track: Track, axis: np.ndarray) -> np.ndarray:
    """Value at each time, (T,); NaN in gaps, outside, and between samples slower than the axis.

    A reading of a motion is moved to the closest time, with its noise. Other signals, and times
    that are closest to no reading, are interpolated between their neighbours.
    """
    t, x, step = track.t, track.x, _step(axis)
    usual = period(t) if len(t) > 1 else np.inf
    if usual > TICKS.sparse * step:
        times, values = _times(track, axis), np.full(len(axis), np.nan)
        values[times] = _at_readings(track, axis[times], times.step * step)
        return values
    row = np.searchsorted(t, axis + TICKS.even * step, side="right") - 1
    inside = (row >= 0) & (axis <= t[-1] + TICKS.even * step)
    row = row.clip(0, len(t) - 1)
    following = (row + 1).clip(max=len(t) - 1)
    width = t[following] - t[row]
    on = np.abs(axis - t[row]) <= TICKS.even * step
    share = np.where(on | (width <= 0.0), 0.0, (axis - t[row]) / np.where(width > 0.0, width, 1.0))
    value = x[row] + np.where(share > 0.0, share * (x[following] - x[row]), 0.0)
    valid = inside & (on | (width <= CUTS.silence * usual))
    sampled = np.full(len(axis), np.nan)
    if track.role in TICKS.smooth:
        sampled = np.where(on, np.nan, _at_readings(track, axis, step))
    return np.where(np.isfinite(sampled), sampled, np.where(valid, value, np.nan))


def lost(track: Track, axis: np.ndarray) -> np.ndarray:
    """1 at times at which one of the readings on the axis was lost, else 0, (T,).

    The error of interpolating between its neighbours may be far larger than the sensor noise.
    """
    step, flags = _step(axis), np.zeros(len(axis))
    if track.role in TICKS.smooth:
        times = _times(track, axis)
        rows, tick = _closest(track, axis[times], times.step * step)
        on = np.zeros(len(axis[times]), dtype=bool)
        on[tick] = np.isfinite(track.x[rows])
    else:
        times, row = slice(None), np.searchsorted(track.t, axis + TICKS.even * step, side="right")
        on = np.abs(axis - track.t[(row - 1).clip(0)]) <= TICKS.even * step
    flags[times] = np.where(on | (np.mean(on) < TICKS.mostly), 0.0, 1.0)
    return flags


def moved(track: Track, axis: np.ndarray) -> np.ndarray:
    """Time by which `sample` moved the reading at each time [s], (T,); 0 where there is none."""
    late, times = np.zeros(len(axis)), _times(track, axis)
    if track.role in TICKS.smooth:
        rows, tick = _closest(track, axis[times], times.step * _step(axis))
        late[times][tick] = axis[times][tick] - track.t[rows]
    return np.where(np.abs(late) > TICKS.even * times.step * _step(axis), late, 0.0)


def _times(track: Track, axis: np.ndarray) -> slice:
    """Times to which readings belong: all, or evenly spaced ones if readings are slower."""
    step = _step(axis)
    usual = period(track.t) if len(track.t) > 1 else np.inf
    if usual <= TICKS.sparse * step:
        return slice(0, None, 1)
    every = round(min(usual / step, len(axis)))
    if track.role not in TICKS.smooth or abs(usual / step - every) > TICKS.whole * every:
        every = 1  # their times are no even part of the axis
    turns = np.exp(2j * np.pi * (track.t - axis[0]) / (every * step))
    phase = round(every * float(np.angle(np.mean(turns))) / (2.0 * np.pi)) % every
    return slice(phase, None, every)


def _step(axis: np.ndarray) -> float:
    return float(axis[-1] - axis[0]) / (len(axis) - 1)


def _closest(track: Track, axis: np.ndarray, step: float) -> tuple[np.ndarray, np.ndarray]:
    """Readings that are closest to some time of the axis, and the indices of their times, (K,).

    The last one of several that are closest to the same time.
    """
    tick = np.floor((track.t - axis[0]) / step + 0.5 - TICKS.even).astype(int)  # halves alike
    last = np.append(tick[1:] != tick[:-1], True)
    rows = np.flatnonzero((tick >= 0) & (tick < len(axis)) & last)
    return rows, tick[rows]


def _at_readings(track: Track, axis: np.ndarray, step: float) -> np.ndarray:
    """Each reading at the closest time, moved there if it is of a motion; NaN elsewhere, (T,)."""
    rows, tick = _closest(track, axis, step)
    late, x = axis[tick] - track.t[rows], track.x.astype(float)
    moves = np.abs(late) > TICKS.even * step
    values = np.full(len(axis), np.nan)
    values[tick] = x[rows]
    if track.role in TICKS.smooth and moves.any():
        about, weights = neighbours(track.t, rows[moves], late[moves])
        values[tick[moves]] += change(x, rows[moves], about, weights)
    return values


def change(x: np.ndarray, rows: np.ndarray, about: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Change of a signal, (M,), about readings of these rows, by their `neighbours`, (K,)."""
    return np.sum(weights * (x[about] - x[rows, None]), axis=1)


def neighbours(t: np.ndarray, rows: np.ndarray, late: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings about some others, and their weights in the change of a signal about these.

    The change in a time `late` after a reading is that of a cubic through it: the sum over its
    neighbours of weight times difference to it.

    Args:
        t: Time stamps of all readings [s], increasing, (M,).
        rows: Indices of some of them, (K,).
        late: Time after each of these [s], (K,).

    Returns:
        Indices and weights, (K, 2 `TICKS.around` + 1) each; of no neighbours if there are fewer.
    """
    width = 2 * TICKS.around + 1
    if len(t) < width:
        return np.zeros((len(rows), 0), dtype=int), np.zeros((len(rows), 0))
    unit = period(t)
    about = (rows - TICKS.around).clip(0, len(t) - width)[:, None] + np.arange(width)
    powers = ((t[about] - t[rows, None]) / unit)[..., None] ** np.arange(4)
    gram = np.einsum("kwi,kwj->kij", powers, powers)
    cubic = np.linalg.solve(gram, powers.transpose(0, 2, 1))[:, 1:]
    return about, np.einsum("kiw,ki->kw", cubic, (late / unit)[:, None] ** np.arange(1, 4))
