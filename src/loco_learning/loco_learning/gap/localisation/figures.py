# SPDX-License-Identifier: Apache-2.0
"""Figure of the gap of each channel, and what plots of a gap show: record, window, spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .curves import FIT, HELD_OUT, Curve, Curves

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Colours of Okabe and Ito, safe for colour-blind readers; the measurement is broad and pale, so
# that a line exactly on it still shows.
MEASURED = {"color": "#9aa3ad", "lw": 3.0, "solid_capstyle": "butt"}
BEFORE = {"color": "#d55e00", "lw": 1.0}
AFTER = {"color": "#0072b2", "lw": 1.0}
FLOOR = {"color": "#222222", "lw": 0.8, "ls": (0, (4, 3))}
BAND = {"color": "#e9ecef", "lw": 0}
WIDTH = 7.4  # [in]
POINTS = 1500  # that a line is drawn with
MOST_SIGNALS = 4  # channels in a figure of signals
FAINT = 0.01  # noise floors: what is missed less is drawn there, as nothing at all has no logarithm


def canvas(rows: int, columns: int, height: float, **more: object) -> tuple[Figure, np.ndarray]:
    """Figure without a window and its axes, (rows, columns)."""
    from matplotlib.figure import Figure

    made = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = made.subplots(rows, columns, squeeze=False, **more)
    for ax in axes.flat:
        ax.spines[["top", "right"]].set_visible(False)
    return made, axes


def window(curve: Curve, columns: list[int], length: float) -> slice:
    """Stretch of a record in which the gap before is largest.

    Args:
        curve: The record.
        columns: Channels that count.
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
    """Amplitudes of a signal, rms within bands that are even in the logarithm.

    Args:
        t: Even times [s], (T,).
        y: Signal, (T,); gaps are bridged by the mean.
        bins: Number of bands at most.

    Returns:
        Frequencies [Hz] and amplitudes [unit of y] of the bands that hold a line.
    """
    known = np.isfinite(y)
    if known.sum() < 8:
        return np.zeros(0), np.zeros(0)
    mean = float(np.mean(y[known]))
    centred = np.where(known, y - mean, 0.0) * np.hanning(len(y))
    amplitude = 2.0 * np.abs(np.fft.rfft(centred))[1:] / np.hanning(len(y)).sum()
    f = np.fft.rfftfreq(len(y), (t[-1] - t[0]) / (len(t) - 1))[1:]
    edges = np.geomspace(f[0] * 0.999, f[-1] * 1.001, bins + 1)
    band = np.searchsorted(edges, f) - 1
    count = np.bincount(band, minlength=bins)
    power = np.bincount(band, amplitude**2, minlength=bins)
    middle = np.sqrt(edges[1:] * edges[:-1])
    filled = count > 0
    return middle[filled], np.sqrt(power[filled] / count[filled])


def channels(curves: Curves) -> Figure:
    """Gap of every channel in units of its noise, before and after."""
    floor = np.maximum(curves.floor, 1e-30)
    ratio = {k: np.maximum(curves.rms(k) / floor, FAINT) for k in ("before", "after")}
    shown = [c for c in range(len(curves.channels)) if np.isfinite(ratio["before"][c])]
    made, ((ax,),) = canvas(1, 1, 0.9 + 0.24 * len(shown))
    y = np.arange(len(shown))[::-1]
    for row, c in zip(y, shown, strict=True):
        ax.plot(
            [ratio["before"][c], ratio["after"][c]], [row, row], color="#c3c9d0", lw=2, zorder=1
        )
    ax.scatter(ratio["before"][shown], y, s=26, color=BEFORE["color"], label="before", zorder=2)
    ax.scatter(ratio["after"][shown], y, s=26, color=AFTER["color"], label="after", zorder=3)
    ax.axvline(1.0, label="noise", **FLOOR)
    ax.set(xscale="log", xlabel="rms of what the model misses, in units of the noise")
    ax.set_yticks(y, [curves.label(c) for c in shown])
    ax.set_ylim(-0.7, len(shown) - 0.3)
    made.legend(loc="outside upper left", ncols=3)
    return made


def worst_record(curves: Curves, columns: list[int]) -> Curve:
    """Held-out record (or, without one, fitted) with the largest gap before."""

    def size(curve: Curve) -> float:
        miss = curve.residual("before")[:, columns] / np.maximum(curves.floor[columns], 1e-30)
        return float(np.nanmean(miss**2)) if np.isfinite(miss).any() else -1.0

    return max(curves.of_role(HELD_OUT), key=size)


def span(curve: Curve) -> float:
    """Length of signal that a plot shows at first [s]: enough to see shapes."""
    return max(4.0, 400 * (curve.t[-1] - curve.t[0]) / max(1, len(curve.t) - 1))


ROLES = {FIT: "fitted", HELD_OUT: "held out"}
