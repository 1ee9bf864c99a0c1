# SPDX-License-Identifier: Apache-2.0
"""Charts as data: lines, dots and boxes on axes of numbers or of names.

One description for limit cycles, scatter plots, bars over time and maps of cells. The page draws
it interactively (`loco_bringup.page.chart`), `png` as a file.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

PAD = 0.04  # margin on each side, share of the range
LINE, DASHED, DOTS, BOXES = "line", "dashed", "dots", "boxes"
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#999999")
GREY = "#999999"


@dataclass(frozen=True)
class Axis:
    """One axis of a frame.

    Attributes:
        label: Quantity of the axis, with its unit in brackets.
        logarithmic: Whether the axis is logarithmic; values of zero and below are then not drawn.
        names: Names of the positions 0, 1, 2 and so on; empty for an axis of numbers.
        limits: Smallest and largest value shown; None for the range of the layers.
    """

    label: str
    logarithmic: bool = False
    names: Sequence[str] = ()
    limits: tuple[float, float] | None = None


@dataclass(frozen=True)
class Layer:
    """Marks of one colour and one name.

    Attributes:
        name: Name in the legend; layers of the same name are switched together.
        x: Horizontal positions, (N,); for boxes their left sides. NaN interrupts a line.
        y: Vertical positions, (N,); for boxes their lower sides.
        color: Colour on a light page, as ``#rrggbb``.
        shape: ``line``, ``dashed`` line, ``dots`` or ``boxes``.
        size: Width of lines or radius of dots [pixel].
        right: Right sides of boxes, (N,); None for other shapes.
        top: Upper sides of boxes, (N,); None for other shapes.
        texts: Tooltip of each mark, or empty.
        links: Address that a click on each mark opens, or empty.
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
        x: Horizontal axis.
        y: Vertical axis.
        layers: The layers, drawn in this order.
        title: Title, used if there are several frames.
        equal: Whether both axes have the same scale, as for a path in a plane.
        height: Height including the axes [pixel].
    """

    x: Axis
    y: Axis
    layers: Sequence[Layer]
    title: str = ""
    equal: bool = False
    height: int = 260


@dataclass(frozen=True)
class Chart:
    """Frames side by side, or below each other on a narrow page.

    Attributes:
        frames: The frames, by rows.
        columns: Frames in a row of a file; 0 for a number that suits their count.
    """

    frames: Sequence[Frame]
    columns: int = 0


def dots(name: str, x: Sequence[float], y: Sequence[float], color: str, **style: object) -> Layer:
    """Layer of dots.

    Args:
        name: Name in the legend.
        x: Horizontal positions, (N,).
        y: Vertical positions, (N,).
        color: Colour, as ``#rrggbb``.
        style: Further attributes of `Layer`.
    """
    return Layer(name, array(x), array(y), color, DOTS, **{"size": 3.5, **style})  # type: ignore[arg-type]


def line(name: str, x: Sequence[float], y: Sequence[float], color: str, **style: object) -> Layer:
    """Layer of a line through points in their order.

    Args:
        name: Name in the legend.
        x: Horizontal positions, (N,).
        y: Vertical positions, (N,).
        color: Colour, as ``#rrggbb``.
        style: Further attributes of `Layer`.
    """
    return Layer(name, array(x), array(y), color, **style)  # type: ignore[arg-type]


def bars(
    name: str, spans: Sequence[tuple[float, float]], lane: float, color: str, height: float = 0.76
) -> Layer:
    """Layer of boxes in one lane of an axis of names.

    Args:
        name: Name in the legend.
        spans: Start and length of each bar.
        lane: Vertical position of their centre.
        color: Colour, as ``#rrggbb``.
        height: Height of the bars over the distance of lanes.
    """
    start, length = array(spans).reshape(-1, 2).T
    low = np.full(len(start), lane - height / 2.0)
    return Layer(
        name, start, low, color, BOXES, right=start + length, top=low + height,
    )  # fmt: skip


def spread(
    name: str, groups: Sequence[tuple[float, np.ndarray]], color: str, connected: bool = True
) -> list[Layer]:
    """Means of groups of values as dots on a line, with bars of one standard deviation.

    Args:
        name: Name in the legend.
        groups: Horizontal position and values of each group.
        color: Colour, as ``#rrggbb``.
        connected: Whether a line connects the dots.
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
    """Smallest and largest value that an axis shows: its limits, or the range of all layers.

    Args:
        frame: The frame.
        horizontal: True for the horizontal axis, False for the vertical one.
    """
    axis = frame.x if horizontal else frame.y
    if axis.limits:
        return axis.limits
    if axis.names:
        return -0.5, len(axis.names) - 0.5
    arrays = [
        array(values)
        for each in frame.layers
        for values in ((each.x, each.right) if horizontal else (each.y, each.top))
        if values is not None
    ]
    values = np.concatenate([*arrays, np.zeros(0)])
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


def short(joint: str) -> str:
    """Label of a joint in a figure: its name without ``_joint`` and underscores."""
    return joint.removesuffix("_joint").replace("_", " ")
