# SPDX-License-Identifier: Apache-2.0
"""Charts of points in a plane: lines, dots and boxes on axes of numbers or of names.

One description for limit cycles, scatters, bars over time and maps of cells. A page draws it for a
reader to explore (`loco_bringup.page.chart`), `png` draws it as a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

PAD = 0.04  # share of the range that is free on each side
LINE, DASHED, DOTS, BOXES = "line", "dashed", "dots", "boxes"
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#999999")
GREY = "#999999"


@dataclass(frozen=True)
class Axis:
    """One axis of a frame.

    Attributes:
        label: Quantity of the axis, with its unit in brackets.
        logarithmic: True for a logarithmic axis, without values of zero and below.
        names: Names of the places 0, 1, 2 and so on; none on an axis of numbers.
        limits: Smallest and largest value that is shown; None for what the layers need.
    """

    label: str
    logarithmic: bool = False
    names: Sequence[str] = ()
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Layer:
    """Marks of one colour and one name.

    Attributes:
        name: Name in the legend; layers of one name are switched together.
        x: Places to the right, (N,); of boxes their left sides. NaN breaks a line.
        y: Places upwards, (N,); of boxes their lower sides.
        color: Colour on a light page, as ``#rrggbb``.
        shape: ``line``, ``dashed`` (a line, too), ``dots`` or ``boxes``.
        size: Width of lines or radius of dots [pixel].
        right: Right sides of boxes, (N,); nothing for other shapes.
        top: Upper sides of boxes, (N,); nothing for other shapes.
        texts: Words on each mark, which a pointer shows beside its place, or nothing.
        links: Address on the page, or of a page beside it, that a click on a mark opens.
    """

    name: str
    x: np.ndarray = field(repr=False)
    y: np.ndarray = field(repr=False)
    color: str
    shape: str = LINE
    size: float = 1.2
    right: np.ndarray | None = field(default=None, repr=False)
    top: np.ndarray | None = field(default=None, repr=False)
    texts: Sequence[str] = ()
    links: Sequence[str] = ()


@dataclass(frozen=True)
class Frame:
    """Layers on two axes.

    Attributes:
        x: Axis to the right.
        y: Axis upwards.
        layers: The layers, first drawn first.
        title: Name of the frame where there are several.
        equal: True for axes of the same scale, as a path in a plane has.
        height: Height with its axes [pixel].
    """

    x: Axis
    y: Axis
    layers: Sequence[Layer]
    title: str = ""
    equal: bool = False
    height: int = 260


@dataclass(frozen=True)
class Chart:
    """Frames side by side, below each other where the page is narrow."""

    frames: Sequence[Frame]


def dots(name: str, x: Sequence[float], y: Sequence[float], color: str, **style: object) -> Layer:
    """Layer of dots; further attributes of `Layer` as keywords.

    Args:
        name: Name in the legend.
        x: Places to the right, (N,).
        y: Places upwards, (N,).
        color: Colour, as ``#rrggbb``.
        style: Further attributes.
    """
    return Layer(name, array(x), array(y), color, DOTS, **{"size": 3.5, **style})  # type: ignore[arg-type]


def line(name: str, x: Sequence[float], y: Sequence[float], color: str, **style: object) -> Layer:
    """Line through points in their order; further attributes of `Layer` as keywords.

    Args:
        name: Name in the legend.
        x: Places to the right, (N,).
        y: Places upwards, (N,).
        color: Colour, as ``#rrggbb``.
        style: Further attributes.
    """
    return Layer(name, array(x), array(y), color, **style)  # type: ignore[arg-type]


def bars(
    name: str, spans: Sequence[tuple[float, float]], lane: float, color: str, height: float = 0.76
) -> Layer:
    """Boxes in one lane of an axis of names.

    Args:
        name: Name in the legend.
        spans: Start and length of each bar.
        lane: Place of its middle.
        color: Colour, as ``#rrggbb``.
        height: Height of the bars, of 1 between lanes.
    """
    start, length = array(spans).reshape(-1, 2).T
    low = np.full(len(start), lane - height / 2.0)
    return Layer(
        name, start, low, color, BOXES, right=start + length, top=low + height,
    )  # fmt: skip


def spread(
    name: str, groups: Sequence[tuple[float, np.ndarray]], color: str, connected: bool = True
) -> list[Layer]:
    """Mean of groups of values as a line with dots, and a stroke of one deviation to both sides.

    Args:
        name: Name in the legend.
        groups: Place and values of each group.
        color: Colour, as ``#rrggbb``.
        connected: False for dots without a line between.
    """
    at = array([place for place, _ in groups])
    mean = array([np.mean(values) for _, values in groups])
    deviation = array([np.std(values) for _, values in groups])
    gap = np.full(len(at), np.nan)
    strokes = np.column_stack([mean - deviation, mean + deviation, gap]).ravel()
    layers = [line(name, np.column_stack([at, at, gap]).ravel(), strokes, color)]
    layers += [line(name, at, mean, color)] if connected else []
    return [*layers, dots(name, at, mean, color)]


def limits(frame: Frame, horizontal: bool) -> tuple[float, float]:
    """Smallest and largest value that an axis shows: what was asked for, or all there is.

    Args:
        frame: The frame.
        horizontal: True for the axis to the right.
    """
    axis = frame.x if horizontal else frame.y
    if axis.limits:
        return axis.limits
    if axis.names:
        return -0.5, len(axis.names) - 0.5
    found = [
        array(values)
        for each in frame.layers
        for values in ((each.x, each.right) if horizontal else (each.y, each.top))
        if values is not None
    ]
    values = np.concatenate([*found, np.zeros(0)])
    values = values[np.isfinite(values) & ((values > 0.0) | (not axis.logarithmic))]
    if not len(values):
        return (1.0, 10.0) if axis.logarithmic else (0.0, 1.0)
    low, high = float(values.min()), float(values.max())
    if axis.logarithmic:
        margin = max((high / low) ** PAD, 1.05)
        return low / margin, high * margin
    filled = all(each.shape == BOXES for each in frame.layers)
    margin = 0.0 if filled else PAD * (high - low) or 0.05 * abs(high) or 1.0
    return low - margin, high + margin


def array(values: object) -> np.ndarray:
    """Values as an array of floats."""
    return np.asarray(values, dtype=float)
