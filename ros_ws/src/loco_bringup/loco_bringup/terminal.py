# SPDX-License-Identifier: Apache-2.0
"""Terminal output of all commands: console, progress bars, tables."""

from __future__ import annotations

import sys
from collections.abc import Iterable

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

console = Console(highlight=False, markup=False, soft_wrap=True)


def bar(*columns: str) -> Progress:
    """Progress bar on stderr; disabled if stderr is not a terminal."""
    text_columns = [TextColumn(column) for column in columns]
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(bar_width=30),
        *text_columns,
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=not sys.stderr.isatty(),
    )


def table(title: str, columns: Iterable[str], rows: Iterable[Iterable[str]]) -> Table:
    """Table of texts without borders; long cells are wrapped."""
    t = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for column in columns:
        t.add_column(column, overflow="fold")
    for row in rows:
        t.add_row(*row)
    return t
