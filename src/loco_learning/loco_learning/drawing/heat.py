# SPDX-License-Identifier: Apache-2.0
"""Layers of maps: cells coloured by value, named masks, and outlines of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from .chart import BOXES, DOTS, LINE, Layer, array

# Nine colours of viridis, which keep their order for colour-blind readers and in grey prints.
STEPS = ("#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30",
         "#fde725")  # fmt: skip
WIDE = 20.0  # ratio of largest to smallest value above which the colour scale is logarithmic
PERCENTILES = (2.0, 98.0)  # percentiles of the values at the ends of the colour scale


def cells(
    values: np.ndarray,
    unit: str,
    links: Sequence[Sequence[str]] = (),
    name: str = "",
    scale: np.ndarray | None = None,
) -> list[Layer]:
    """Layers of a map, one per colour; the centre of cell (i, j) is at x = j, y = i.

    Args:
        values: Values, (ny, nx); NaN leaves a cell empty.
        unit: Unit of the values; ``-`` for none.
        links: Address that a click on a cell opens, (ny, nx) or empty.
        name: Name of the quantity, for the tooltips.
        scale: Values that define the colour scale: those of all compared maps; None for
            `values`.
    """
    finite, unit = np.isfinite(values), unit.removeprefix("-")
    if not finite.any():
        return []
    every = values if scale is None else scale
    low, high = np.percentile(every[np.isfinite(every)], PERCENTILES)
    wide = low > 0.0 and high > WIDE * low
    count = len(STEPS) if high > low else 1
    edges = (np.geomspace if wide else np.linspace)(low, high, count + 1)
    step = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, count - 1)
    rows = []
    for k in range(count):
        mask = finite & (step == k)
        if scale is None and not mask.any():
            continue  # with a common scale the legend shows each colour, in order
        interval = f"{edges[k]:.3g} to {edges[k + 1]:.3g}" if count > 1 else f"{low:.3g}"
        labels = [f"{name} {value:.4g} {unit}".strip() for value in values[mask]]
        rows.append(marked(mask, f"{interval} {unit}".strip(), STEPS[k], links, labels))
    return rows


def marked(
    mask: np.ndarray,
    name: str,
    color: str,
    links: Sequence[Sequence[str]] = (),
    labels: Sequence[str] = (),
) -> Layer:
    """Cells of a mask as boxes.

    Args:
        mask: Flags of the cells, (ny, nx).
        name: Name in the legend.
        color: Colour, as ``#rrggbb``.
        links: Address that a click on a cell opens, (ny, nx) or empty.
        labels: Tooltip of each marked cell, in the order of `np.nonzero`.
    """
    rows, columns = (array(at) for at in np.nonzero(mask))
    targets = [links[int(i)][int(j)] for i, j in zip(rows, columns, strict=True)] if links else ()
    return Layer(
        name,
        columns - 0.5,
        rows - 0.5,
        color,
        BOXES,
        1.2,
        columns + 0.5,
        rows + 0.5,
        labels,
        targets,
    )


def haloed(layer: Layer) -> list[Layer]:
    """A black line or dots on a white copy, visible on cells of any colour.

    Args:
        layer: The layer; its colour is not used.
    """
    wider = layer.size + (1.5 if layer.shape == DOTS else 2.0)
    white = replace(layer, color="#ffffff", size=wider, shape=DOTS if layer.shape == DOTS else LINE)
    return [white, replace(layer, color="#000000")]


def outline(mask: np.ndarray, name: str, color: str) -> Layer:
    """Outline of the cells of a mask.

    Args:
        mask: Flags of the cells, (ny, nx).
        name: Name in the legend.
        color: Colour, as ``#rrggbb``.
    """
    padded = np.pad(mask, 1)
    sides = []
    for i, j in np.argwhere(padded[1:, :] != padded[:-1, :]):
        sides += [(j - 1.5, i - 0.5), (j - 0.5, i - 0.5), (np.nan, np.nan)]
    for i, j in np.argwhere(padded[:, 1:] != padded[:, :-1]):
        sides += [(j - 0.5, i - 1.5), (j - 0.5, i - 0.5), (np.nan, np.nan)]
    x, y = array(sides).reshape(-1, 2).T
    return Layer(name, x, y, color, LINE, 2.0)
