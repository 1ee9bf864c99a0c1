# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco replay --verify`."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from ..settings import overrides
from ..terminal import bar, console
from .compare import Verdict
from .verify import verify

_MAX_SHOWN = 3  # largest number of printed differences per topic


def verify_bag(a: argparse.Namespace) -> int:
    """`loco replay --verify`: exit code 0 if all answers are identical, else 1."""
    changes = overrides(a.set, None)
    verdict = show_verify(
        a.bag, lambda report: verify(a.bag, a.layout, a.nodes, changes, a.tolerance, report)
    )
    if a.json:
        a.json.write_text(json.dumps(verdict.to_dict(), indent=1))
    return 0 if verdict.identical else 1


def show_verify(path: Path, run: Callable[[Callable[[float], None]], Verdict]) -> Verdict:
    """Run a comparison with a progress bar and print its outcome."""
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
            console.print(line)
    return verdict


def _lines(verdict: Verdict) -> Iterator[str]:
    """The first differences of each topic, in columns, with untruncated values."""
    rows, counts = [("topic", "tick", "field", "recorded", "live")], Counter[str]()
    for d in verdict.first:
        counts[d.topic] += 1
        if counts[d.topic] <= _MAX_SHOWN:
            rows.append((d.topic, str(d.tick), d.field, repr(d.recorded), repr(d.live)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = (text.ljust(width) for text, width in zip(row, widths, strict=True))
        yield "  ".join(cells).rstrip()
