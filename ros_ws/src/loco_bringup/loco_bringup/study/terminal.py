# SPDX-License-Identifier: Apache-2.0
"""`loco study`: run many cases with progress and cost; write tables, figures and maps."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any

from rich.table import Table

from loco_control.exceptions import ParameterError
from loco_control.files import check_writable
from loco_control.reading import within
from loco_learning.study import figures, study
from loco_learning.study.case import CaseResult
from loco_learning.study.study import Study

from ..terminal import bar, console
from . import page

MOST_ROWS = 40  # largest number of cases printed; cases.csv has all


def show_study(a: argparse.Namespace) -> int:
    """Run the missing cases of a study; print its table, write tables, figures and maps.

    Returns:
        0 if every case ran, also if trials failed, which is a valid result.

    Raises:
        ParameterError: The number of workers, seeds or points is below 1.
    """
    for what in ("workers", "seeds", "points"):
        value = getattr(a, what)
        if value is not None and value < 1:
            raise ParameterError(f"{what} must be at least 1, got {value}")
    loaded = study.load(a.study, overrides={"sim.engine": a.engine} if a.engine else None)
    if a.seeds:
        loaded = dataclasses.replace(loaded, seeds=loaded.seeds[: a.seeds])
    if a.points:
        loaded = loaded.with_points(a.points)
    folder = a.out or within("results", loaded.name, "name of a study")
    results = run_study(loaded, folder, a.workers, a.scheduler, a.cost)
    if a.cost:
        return 0
    console.print(loaded.description)
    for row in figures.rows(loaded, results) if len(results) <= MOST_ROWS else ():
        end = "survived" if row["survived"] else f"failed by {row['failed']}"
        values = ", ".join(f"{m} {row[m]:.4g}" for m in loaded.metrics)
        place = "".join(f" {axis.name} {row[axis.name]:.4g}" for axis in loaded.axes)
        console.print(f"  {row['variant']}{place} seed {row['seed']}: {end}; {values}")
    console.print(_upright(figures.summary(results)))
    for path in write(loaded, results, folder):
        console.print(f"  {path}")
    return 0


def run_study(
    loaded: Study, folder: Path, workers: int, scheduler: str = "", only_cost: bool = False
) -> list[CaseResult]:
    """Estimate the cost of a study, then run it with a progress bar and the remaining time.

    Args:
        loaded: The study.
        folder: Folder of the results.
        workers: Number of processes.
        scheduler: Address of a dask scheduler to use instead of processes.
        only_cost: Stop after the estimate of the cost.
    """
    if not only_cost:
        check_writable(folder)
    total = sum(1 for _ in loaded.cases())
    with bar("{task.completed}/{task.total} runs", "{task.fields[last]}") as progress:
        task = progress.add_task(loaded.name, total=total, last="")

        def show_progress(done: int, _: int, result: Any) -> None:
            verdict = "survived" if result.verdict["survived"] else "failed"
            progress.update(task, completed=done, last=f"{result.name} {verdict}")

        def on_cost(cost: study.Cost) -> bool:
            progress.console.print(f"{loaded.name}: {cost}")
            return not only_cost

        return study.run(loaded, folder, workers, show_progress, scheduler, on_cost)


def write(loaded: Study, results: list[CaseResult], folder: Path) -> list[Path]:
    """Write tables, figures and the page; for a grid of at least two axes also its maps."""
    return [*figures.write(loaded, results, folder), page.write(loaded, results, folder)]


def _upright(rows: list[dict[str, Any]]) -> Table:
    """Transposed table, one column per row, so that many values fit a terminal."""
    table = Table(box=None)
    for key in [next(iter(rows[0])), *(next(iter(row.values())) for row in rows)]:
        table.add_column(str(key), justify="right")
    for key in list(rows[0])[1:]:
        cells = [row[key] for row in rows]
        table.add_row(key, *(f"{v:.4g}" if isinstance(v, float) else str(v) for v in cells))
    return table
