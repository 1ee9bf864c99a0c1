# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco gap battery`: progress with remaining time, then the score."""

from __future__ import annotations

import argparse
from pathlib import Path
from statistics import median

from loco_bringup.terminal import bar, console
from loco_control.files import check_writable

from . import bags
from . import battery as gap_battery
from .page import write_score


def show_battery(a: argparse.Namespace) -> int:
    """Run `loco gap battery` with a progress bar and print the score; returns the exit code."""
    gap_battery.check(a)
    folder = a.out or Path("results") / f"gap_battery_{a.seed}"
    check_writable(folder)
    with bar("{task.completed}/{task.total} cases", "{task.fields[last]}") as progress:
        task = progress.add_task("battery", total=a.cases, last="")

        def tell(done: int, name: str, said: str) -> None:
            progress.update(task, completed=done, last=f"{name} {said}")

        results = gap_battery.run(a, folder, tell)
    if a.bags_only:
        console.print(f"bags in {folder}")
        return 0
    for line in write_score(folder, results):
        console.print(line)
    if seconds := bags.times(folder, "search"):
        console.print(f"median {median(seconds):.1f} s per case, in {folder / bags.TIMES}")
    return 0
