# SPDX-License-Identifier: Apache-2.0
"""`loco reinforce contest`: compare four methods to learn a gait on equal simulated time."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable

import numpy as np

from loco_bringup.terminal import bar, console, table
from loco_control.files import check_writable, write_whole
from loco_control.reading import within

from . import contest
from .contest import METHODS, Case, ContestParams

HEAD = (
    "way", "seeds", "speed [m/s]", "COT", "falls", "pushed: speed", "falls", "bodies: speed",
    "falls",
)  # fmt: skip
MEASURES = (("calm", "speed"), ("calm", "cost"), ("calm", "falls"), ("pushed", "speed"),
            ("pushed", "falls"), ("bodies", "speed"), ("bodies", "falls"))  # fmt: skip


def run(a: argparse.Namespace) -> int:
    """`loco reinforce contest`: run the comparison; returns the exit code."""
    params = ContestParams(seconds=a.seconds, seeds=a.seeds)
    folder = a.out or within("results", "reinforce_contest", "name of a folder")
    check_writable(folder)
    total = len(METHODS) * params.seeds
    console.print(
        f"{total} cases of {params.seconds:g} s of simulated time, and "
        f"{3 * params.trials.count * (params.trials.start + params.trials.length):g} s of trials "
        "for each"
    )
    with bar("{task.completed}/{task.total} cases", "{task.fields[now]}") as progress:
        task = progress.add_task("contest", total=total, now="starting")

        def show_progress(case: Case, done: int, count: int) -> None:
            progress.update(task, completed=done, now=f"{case.method}, seed {case.seed}")

        cases = contest.run(params, folder, a.workers, show_progress)
    console.print(table("mean, smallest … largest of the seeds", HEAD, rows(cases)))
    for reason in sorted({f"{c.method}: {c.reason}" for c in cases if c.reason}):
        console.print(f"  without a controller, {reason}")
    path = write_whole(folder / "table.md", markdown(cases))
    console.print(f"  {path}")
    return 0


def rows(cases: list[Case]) -> list[list[str]]:
    """Table rows, one for each method that has cases with a controller."""
    result = []
    for method in METHODS:
        its = [case for case in cases if case.method == method and not case.reason]
        if its:
            cells = [_cell(its, condition, key) for condition, key in MEASURES]
            result.append([method, str(len(its)), *cells])
    return result


def _cell(cases: list[Case], condition: str, key: str) -> str:
    values = [case.rows[condition][key] for case in cases]
    if key == "falls":
        return f"{sum(values)} of {sum(case.rows[condition]['count'] for case in cases)}"
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return "–"
    return f"{np.mean(finite):.3f} ({min(finite):.3f} … {max(finite):.3f})"


def markdown(cases: list[Case]) -> str:
    """Markdown text: a table of the methods, and a table of all cases."""
    lines: Callable[[list[str]], str] = lambda cells: f"| {' | '.join(cells)} |"  # noqa: E731
    text = [lines(list(HEAD)), lines(["---"] * len(HEAD)), *map(lines, rows(cases)), ""]
    head = ["way", "seed", "simulated [s]", *(f"{c} {k}" for c, k in MEASURES)]
    text += [lines(head), lines(["---"] * len(head))]
    for case in cases:
        values = [case.rows[c][k] if case.rows else math.nan for c, k in MEASURES]
        formatted = [f"{v:.4g}" if math.isfinite(v) else "–" for v in values]
        text.append(lines([case.method, str(case.seed), f"{case.seconds:.0f}", *formatted]))
    return "\n".join(text) + "\n"
