# SPDX-License-Identifier: Apache-2.0
"""Figures of chapter 6 and a table of its searches."""

from __future__ import annotations

import csv
from pathlib import Path

from ..drawing import png
from ..drawing.chart import Chart
from . import figures as msd_figures
from .results import Results, author_power

CAPTIONS = {
    "6.1": "Score of the best gait over the number of nodes",
    "6.2": "Course of four optimisations",
    "6.3": "Speed and power of the best gaits, without noise",
    "6.4": "Score over the frequency of actuation",
    "6.5": "Speed under a budget of power",
    "6.7": "Distance under noise on the actuation, open loop",
    "6.8": "Error of the readout while it learns, 20 nodes",
    "6.9": "Distance in the last 10 s, open and closed loop",
    "6.10": "Filtered accelerations of the test in two principal components",
    "6.11": "Error of the readout over the number of nodes",
}


def write(results: Results, folder: Path) -> dict[str, Chart]:
    """Write the figures and gaits.csv.

    Args:
        results: Results of a plan.
        folder: Output folder.

    Returns:
        Charts by their number in the thesis.
    """
    folder.mkdir(parents=True, exist_ok=True)
    drawn = msd_figures.charts(results)
    for number, chart in drawn.items():
        png.write(chart, folder / picture(number))
    _table(results, folder / "gaits.csv")
    return drawn


def picture(number: str) -> str:
    """File name of a figure."""
    return f"figure_{number.replace('.', '_')}.png"


def _table(results: Results, path: Path) -> None:
    """Write one row per optimisation."""
    columns = (
        "experiment", "nodes", "frequency", "power_ref", "seed", "evaluations", "best", "clean",
        "retested", "speed", "power", "author_power",
    )  # fmt: skip
    with open(path, "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(columns)
        for kind in ("gaits", "omega", "powers"):
            for _, g in sorted(getattr(results, kind).items()):
                done = len(g.course) * g.population
                values = (g.best, g.clean, g.retested.mean(), g.speed, g.power, author_power(g))
                rows.writerow(
                    [kind, g.task.nodes, f"{float(g.gait.frequency):.4g}", f"{g.task.power_ref:g}",
                     g.task.seed, done, *(f"{float(v):.4g}" for v in values)]
                )  # fmt: skip
