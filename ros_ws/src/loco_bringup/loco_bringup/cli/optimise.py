# SPDX-License-Identifier: Apache-2.0
"""`loco optimise`: search a gait from several seeds, with live progress and a summary."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from rich.table import Table

from loco_control.exceptions import ParameterError
from loco_control.files import check_writable
from loco_learning.drawing import png
from loco_learning.gaits import figures as gait_figures
from loco_learning.gaits import search as gait_search
from loco_learning.gaits.legged import problem_of
from loco_learning.gaits.search import GaitSearchParams
from loco_learning.runs import gait_file
from loco_learning.search.population import PopulationParams, Progress

from ..terminal import bar, console


def run(a: argparse.Namespace) -> int:
    """`loco optimise`: search a gait from several seeds; resumes the search in the folder.

    Writes ``seed_N/evaluations.jsonl`` and ``seed_N/gait.yaml`` per seed, the best gait as
    ``gait.yaml``, ``convergence.png`` and on request ``gait.gif``.

    Returns:
        0 if the best gait walks, 3 if it falls.

    Raises:
        ParameterError: The number of seeds is below 1, or a parameter of the search is invalid.
    """
    params = GaitSearchParams(
        **{key: getattr(a, key) for key in ("gait", "frequency", "duration", "randomise")},
        robot=a.robot or a.gait.split("_")[0],
        samples=a.samples,
    )
    keys = ("seed", "sigma", "population", "evaluations", "plateau", "workers", "scheduler")
    options = PopulationParams(**{key: getattr(a, key) for key in keys})
    if a.seeds < 1:
        raise ParameterError(f"seeds must be at least 1, got {a.seeds}")
    folder = a.out or Path("results") / params.gait
    check_writable(folder)
    first = gait_file.load(a.start).parameters if a.start else None
    results = []
    for seed in range(options.seed, options.seed + a.seeds):
        place = folder / f"seed_{seed}"
        gait, optimum = search(params, options.replace(seed=seed), place, first)
        gait.save(place / "gait.yaml")
        results.append((gait, optimum, place))
    best, optimum, _ = min(results, key=lambda item: item[1].value)
    best.save(folder / "gait.yaml")
    figure = gait_figures.convergence([place for *_, place in results], params.gait)
    png.write(figure, folder / "convergence.png")
    if a.gif:
        gait_figures.animate(best, folder / "gait.gif")
    console.print(_table(results))
    for path in sorted(p for p in folder.iterdir() if p.is_file()):
        console.print(f"  {path}")
    if optimum.reason:
        console.print(f"  even the best gait failed: {optimum.reason}")
    return 3 if optimum.reason else 0


def search(params: GaitSearchParams, options: PopulationParams, place: Path, first: Any) -> Any:
    """Gait and optimum of a search from one seed, which tells its progress in a live line."""
    budget = options.evaluations
    with bar("{task.completed}/{task.total} evaluations", "{task.fields[now]}") as progress:
        name = f"{params.gait} seed {options.seed}"
        task = progress.add_task(name, total=budget, now="starting")

        def show_progress(p: Progress) -> None:
            progress.update(task, completed=min(p.evaluations, budget), now=line(p))

        return gait_search.search(
            params, options, place, first, show_progress, problem_of(params.gait)
        )


def line(p: Progress) -> str:
    """State of a search in one line."""
    text = f"generation {p.generation}, best {p.best:.4g}, step {p.sigma:.3g}"
    if not math.isnan(p.rate):
        text += f", {p.rate:.2f} evaluations/s, {p.eta / 60.0:.1f} min left"
    if p.failures:
        text += f", {p.failures} failed ({p.reason})"
    return text


def _table(results: list[tuple]) -> Table:
    table = Table(box=None)
    for column in ("seed", "speed [m/s]", "distance [m]", "on other bodies", "falls", "end"):
        table.add_column(column, justify="right", no_wrap=True)
    for gait, optimum, _ in results:
        c = gait.check
        table.add_row(
            str(gait.seed),
            f"{gait.speed:.4f}",
            f"{gait.distance:.3f}",
            f"{c['speed_mean']:.4f}",
            f"{c['falls']:.0f} of {c['bodies']:.0f}",
            optimum.ended,
        )
    return table
