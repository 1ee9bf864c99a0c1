# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco gap`: live progress, verdict, paths of the files."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from loco_control.exceptions import ParameterError
from loco_learning.gap.setup.contents import SETUP

from ..settings import merge, overrides
from ..terminal import bar, console
from . import run as runner
from . import text
from .next import write_library, write_next


def show_gap(a: argparse.Namespace) -> int:
    """Run `loco gap` with live progress.

    Returns:
        The exit code: 2 if the set-up must be corrected first.

    Raises:
        ParameterError: No recording is given, or the number of workers is below 1.
    """
    if not a.bags:
        raise ParameterError("loco gap takes at least one recording; see `loco gap --help`")
    if a.workers < 1:
        raise ParameterError(f"workers must be at least 1, got {a.workers}")
    job, folder = job_of(a)
    with bar("{task.percentage:3.0f} %", "{task.fields[best]}") as progress:
        task, tenths = progress.add_task("reading", total=1.0, best=""), [0]

        def report(share: float, stage: str, best: str) -> None:
            progress.update(task, completed=share, description=stage, best=best)
            if progress.disable and int(10.0 * share) > tenths[0]:  # no terminal: one line per 10 %
                tenths[0] = int(10.0 * share)
                sys.stderr.write(f"{10 * tenths[0]:3d} % {stage} {best}".rstrip() + "\n")

        result = runner.run(job, folder, report)
    show(result, folder)
    return 2 if result["verdict"] == SETUP else 0


def job_of(a: argparse.Namespace) -> tuple[runner.Job, Path]:
    """The job that the options describe, and the folder of the results.

    Raises:
        LocoError: The options contradict each other.
    """
    choices = {"free": list(a.free), "effects": list(a.effects), "residual": a.residual}
    options = {key: value for key, value in choices.items() if value}
    options |= {} if a.seed is None else {"seed": a.seed}
    options = merge(options, overrides(a.set, None))
    if a.add:
        return _extended_job(a, options)
    options.setdefault("seed", 0)
    if not a.robot:
        raise ParameterError("loco gap wants --robot: a robot, robot.yaml, model.yaml or URDF")
    mapping = str(a.mapping) if a.mapping else ""
    workers = a.scheduler or a.workers
    job = runner.Job(a.robot, tuple(a.bags), tuple(a.hold_out), mapping, options, workers)
    return job, a.out or job.default_folder()


def _extended_job(a: argparse.Namespace, options: dict[str, Any]) -> tuple[runner.Job, Path]:
    """The job of an existing folder of results, with more recordings."""
    if len(a.bags) != 1:
        raise ParameterError("--add takes one folder of results: loco gap DIR --add BAG...")
    old = runner.load_job(a.bags[0])
    job = runner.Job(
        a.robot or old.robot, (*old.bags, *a.add), (*old.hold_out, *a.hold_out),
        str(a.mapping) if a.mapping else old.mapping, {**old.options, **options},
        a.scheduler or a.workers,
    )  # fmt: skip
    return job, a.out or Path(a.bags[0])


def show(result: Mapping[str, Any], folder: Path) -> None:
    """Print warnings about the recordings, the verdict, and the paths of the results."""
    for line in result.get("reading") or ():
        console.print(f"reading: {line}")
    console.print(f"{text.headline(result)}")
    for line in text.term_lines(result):
        console.print(f"  {line}")
    gap = text.gap_line(result)
    if gap:
        console.print(f"  {gap}")
    if result["verdict"] == "no gap" and result.get("evidence"):
        console.print(f"  {result['evidence']}")
    if learned := text.learned_line(result):
        console.print(f"  {learned}")
    for alarm in result.get("alarms") or ():
        console.print(f"  alarm: {alarm}")
    for line in text.at_the_robot(result):
        console.print(f"  to tell {line}")
    if result.get("next"):
        console.print(f"  next: loco gap next {folder}")
    console.print(f"  page: {folder / runner.PAGE}")
    if result["verdict"] != SETUP:
        console.print(f"  model: {folder / runner.MODEL}")


def show_next(a: argparse.Namespace) -> int:
    """`loco gap next`: write the proposed experiment and print the next commands."""
    path, row = write_next(a.folder, a.rank, a.out)
    console.print(f"{text.next_line(row)}")
    console.print(f"  written: {path}")
    console.print(f"  run it:  loco run {path} --out bags/{path.stem}")
    console.print(f"  then:    loco gap {a.folder} --add bags/{path.stem}")
    return 0


def show_library(a: argparse.Namespace) -> int:
    """`loco gap experiments`: write the experiments of a robot."""
    folder = a.out or Path("results") / f"experiments_{Path(a.robot).stem}"
    for path in write_library(a.robot, folder):
        console.print(f"  {path}")
    return 0
