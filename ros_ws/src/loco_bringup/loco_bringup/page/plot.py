# SPDX-License-Identifier: Apache-2.0
"""Interactive plots: signals over a common axis as data of the page, which uPlot draws.

A plot can be zoomed, its signals switched off, its values read under the cursor and saved as CSV.
Values travel as 16-bit steps between the smallest and the largest of their line, as differences
from one to the next, deflated: so a minute of a robot fits into a page of 3 MB.
"""

from __future__ import annotations

import base64
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

BUDGET = 120_000  # values in one plot; a longer one is thinned
STEPS = 65_534  # of a line between its smallest and its largest value
UNKNOWN = -32_768  # stands for a value that is not known
# What is dark or pale on paper, as it looks on a dark page.
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
        name: Name in the legend; lines of one name are switched together.
        values: Values, (N,); NaN where unknown.
        color: Colour on a light page, as ``#rrggbb``.
        width: Width [pixel].
        dashed: True for a bound, which is no signal.
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
        lines: The lines, first drawn first.
        logarithmic: True for a logarithmic vertical axis, without values of zero and below.
        limits: Smallest and largest value that is shown; None for what the lines need.
    """

    label: str
    lines: Sequence[Line]
    logarithmic: bool = False
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Plot:
    """Panels below each other over a common axis.

    Attributes:
        x: Common axis, (N,), increasing, with one value at least.
        panels: Panels from top to bottom.
        spans: Stretches of `x` to be shaded.
        axis: Name of `x` with its unit; plots of a page over the same axis are linked.
        view: Stretch of `x` that is shown at first; None for all.
    """

    x: np.ndarray
    panels: Sequence[Panel]
    spans: Sequence[Span] = ()
    axis: str = "time [s]"
    view: tuple[float, float] | None = None


def data_of(title: str, plot: Plot) -> dict[str, Any]:
    """Data that the page's script draws; `title` names the file that a reader saves, too."""
    lines = [line for panel in plot.panels for line in panel.lines]
    every = max(1, -(-len(plot.x) * len(lines) // BUDGET))
    logs = [panel.logarithmic for panel in plot.panels for _ in panel.lines]
    packed = [pack(line.values[::every], log) for line, log in zip(lines, logs, strict=True)]
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


def _axis(x: np.ndarray) -> np.ndarray:
    """First value and step of an even axis; all values of another one."""
    step = (x[-1] - x[0]) / max(1, len(x) - 1)
    even = np.allclose(x, x[0] + step * np.arange(len(x)), rtol=0.0, atol=1e-6 * (step or 1.0))
    return np.array([x[0], step]) if even else x


def text(values: np.ndarray) -> str:
    """Bytes of an array, deflated, as text of a page."""
    return base64.b64encode(zlib.compress(values.tobytes(), 9)).decode()


def seen(title: str, plot: Plot) -> str:
    """Sentences with the range of every line, for readers who cannot see the plot."""
    span = f" from {_short(plot.x[0])} to {_short(plot.x[-1])}" if len(plot.x) else ""
    rows = []
    for panel in plot.panels:
        lines = ", ".join(f"{line.name} {ends_of(line.values)}" for line in panel.lines)
        rows.append(f"{panel.label}: {lines}")
    return f"{title} over {plot.axis}{span}. {'; '.join(rows)}."


def short(joint: str) -> str:
    """Label of a joint in a figure: its name without ``_joint`` and underscores."""
    return joint.removesuffix("_joint").replace("_", " ")


def both(color: str) -> str:
    """A colour for light and dark pages, as CSS has it."""
    return f"light-dark({color}, {DARK.get(color, color)})"


def pack(values: np.ndarray, logarithmic: bool) -> tuple[float, float, np.ndarray]:
    """Smallest and largest value of a line, and its steps as differences, (N,).

    Args:
        values: Values, (N,); NaN where unknown.
        logarithmic: True for steps of the logarithm, without values of zero and below.
    """
    values = np.asarray(values, dtype=float)
    valid = np.isfinite(values) & ((values > 0.0) | (not logarithmic))
    scaled = np.log10(np.where(valid, values, 1.0)) if logarithmic else values
    low, high = (scaled[valid].min(), scaled[valid].max()) if valid.any() else (0.0, 0.0)
    share = (np.where(valid, scaled, low) - low) / ((high - low) or 1.0)
    steps = np.where(valid, np.round(share * STEPS) - STEPS // 2, UNKNOWN).astype("<i2")
    return float(low), float(high), np.diff(steps, prepend=steps.dtype.type(0))


def ends_of(values: np.ndarray) -> str:
    """Smallest and largest known value in words."""
    finite = np.asarray(values)[np.isfinite(values)]
    if not len(finite):
        return "unknown"
    low, high = _short(finite.min()), _short(finite.max())
    return low if low == high else f"{low} to {high}"


def _short(value: float) -> str:
    return f"{value:.3g}".replace("-", "−")
