# SPDX-License-Identifier: Apache-2.0
"""Interactive plots of signals over a common axis, drawn by uPlot from data in the page.

A plot can be zoomed, its signals hidden, its values read under the cursor and saved as CSV.
Values are stored as 16-bit steps between the minimum and maximum of their line, as differences
between successive values, deflated: one minute of a robot fits into a page of 3 MB.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

BUDGET = 120_000  # largest number of values in one plot; longer ones are thinned
STEPS = 65_534  # quantisation steps between the minimum and maximum of a line
UNKNOWN = -32_768  # code of an unknown value
# Colours for dark pages of the colours that are dark or pale on light pages.
DARK = {
    "#222222": "#e3e7ec", "#0072b2": "#4aa8e0", "#d55e00": "#f08a3c", "#f1f1f1": "#24282e",
    "#e3eef7": "#1c2a36", "#fdf0d5": "#352c1a", "#e2f3ea": "#1b2f26", "#8cc5ea": "#2f6f9c",
    "#9aa3ad": "#6c757f", "#999999": "#8a929b", "#666666": "#a7aeb6",
}  # fmt: skip

Span = tuple[str, str, float, float]  # colour, name, start and end


@dataclass(frozen=True)
class Line:
    """One signal.

    Attributes:
        name: Name in the legend; lines with the same name are shown and hidden together.
        values: Values, (N,); NaN where unknown.
        color: Colour on a light page, as ``#rrggbb``.
        width: Width [pixel].
        dashed: Whether the line is dashed, as a bound is.
    """

    name: str
    values: np.ndarray
    color: str
    width: float = 1.2
    dashed: bool = False


@dataclass(frozen=True)
class Panel:
    """Lines on one vertical axis.

    Attributes:
        label: Name of the vertical axis, with its unit in brackets.
        lines: The lines, in drawing order.
        logarithmic: True for a logarithmic vertical axis; values of zero and below are omitted.
        limits: Smallest and largest displayed value; None for the range of the lines.
    """

    label: str
    lines: Sequence[Line]
    logarithmic: bool = False
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Plot:
    """Panels stacked vertically over a common axis.

    Attributes:
        x: Common axis, (N,), increasing, with at least one value.
        panels: Panels from top to bottom.
        spans: Shaded intervals of `x`.
        axis: Name of `x` with its unit; plots with the same axis name are linked.
        view: Initially displayed interval of `x`; None for all.
    """

    x: np.ndarray
    panels: Sequence[Panel]
    spans: Sequence[Span] = ()
    axis: str = "time [s]"
    view: tuple[float, float] | None = None


def data_of(title: str, plot: Plot) -> dict[str, Any]:
    """Data of a plot for the page's script; `title` is also the name of the saved file."""
    lines = [line for panel in plot.panels for line in panel.lines]
    every = max(1, -(-len(plot.x) * len(lines) // BUDGET))
    logs = [panel.logarithmic for panel in plot.panels for _ in panel.lines]
    packed = [pack(thinned(line.values, every), log) for line, log in zip(lines, logs, strict=True)]
    arrays = iter(packed)
    return {
        "title": title, "axis": plot.axis, "log": "[Hz]" in plot.axis,
        "view": plot.view, "every": every,
        "x": text(np.asarray(_axis(plot.x[::every]), "<f8")), "count": len(plot.x[::every]),
        "steps": text(np.concatenate([steps for _, _, steps in packed])),
        "spans": [[both(color), name, start, end] for color, name, start, end in plot.spans],
        "panels": [
            {
                "label": panel.label, "log": panel.logarithmic, "limits": panel.limits,
                "lines": [
                    {"name": line.name, "color": both(line.color), "width": line.width,
                     "dashed": line.dashed, "ends": next(arrays)[:2]}
                    for line in panel.lines
                ],
            }
            for panel in plot.panels
        ],
    }  # fmt: skip


def thinned(values: np.ndarray, every: int) -> np.ndarray:
    """First value that is not NaN in each group of `every` neighbours, (M,); else NaN.

    A signal with fewer samples than the axis, and NaN between them, keeps its values.
    """
    padded = np.full(-(-len(values) // every) * every, np.nan)
    padded[: len(values)] = values
    rows = padded.reshape(-1, every)
    return rows[np.arange(len(rows)), np.isfinite(rows).argmax(axis=1)]


def _axis(x: np.ndarray) -> np.ndarray:
    """First value and step of a uniform axis, else all values."""
    step = (x[-1] - x[0]) / max(1, len(x) - 1)
    even = np.allclose(x, x[0] + step * np.arange(len(x)), rtol=0.0, atol=1e-6 * (step or 1.0))
    return np.array([x[0], step]) if even else x


def text(values: np.ndarray) -> str:
    """Deflated bytes of an array as text."""
    return base64.b64encode(zlib.compress(values.tobytes(), 9)).decode()


def seen(title: str, plot: Plot) -> str:
    """Text alternative of a plot: the range of every line, for readers who cannot see it."""
    span = f" from {_short(plot.x[0])} to {_short(plot.x[-1])}" if len(plot.x) else ""
    rows = []
    for panel in plot.panels:
        lines = ", ".join(f"{line.name} {ends_of(line.values)}" for line in panel.lines)
        rows.append(f"{panel.label}: {lines}")
    return f"{title} over {plot.axis}{span}. {'; '.join(rows)}."


def both(color: str) -> str:
    """CSS value of a colour for light and dark pages."""
    return f"light-dark({color}, {DARK.get(color, color)})"


def pack(values: np.ndarray, logarithmic: bool) -> tuple[float, float, np.ndarray]:
    """Minimum and maximum of a line, and its quantised values as differences, (N,).

    Args:
        values: Values, (N,); NaN where unknown.
        logarithmic: True to quantise the logarithm; values of zero and below are omitted.
    """
    values = np.asarray(values, dtype=float)
    valid = np.isfinite(values) & ((values > 0.0) | (not logarithmic))
    scaled = np.log10(np.where(valid, values, 1.0)) if logarithmic else values
    low, high = (scaled[valid].min(), scaled[valid].max()) if valid.any() else (0.0, 0.0)
    share = (np.where(valid, scaled, low) - low) / ((high - low) or 1.0)
    steps = np.where(valid, np.round(share * STEPS) - STEPS // 2, UNKNOWN).astype("<i2")
    return float(low), float(high), np.diff(steps, prepend=steps.dtype.type(0))


def ends_of(values: np.ndarray) -> str:
    """Minimum and maximum of the finite values as text."""
    finite = np.asarray(values)[np.isfinite(values)]
    if not len(finite):
        return "unknown"
    low, high = _short(finite.min()), _short(finite.max())
    return low if low == high else f"{low} to {high}"


def _short(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")
