# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco crash`: a table with one row per command."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from loco_bringup.terminal import bar, console
from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.files import check_writable, write_whole

from ..reliability.figures import keep
from . import crash

FULL = "full disks"
HEAD = ("command", *crash.WAYS, FULL, "ends with the same bytes", "torn files", "left over")


def show_crash(a: argparse.Namespace) -> int:
    """Disturb long commands and compare; returns 1 if a result differs, else 0.

    Raises:
        NameUnknownError: There is no such command.
        ParameterError: A number is below 0.
    """
    for what in ("kills", "disks"):
        if getattr(a, what) < 0:
            raise ParameterError(f"--{what} must be at least 0, got {getattr(a, what)}")
    for name in a.only or ():
        if name not in crash.COMMANDS:
            raise NameUnknownError("long command", name, crash.COMMANDS)
    check_writable(a.out)
    selected, rows = a.only or list(crash.COMMANDS), []
    with bar("{task.completed}/{task.total} runs", "{task.fields[last]}") as progress:
        task = progress.add_task("crash", total=len(selected) * (a.kills + a.disks), last="")
        for name in selected:

            def tell(row: crash.Row) -> None:
                progress.update(task, advance=1, last=f"{row.command}: {row.same} the same")

            progress.update(task, last=name)
            rows.append(row := crash.run(name, a.kills, a.disks, a.seed, a.out, tell))
            _keep(a.out, row)
    text = table(rows)
    write_whole(a.out / "crash.md", text)
    console.print(text, markup=False)
    for note in [f"{row.command}: {note}" for row in rows for note in row.notes]:
        console.print(f"  {note}", markup=False)
    return int(not all(row.ok for row in rows))


def _keep(folder: Path, row: crash.Row) -> None:
    """Keep the figures of disturbances and of full disks, each only where some were made."""
    found = figures(row)
    ends = {name: found[name] for name in HEAD[-3:]}
    if any(row.hits.values()):
        keep(folder, "crash", {row.command: (row.ok, row.hits | ends)})
    if row.full:
        keep(folder, FULL, {row.command: (row.ok, {FULL: row.full} | ends)})


def figures(row: crash.Row) -> dict[str, int | str]:
    """Values of a row below `HEAD`, without the command."""
    values = (*row.hits.values(), row.full, f"{row.same} of {row.ends}", row.torn, row.left)
    return dict(zip(HEAD[1:], values, strict=True))


def table(rows: Sequence[crash.Row]) -> str:
    """Markdown table of the rows."""
    lines = [HEAD, ("---",) * len(HEAD)]
    lines += [(f"`{row.command}`", *map(str, figures(row).values())) for row in rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)
