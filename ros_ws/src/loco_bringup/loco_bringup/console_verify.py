# SPDX-License-Identifier: Apache-2.0
"""What a person sees of `loco replay --verify`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rich.table import Table

from .console import bar, console
from .replay_compare import Verdict

_SHOWN = 3  # differences of each topic


def show_verify(path: Path, run: Callable[[Callable[[float], None]], Verdict]) -> Verdict:
    """Run a comparison with a progress bar and print what it found."""
    with bar("{task.percentage:3.0f} %") as progress:
        task = progress.add_task(path.name, total=1.0)
        verdict = run(lambda share: progress.update(task, completed=share))
    counts = f"{verdict.ticks} ticks, {verdict.compared.total()} messages"
    if verdict.identical:
        console.print(f"{path}: identical ({counts})")
        return verdict
    console.print(f"{path}: {verdict.trouble or 'different'} ({counts})")
    for topic, count in verdict.different.items():
        console.print(f"  {topic}: {count} of {verdict.compared[topic]} messages differ")
    if verdict.first:
        console.print(_table(verdict))
    return verdict


def _table(verdict: Verdict) -> Table:
    table = Table(title="First differences", title_justify="left", box=None, pad_edge=False)
    for column in ("topic", "tick", "field", "recorded", "live"):
        table.add_column(column)
    shown: Counter[str] = Counter()
    for d in verdict.first:
        shown[d.topic] += 1
        if shown[d.topic] <= _SHOWN:
            table.add_row(d.topic, str(d.tick), d.field, repr(d.recorded), repr(d.live))
    return table
