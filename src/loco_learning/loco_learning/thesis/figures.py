# SPDX-License-Identifier: Apache-2.0
"""Figures of a plan's evidence: 7.5 to 7.7 of the thesis, and the trials on rough ground."""

from __future__ import annotations

import logging
from collections.abc import Callable

import numpy as np

from ..drawing import heat
from ..drawing.chart import Axis, Chart, Frame, dots, line
from ..study import figures as study_figures
from ..study import maps
from .evidence import Evidence, column
from .registry import NotRunError

log = logging.getLogger(__name__)
BLUE, RED = "#0072b2", "#d55e00"
COMPARED = (
    ("cost_of_transport", "cost of transport [-]", True), ("power", "power [W]", True),
    ("speed", "speed [m/s]", False), ("step_length", "step length [m]", False),
    ("accuracy_author", "accuracy [-]", False), ("grf_max", "largest force [N]", False),
)  # fmt: skip


def figure_7_5(evidence: Evidence) -> Chart:
    """Regions of stiffness and damping: pale where the rule places one, full where it is found."""
    study, cases = evidence.study("map")
    return maps.region_map(maps.sheets(study, cases)[0], study.map, page="map/study.html")


def figure_7_6(evidence: Evidence) -> Chart:
    """Open and closed loop over stiffness: the closed loop's cost should rise steeply."""
    _, cases = evidence.study("stiffness")
    kp = np.array([case.at["kp"] for case in cases])
    frames = []
    for metric, label, log_scale in COMPARED:
        layers = []
        for phase, colour, name in (("train", BLUE, "open loop"), ("test", RED, "closed loop")):
            values, positions = column(cases, metric, phase), np.unique(kp)
            means = [np.nanmean(values[kp == place]) for place in positions]
            layers += [
                dots(name, kp, values, colour, size=2.0),
                line(name, positions, means, colour),
            ]
        x = Axis("stiffness [N·m/rad]", logarithmic=True)
        frames.append(Frame(x, Axis(label, logarithmic=log_scale), layers))
    return Chart(frames)


def figure_7_7(evidence: Evidence) -> Chart:
    """Accuracy over memory and neurons, empty where it fell: on soft legs it should grow."""
    study, cases = evidence.study("complexity")
    sheets, frames = maps.sheets(study, cases)[:2], []
    every = np.concatenate([sheet.columns["accuracy"].ravel() for sheet in sheets])
    for sheet in sheets:
        layers = heat.cells(sheet.columns["accuracy"], "-", name="accuracy", scale=every)
        x, y = ([f"{value:g}" for value in axis.values] for axis in (sheet.x, sheet.y))
        axes = Axis("memory M [ticks]", names=x), Axis("neurons N [-]", names=y)
        frames.append(Frame(*axes, layers, sheet.title))
    return Chart(frames)


def figure_terrain(evidence: Evidence) -> Chart:
    """Beyond the thesis: trials with (PSE) and without the clock (RSE) on rough ground."""
    return study_figures.survival(*evidence.study("terrain"))


FIGURES: tuple[Callable[[Evidence], Chart], ...] = (
    figure_7_5, figure_7_6, figure_7_7, figure_terrain,
)  # fmt: skip


def charts(evidence: Evidence) -> list[tuple[str, str, Chart]]:
    """Name, caption and chart of all figures for which there are results.

    Args:
        evidence: Results of the runs.
    """
    drawn = []
    for draw in FIGURES:
        try:
            charts_by_name = draw(evidence)
        except NotRunError as error:
            log.info("no %s: %s", draw.__name__, error)
            continue
        number = draw.__name__.removeprefix("figure_").replace("_", ".")
        caption = f"Figure {number}: {draw.__doc__ or ''}".replace("Figure terrain: ", "")
        drawn.append((draw.__name__, caption, charts_by_name))
    return drawn
