# SPDX-License-Identifier: Apache-2.0
"""What a person at the terminal sees: progress lines and the summary of a run."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from loco_control.exceptions import ParameterError
from loco_learning.experiment import Experiment

from . import run as runner

console = Console(highlight=False, soft_wrap=True)


def bar(*columns: str) -> Progress:
    """Progress bar on stderr; plain and silent when that is not a terminal."""
    texts = [TextColumn(column) for column in columns]
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        *texts,
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=not sys.stderr.isatty(),
    )


def show_run(
    experiment: Experiment, start: Callable[[Callable[[runner.Progress], None]], runner.Outcome]
) -> runner.Outcome:
    """Run something that reports `Progress`, with a live line, and print its summary."""
    duration = runner.duration_of(experiment)
    columns = "{task.completed:6.1f}/{task.total:.0f} s", "{task.fields[rtf]:.1f} x real time"
    with bar(*columns, "{task.fields[phase]}") as progress:
        task = progress.add_task(experiment.name, total=duration, rtf=0.0, phase="starting")

        def tell(p: runner.Progress) -> None:
            progress.update(task, completed=p.sim_time, rtf=p.real_time_factor, phase=p.phase)

        outcome = start(tell)
    state = "interrupted" if outcome.interrupted else "fell" if outcome.fallen else "done"
    console.print(f"{experiment.name}: {state}, {outcome.text}")
    console.print(
        f"  {outcome.real_time_factor:.1f} x real time, {outcome.dropped} messages dropped"
    )
    for line in _punctual(outcome):
        console.print(f"  {line}")
    console.print(f"  bag: {outcome.folder}")
    return outcome


def _punctual(outcome: runner.Outcome) -> list[str]:
    """What a run of the clock realtime says of its ticks, and the kernel of its requests."""
    t = outcome.timing
    lines = [] if not t else [
        f"ticks began {t['lateness_p50_ms']:.2f} ms late (median), {t['lateness_p99_ms']:.2f} ms "
        f"(99 %), {t['lateness_max_ms']:.1f} ms (worst); {t['missed_ticks']:.0f} missed, "
        f"{t['dropped_ticks']:.0f} of them dropped; {t['late_ticks']:.0f} commands late"
    ]  # fmt: skip
    return lines + outcome.granted


def show_study(name: str, out: Path | None, workers: int, seeds: int | None) -> int:
    """Run what is missing of a study; print its table and write table and figures.

    Returns:
        0 when every case ran, whatever its verdict: a failed trial is a result.

    Raises:
        ParameterError: `workers` or `seeds` is below 1.
    """
    from loco_learning import figures, study

    for what, value in (("workers", workers), ("seeds", 1 if seeds is None else seeds)):
        if value < 1:
            raise ParameterError(f"{what} must be at least 1, got {value}")
    loaded = study.load(name)
    if seeds:
        loaded = dataclasses.replace(loaded, seeds=loaded.seeds[:seeds])
    folder = out or Path("results") / loaded.name
    total = len(list(loaded.cases()))
    with bar("{task.completed}/{task.total} runs", "{task.fields[last]}") as progress:
        task = progress.add_task(loaded.name, total=total, last="")

        def tell(done: int, _: int, result: Any) -> None:
            verdict = "survived" if result.verdict["survived"] else "failed"
            progress.update(task, completed=done, last=f"{result.name} {verdict}")

        results = study.run(loaded, folder, workers, tell)
    console.print(loaded.description)
    for row in figures.rows(loaded, results):
        end = "survived" if row["survived"] else f"failed by {row['failed']}"
        values = ", ".join(f"{m} {row[m]:.4g}" for m in loaded.metrics)
        console.print(f"  {row['variant']} seed {row['seed']}: {end}; {values}")
    console.print(_upright(figures.summary(results)))
    for path in figures.write(loaded, results, folder):
        console.print(f"  {path}")
    return 0


def _upright(rows: list[dict[str, Any]]) -> Table:
    """One column per row, so that many figures fit a terminal."""
    table = Table(box=None)
    for key in [next(iter(rows[0])), *(next(iter(row.values())) for row in rows)]:
        table.add_column(str(key), justify="right")
    for key in list(rows[0])[1:]:
        cells = [row[key] for row in rows]
        table.add_row(key, *(f"{v:.4g}" if isinstance(v, float) else str(v) for v in cells))
    return table
