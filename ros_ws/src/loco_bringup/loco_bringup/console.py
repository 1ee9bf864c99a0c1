# SPDX-License-Identifier: Apache-2.0
"""What a person at the terminal sees: progress lines and the summary of a run."""

from __future__ import annotations

import sys
from collections.abc import Callable

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

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
    console.print(f"  bag: {outcome.folder}")
    return outcome
