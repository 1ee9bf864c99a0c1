# SPDX-License-Identifier: Apache-2.0
"""Charts of a page: data for the page's script, and text alternatives.

A reader can zoom into a frame, hide layers, read the values under the pointer, move from mark
to mark with the arrow keys, open the link of a mark, and save the data as CSV.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from loco_learning.drawing.chart import BOXES, DASHED, DOTS, Chart, Frame, Layer, limits

from .plot import both, ends_of, pack, text

BUDGET = 120_000  # largest number of points in one chart; longer lines are thinned


def data_of(title: str, chart: Chart) -> dict[str, Any]:
    """Data of a chart for the page's script.

    Args:
        title: Title, also the name of the saved file.
        chart: The chart.
    """
    layers = [layer for frame in chart.frames for layer in frame.layers]
    total = sum(len(x.x) for x in layers if x.shape not in (DOTS, BOXES))
    every = max(1, -(-total // BUDGET))
    steps: list[np.ndarray] = [np.zeros(0, dtype="<i2")]
    panels = [
        {
            "title": frame.title, "equal": frame.equal, "height": frame.height,
            "x": _axis(frame, True), "y": _axis(frame, False),
            "layers": [_layer(layer, frame, every, steps) for layer in frame.layers],
        }
        for frame in chart.frames
    ]  # fmt: skip
    return {"title": title, "every": every, "panels": panels, "steps": text(np.concatenate(steps))}


def _axis(frame: Frame, horizontal: bool) -> dict[str, Any]:
    axis = frame.x if horizontal else frame.y
    bounds = [float(end) for end in limits(frame, horizontal)]
    return {"label": axis.label, "log": axis.logarithmic, "names": list(axis.names), "ends": bounds}


def _layer(layer: Layer, frame: Frame, every: int, steps: list[np.ndarray]) -> dict[str, Any]:
    """Data of a layer; its packed coordinates are appended to `steps`."""
    thinned = slice(None, None, every if layer.shape not in (DOTS, BOXES) else 1)
    columns = {"x": layer.x, "right": layer.right, "y": layer.y, "top": layer.top}
    bounds = {}
    for name, values in columns.items():
        if values is not None:
            axis = frame.x if name in ("x", "right") else frame.y
            low, high, packed = pack(values[thinned], axis.logarithmic)
            bounds[name] = [low, high]
            steps.append(packed)
    return {
        "name": layer.name, "color": both(layer.color), "size": layer.size,
        "shape": "line" if layer.shape == DASHED else layer.shape,
        "dashed": layer.shape == DASHED, "count": len(layer.x[thinned]), "ends": bounds,
        "texts": list(layer.texts), "links": list(layer.links),
    }  # fmt: skip


def seen(title: str, chart: Chart) -> str:
    """Text alternative of a chart: the range of every layer, for readers who cannot see it.

    Args:
        title: Name of the chart.
        chart: The chart.
    """
    return " ".join([f"{title}.", *(_frame(frame) for frame in chart.frames)])


def _frame(frame: Frame) -> str:
    tooltips: dict[str, list[Layer]] = {}
    for layer in frame.layers:
        if len(layer.x):
            tooltips.setdefault(layer.name, []).append(layer)
    layers = ", ".join(_marks(name, group, frame) for name, group in tooltips.items())
    head = f"{frame.title}: " if frame.title else ""
    return f"{head}{frame.y.label} over {frame.x.label}: {layers or 'nothing'}."


def _marks(name: str, group: list[Layer], frame: Frame) -> str:
    """Name of a group of layers, and their number of marks or their range."""
    if any(layer.shape == BOXES for layer in group):
        count = sum(len(layer.x) for layer in group)
        return f"{name} {count} {'box' if count == 1 else 'boxes'}"
    x, y = (np.concatenate(values) for values in zip(*((g.x, g.y) for g in group), strict=True))
    if frame.y.names:
        return f"{name} {ends_of(x)}"
    if frame.equal or not frame.x.names and group[0].shape == DOTS:
        return f"{name} {ends_of(y)} at {ends_of(x)}"
    return f"{name} {ends_of(y)}"
