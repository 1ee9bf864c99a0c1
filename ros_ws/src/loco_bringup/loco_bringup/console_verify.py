# SPDX-License-Identifier: Apache-2.0
"""What a person sees of `loco replay --verify`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

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
        console.print("First differences")
        for line in _lines(verdict):
            console.print(line, markup=False)
    return verdict


def _lines(verdict: Verdict) -> Iterator[str]:
    """The first differences of each topic, in columns; values are not cut."""
    rows, shown = [("topic", "tick", "field", "recorded", "live")], Counter[str]()
    for d in verdict.first:
        shown[d.topic] += 1
        if shown[d.topic] <= _SHOWN:
            rows.append((d.topic, str(d.tick), d.field, repr(d.recorded), repr(d.live)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (text.ljust(width) for text, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()
