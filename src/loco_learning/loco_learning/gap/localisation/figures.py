# SPDX-License-Identifier: Apache-2.0
"""Figure of the gap of each channel, and data of the plots of a gap: record, window, spectrum."""

from __future__ import annotations

import numpy as np

from ...drawing.chart import DASHED, Axis, Chart, Frame, dots, line
from .curves import Curve, Curves

# Colours of Okabe and Ito, safe for colour-blind readers; the measurement is broad and pale, so
# that a line exactly on it still shows.
MEASURED, BEFORE, AFTER, FLOOR = "#9aa3ad", "#d55e00", "#0072b2", "#222222"
MOST_SIGNALS = 4  # channels in a figure of signals
FAINT = 0.01  # [noise floors] smallest value drawn, since 0 has no logarithm


def window(curve: Curve, columns: list[int], length: float) -> slice:
    """Stretch of a record in which the gap before is largest.

    Args:
        curve: The record.
        columns: Channels that are considered.
        length: Length of the stretch [s].
    """
    dt = (curve.t[-1] - curve.t[0]) / max(1, len(curve.t) - 1)
    count = max(2, round(length / max(dt, 1e-9)))
    if count >= len(curve.t):
        return slice(None)
    miss = curve.residual("before")[:, columns]
    scale = np.nanmax(np.abs(miss), axis=0, initial=1e-30, where=np.isfinite(miss))
    energy = np.nansum((miss / scale) ** 2, axis=1)
    total = np.concatenate([[0.0], np.cumsum(energy)])
    first = int(np.argmax(total[count:] - total[:-count]))
    return slice(first, first + count)


def spectrum(t: np.ndarray, y: np.ndarray, bins: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Amplitude spectrum of a signal, as rms within logarithmically spaced bands.

    Args:
        t: Evenly spaced times [s], (T,).
        y: Signal, (T,); gaps are filled with the mean.
        bins: Largest number of bands.

    Returns:
        Centre frequencies [Hz] and amplitudes [unit of y] of all bands with spectral lines.
    """
    valid = np.isfinite(y)
    if valid.sum() < 8:
        return np.zeros(0), np.zeros(0)
    mean = float(np.mean(y[valid]))
    centred = np.where(valid, y - mean, 0.0) * np.hanning(len(y))
    amplitude = 2.0 * np.abs(np.fft.rfft(centred))[1:] / np.hanning(len(y)).sum()
    f = np.fft.rfftfreq(len(y), (t[-1] - t[0]) / (len(t) - 1))[1:]
    edges = np.geomspace(f[0] * 0.999, f[-1] * 1.001, bins + 1)
    band = np.searchsorted(edges, f) - 1
    count = np.bincount(band, minlength=bins)
    power = np.bincount(band, amplitude**2, minlength=bins)
    middle = np.sqrt(edges[1:] * edges[:-1])
    filled = count > 0
    return middle[filled], np.sqrt(power[filled] / count[filled])


def channels(curves: Curves) -> Chart:
    """Gap of every channel in noise floors, before and after."""
    ratio = {k: np.maximum(curves.floors(k), FAINT) for k in ("before", "after")}
    selected = [c for c in range(len(curves.channels)) if np.isfinite(ratio["before"][c])][::-1]
    rows, gap = np.arange(len(selected)), np.full(len(selected), np.nan)
    before, after = ratio["before"][selected], ratio["after"][selected]
    between = np.column_stack([before, after, gap]).ravel()
    layers = [
        line("change", between, np.column_stack([rows, rows, gap]).ravel(), MEASURED, size=2.0),
        dots("before", before, rows, BEFORE, size=4.5),
        dots("after", after, rows, AFTER, size=4.5),
        line("noise floor", [1.0, 1.0], [-0.5, len(selected) - 0.5], FLOOR, shape=DASHED, size=0.8),
    ]
    x = Axis("rms of what the model misses [noise floors]", logarithmic=True)
    y = Axis("channel", names=[curves.label(c) for c in selected])
    return Chart([Frame(x, y, layers, height=70 + 24 * len(selected))])


def worst_record(curves: Curves, columns: list[int]) -> Curve:
    """Record with the largest gap before among the judged ones."""

    def size(curve: Curve) -> float:
        miss = curve.whitened("before")[:, columns]
        return float(np.nanmean(miss**2)) if np.isfinite(miss).any() else -1.0

    return max(curves.judging, key=size)


def span(curve: Curve) -> float:
    """Length of signal that a plot shows initially [s], long enough to see shapes."""
    return max(4.0, 400 * (curve.t[-1] - curve.t[0]) / max(1, len(curve.t) - 1))
