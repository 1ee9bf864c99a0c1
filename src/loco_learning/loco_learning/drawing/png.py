# SPDX-License-Identifier: Apache-2.0
"""Charts as PNG files."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.files import write_whole

from .chart import BOXES, DASHED, DOTS, Axis, Chart, Frame, Layer, limits

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLUMNS = 3  # frames side by side
WIDTH, HEIGHT = 4.2, 3.2  # size of a frame [in]; a single frame is larger
MOST_NAMES = 6  # labels on a long horizontal axis
STYLE = {"font.size": 8.5, "axes.spines.top": False, "axes.spines.right": False,
         "legend.frameon": False}  # fmt: skip


def write(chart: Chart, path: Path) -> Path:
    """Draw a chart into a PNG file, completely or not at all; returns its path."""
    # Matplotlib is loaded on use, since most commands do not draw.
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    count = len(chart.frames)
    columns = chart.columns or (min(COLUMNS, max(1, count)) if count != 4 else 2)
    rows = max(1, -(-count // columns))
    size = (WIDTH * columns, HEIGHT * rows) if count > 1 else (1.6 * WIDTH, 1.3 * HEIGHT)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained", dpi=120)
        FigureCanvasAgg(figure)  # no display, and no global state as in pyplot
        axes = list(figure.subplots(rows, columns, squeeze=False).flat)
        legend: dict[str, Any] = {}
        for ax, frame in zip(axes, chart.frames, strict=False):
            _frame(ax, frame, legend)
        for ax in axes[count:]:
            ax.set_axis_off()
        named = {name: handle for name, handle in legend.items() if name}
        figure.legend(named.values(), named, loc="outside right upper")
        return write_whole(path, partial(figure.savefig, format="png"))


def _frame(ax: Axes, frame: Frame, legend: dict[str, Any]) -> None:
    for axis, horizontal in ((frame.x, True), (frame.y, False)):
        _axis(ax, axis, limits(frame, horizontal), horizontal)
    for order, layer in enumerate(frame.layers):
        handle = _layer(ax, layer, order)
        if len(layer.x) or layer.name not in legend:  # the legend shows the topmost mark
            legend[layer.name] = handle
    ax.set_title(frame.title, fontsize=9)
    if frame.equal:
        ax.set_aspect("equal", adjustable="datalim")


def _axis(ax: Axes, axis: Axis, limits: tuple[float, float], horizontal: bool) -> None:
    if axis.logarithmic:
        (ax.set_xscale if horizontal else ax.set_yscale)("log")
    (ax.set_xlim if horizontal else ax.set_ylim)(*limits)
    (ax.set_xlabel if horizontal else ax.set_ylabel)(axis.label)
    if axis.names:
        every = math.ceil(len(axis.names) / MOST_NAMES) if horizontal else 1
        if not horizontal and len(axis.names) > 5 * MOST_NAMES:
            every = math.ceil(len(axis.names) / MOST_NAMES)
        at = np.arange(0, len(axis.names), every)
        (ax.set_xticks if horizontal else ax.set_yticks)(at, [axis.names[i] for i in at])


def _layer(ax: Axes, layer: Layer, order: int) -> Any:
    style = {"color": layer.color, "label": layer.name, "zorder": 2.0 + 0.01 * order}
    if layer.shape == BOXES:
        from matplotlib.collections import PolyCollection

        corners = [(layer.x, layer.y), (layer.right, layer.y), (layer.right, layer.top),
                   (layer.x, layer.top)]  # fmt: skip
        boxes = np.array(corners, dtype=float).transpose(2, 0, 1)
        ax.add_collection(PolyCollection(boxes, color=layer.color, lw=0.2, zorder=style["zorder"]))
        return ax.plot([], [], "s", **style)[0]
    if layer.shape == DOTS:
        return ax.plot(layer.x, layer.y, "o", ms=1.5 * layer.size, mew=0, **style)[0]
    dashed = (0, (4, 3)) if layer.shape == DASHED else "-"
    return ax.plot(layer.x, layer.y, lw=0.8 * layer.size, ls=dashed, **style)[0]
