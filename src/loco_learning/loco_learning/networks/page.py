# SPDX-License-Identifier: Apache-2.0
"""Page and tables of chapter 6: verdicts with numbers, figures, and a table of all runs."""

from __future__ import annotations

import csv
from pathlib import Path

from loco_control.files import write_whole
from loco_sim.msd.params import PRESETS

from ..drawing import png
from ..drawing.chart import Chart
from . import figures as msd_figures
from .claims import Verdict, judge
from .results import Results, author_power, load

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


def write(
    name: str, preset: str, data: Path, folder: Path
) -> tuple[str, list[Verdict], dict[str, Chart]]:
    """Write README.md, figures and gaits.csv for the results of a plan.

    Args:
        name: Name of the plan.
        preset: Name of the preset.
        data: Folder of the runs.
        folder: Output folder.

    Returns:
        Title, verdicts, and charts by their number in the thesis.
    """
    folder.mkdir(parents=True, exist_ok=True)
    results = load(name, preset, data)
    verdicts = judge(results)
    drawn = msd_figures.charts(results)
    for number, chart in drawn.items():
        png.write(chart, folder / picture(number))
    _table(results, folder / "gaits.csv")
    title = f"Chapter 6, preset {preset}, {name} plan"
    lines = [
        f"# {title}",
        "",
        f"{PRESETS[preset].about}. Made by `loco reproduce msd --plan {name}"
        f" --preset {preset}`; every run with its seed is in [gaits.csv](gaits.csv).",
        "",
        "| claim | thesis | wanted | found | verdict |",
        "| --- | --- | --- | --- | --- |",
        *(f"| {v.claim} | {v.item} | {v.wanted} | {v.found} | **{v.verdict}** |" for v in verdicts),
        "",
    ]
    for number, caption in CAPTIONS.items():
        if number in drawn:
            image = f"![{caption}]({picture(number)})"
            lines += [f"## Figure {number}", "", f"{caption}.", "", image, ""]
    write_whole(folder / "README.md", "\n".join(lines))
    return title, verdicts, drawn


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
