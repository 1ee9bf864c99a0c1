# SPDX-License-Identifier: Apache-2.0
"""Style of a report's figures: one colour per meaning, shaded phases."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_learning.drawing.chart import Chart
from loco_learning.params import OPEN
from loco_learning.runs.log import Log

from .plot import Plot

# Colours of Okabe and Ito, safe for colour-blind readers. The target is a broad pale line, so
# that a thin line on top of it remains visible.
TARGET, COMMAND, MEASURED = "#8cc5ea", "#d55e00", "#222222"
OTHER = "#0072b2"  # signals other than these three
BOUND = "#222222"
BROAD = 3.0  # line width of a target [pixel]
TINTS = {"stand": "#f1f1f1", "train": "#e3eef7", "closing": "#fdf0d5", "test": "#e2f3ea"}
TINTS[OPEN] = TINTS["train"]


def spans(log: Log) -> list[tuple[str, str, float, float]]:
    """Colour, name, start and end [s] of the phases that the run reached."""
    return [
        (TINTS[name], name, float(log.t[s.start]), float(log.t[s.stop - 1]) + log.dt)
        for name, s in log.phases().items()
    ]


def flag_spans(t: np.ndarray, flag: np.ndarray, dt: float) -> list[tuple[float, float]]:
    """Start and length [s] of each interval in which a flag is true."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], flag, [False])).astype(int)))
    return [
        (float(t[a]), float(t[b - 1] - t[a]) + dt)
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]


@dataclass(frozen=True)
class Chapter:
    """One figure of a report."""

    title: str
    text: str  # description for readers
    draw: Callable[[Any], Plot | Chart]  # argument: a log


def chapters() -> tuple[list[Chapter], Callable]:
    """List of a report's figures in order, and the decorator that appends one.

    The decorator takes the title and the text for readers, by default what the docstring says
    below its first line. The decorated function raises `BagError` if the bag lacks its data.
    """
    listed: list[Chapter] = []

    def chapter(title: str, text: str = "") -> Callable:
        def register(draw: Callable[[Any], Plot | Chart]) -> Callable[[Any], Plot | Chart]:
            caption = text or " ".join(inspect.getdoc(draw).partition("\n")[2].split())
            listed.append(Chapter(title, caption, draw))
            return draw

        return register

    return listed, chapter
