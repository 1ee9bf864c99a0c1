# SPDX-License-Identifier: Apache-2.0
"""Figures of a plan's evidence: 7.5 to 7.7 of the thesis, and the trials on rough ground."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from loco_control.files import write_whole

from ..study import figures as study_figures
from ..study import maps
from ..study.figures import new as new_figure
from .evidence import Evidence, column
from .registry import NotRunError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

log = logging.getLogger(__name__)
BLUE, RED = "#34568b", "#c0392b"
COMPARED = (
    ("cost_of_transport", "cost of transport [-]", True), ("power", "power [W]", True),
    ("speed", "speed [m/s]", False), ("step_length", "step length [m]", False),
    ("accuracy", "accuracy [-]", False), ("grf_max", "largest force [N]", False),
)  # fmt: skip


def figure_7_5(evidence: Evidence) -> Figure:
    """Regions of stiffness and damping: pale where the rule places one, full where it is found."""
    study, cases = evidence.study("map")
    return maps.region_map(maps.sheets(study, cases)[0], study.map)


def figure_7_6(evidence: Evidence) -> Figure:
    """Open and closed loop over stiffness: the closed loop's cost should rise steeply."""
    _, cases = evidence.study("stiffness")
    kp = np.array([case.at["kp"] for case in cases])
    made, axes = new_figure(3, (10.0, 5.6), rows=2, sharex=True)
    for ax, (metric, label, log_scale) in zip(axes.flat, COMPARED, strict=True):
        for phase, colour, name in (("train", BLUE, "open"), ("test", RED, "closed")):
            values = column(cases, metric, phase)
            places = np.unique(kp)
            means = [np.nanmean(values[kp == place]) for place in places]
            ax.plot(kp, values, ".", color=colour, ms=4, alpha=0.5)
            ax.plot(places, means, color=colour, lw=1.4, label=f"{name} loop")
        ax.set(ylabel=label, xscale="log", yscale="log" if log_scale else "linear")
    for ax in axes[1]:
        ax.set_xlabel("stiffness [N·m/rad]")
    axes[0, 0].legend(frameon=False)
    return made


def figure_7_7(evidence: Evidence) -> Figure:
    """Accuracy over memory and neurons, white where it fell: on soft legs it should grow."""
    study, cases = evidence.study("complexity")
    made, axes = new_figure(2, (9.0, 3.8), sharey=True)
    for ax, sheet in zip(axes, maps.sheets(study, cases), strict=False):
        mesh = ax.pcolormesh(sheet.x.values, sheet.y.values, sheet.columns["accuracy"],
                             shading="nearest", cmap="viridis")  # fmt: skip
        made.colorbar(mesh, ax=ax, label="accuracy [-]")
        ax.set(title=sheet.title, xlabel="memory M [ticks]")
    axes[0].set_ylabel("neurons N")
    return made


def figure_terrain(evidence: Evidence) -> Figure:
    """Beyond the thesis: trials with (PSE) and without the clock (RSE) on rough ground."""
    return study_figures.survival(evidence.study("terrain")[1])


FIGURES: tuple[Callable[[Evidence], Figure], ...] = (
    figure_7_5, figure_7_6, figure_7_7, figure_terrain,
)  # fmt: skip


def write(evidence: Evidence, folder: Path) -> list[tuple[Path, str]]:
    """Draw all figures that the evidence allows; returns their files and captions."""
    drawn = []
    for draw in FIGURES:
        try:
            made = draw(evidence)
        except NotRunError as error:
            log.info("no %s: %s", draw.__name__, error)
            continue
        path = folder / f"{draw.__name__}.png"
        write_whole(path, partial(made.savefig, format="png"))
        number = draw.__name__.removeprefix("figure_").replace("_", ".")
        drawn.append(
            (path, f"Figure {number}: {draw.__doc__ or ''}".replace("Figure terrain: ", ""))
        )
    return drawn
