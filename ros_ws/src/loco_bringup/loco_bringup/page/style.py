# SPDX-License-Identifier: Apache-2.0
"""Look of the report's figures: one colour per meaning, phases shaded, small SVG files."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from loco_learning.params import OPEN
from loco_learning.runs.log import Log

from .plot import Plot

# Colours of Okabe and Ito, safe for colour-blind readers. The target is a broad pale line, so
# that a thin line exactly on it still shows.
TARGET = {"color": "#8cc5ea", "linewidth": 3.2, "solid_capstyle": "butt", "zorder": 2.0}
COMMAND = {"color": "#d55e00", "linewidth": 1.1, "zorder": 2.2}
MEASURED = {"color": "#222222", "linewidth": 0.8, "zorder": 2.1}
OTHER = {"color": "#0072b2", "linewidth": 1.1}  # anything that is none of the three
BOUND = {"color": "#222222", "linewidth": 0.9, "linestyle": (0, (4, 3))}
TINTS = {"stand": "#f1f1f1", "train": "#e3eef7", "closing": "#fdf0d5", "test": "#e2f3ea"}
TINTS[OPEN] = TINTS["train"]

WIDTH = 7.4  # of every figure [in]
STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 8.5,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.5,
    "axes.linewidth": 0.6,
    "axes.edgecolor": "#666666",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
    "legend.fontsize": 8,
    "path.simplify_threshold": 0.2,
    "svg.hashsalt": "loco",  # the same bag gives the same bytes
}
_ANONYMOUS = {"Date": None, "Creator": None, "Format": None, "Type": None}


@contextmanager
def style() -> Iterator[None]:
    """Everything drawn inside has the report's style."""
    with mpl.rc_context(STYLE):
        yield


def canvas(rows: int, columns: int, height: float, **more: object) -> tuple[Figure, np.ndarray]:
    """Figure without a window, and its axes, (rows, columns).

    Args:
        rows: Number of rows of axes.
        columns: Number of columns of axes.
        height: Height of the figure [in].
        more: Further arguments of `Figure.subplots`.
    """
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    return figure, figure.subplots(rows, columns, squeeze=False, **more)


def svg(figure: Figure) -> bytes:
    """Figure as SVG without date and addresses."""
    file = io.BytesIO()
    figure.savefig(file, format="svg", metadata=_ANONYMOUS)
    return file.getvalue()


def legend(figure: Figure, axes: Axes, columns: int = 4) -> None:
    """One legend for all axes, above them, where it hides no data."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def spans(log: Log) -> list[tuple[str, str, float, float]]:
    """Colour, name, start and end [s] of the phases that were reached."""
    return [
        (TINTS[name], name, float(log.t[s.start]), float(log.t[s.stop - 1]) + log.dt)
        for name, s in log.phases().items()
    ]


def tint(ax: Axes, log: Log, ticks: slice) -> None:
    """Shade the phases within a window."""
    first, last = log.t[ticks][0], log.t[ticks][-1]
    for color, _, start, stop in spans(log):
        a, b = max(start, first), min(stop, last)
        if b > a:
            ax.axvspan(a, b, color=color, linewidth=0, zorder=-10)


def shade(axes: np.ndarray, log: Log) -> None:
    """Tint the phases behind time axes and name them above the first."""
    shade_spans(axes, spans(log))


def shade_spans(axes: np.ndarray, spans: list[tuple[str, str, float, float]]) -> None:
    """Tint spans behind time axes, name them above the first, and let the axes end with them.

    Args:
        axes: Axes of one column.
        spans: Colour, name, start and end [s], in order.
    """
    whole = spans[-1][3] - spans[0][2]
    for each in axes.flat:
        each.set_xlim(spans[0][2], spans[-1][3])
        for color, _, start, stop in spans:
            each.axvspan(start, stop, color=color, linewidth=0, zorder=-10)
    top = axes.flat[0]
    for _, name, start, stop in spans:
        if stop - start > 0.06 * whole:
            top.annotate(
                name,
                ((start + stop) / 2, 1.0), (0, 2), xycoords=("data", "axes fraction"),
                textcoords="offset points", ha="center", va="bottom", fontsize=8, color="#555555",
            )  # fmt: skip


def envelope(t: np.ndarray, y: np.ndarray, bucket: int) -> tuple[np.ndarray, ...]:
    """Start time, smallest and largest value of each bucket of a signal.

    Keeps every peak of a long signal in a small drawing. The last time is the end.

    Args:
        t: Times, (T,).
        y: Signal, (T,); NaN where unknown.
        bucket: Samples per bucket.
    """
    edges = np.arange(0, len(y), bucket)
    low, high = np.fmin.reduceat(y, edges), np.fmax.reduceat(y, edges)
    return np.append(t[edges], t[-1]), np.append(low, low[-1]), np.append(high, high[-1])


def every(t: np.ndarray, points: int = 900) -> slice:
    """Rows of a smooth signal that are worth drawing."""
    return slice(None, None, max(1, len(t) // points))


def flag_spans(t: np.ndarray, flag: np.ndarray, dt: float) -> list[tuple[float, float]]:
    """Start and length [s] of each stretch in which a flag is up."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flag, [False])).astype(int)))
    return [
        (float(t[a]), float(t[b - 1] - t[a]) + dt)
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


@dataclass(frozen=True)
class Chapter:
    """One figure of a report."""

    title: str
    text: str  # what it shows, for people
    draw: Callable[[Any], Figure | Plot]  # from a log


def chapters() -> tuple[list[Chapter], Callable[[str, str], Callable]]:
    """Figures of a report in their order, and the decorator that puts one there.

    The decorator takes title and text. Its function raises `BagError` where the bag lacks
    its data.
    """
    listed: list[Chapter] = []

    def chapter(title: str, text: str) -> Callable:
        def register(draw: Callable[[Any], Figure | Plot]) -> Callable[[Any], Figure | Plot]:
            listed.append(Chapter(title, text, draw))
            return draw

        return register

    return listed, chapter
