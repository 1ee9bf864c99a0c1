# SPDX-License-Identifier: Apache-2.0
"""`loco reproduce`: experiments of the thesis run again, claim by claim."""

from __future__ import annotations

import argparse
from pathlib import Path

from loco_control.exceptions import NameUnknownError, ParameterError

from .console import bar, console

WHAT = ("msd",)


def from_arguments(a: argparse.Namespace) -> int:
    """Run what is missing, judge all claims, write the page.

    Returns:
        0: a claim that disagrees is a result, too.

    Raises:
        NameUnknownError: There is nothing of that name to reproduce, or no such preset.
        ParameterError: `workers` is below 1.
    """
    if a.what not in WHAT:
        raise NameUnknownError("thing to reproduce", a.what, WHAT)
    if a.workers < 1:
        raise ParameterError(f"workers must be at least 1, got {a.workers}")
    plan = "quick" if a.quick else a.plan
    return reproduce_msd(plan, a.preset, a.out, a.workers, a.scheduler)


def reproduce_msd(
    plan: str, preset: str, folder: Path | None = None, workers: int = 2, scheduler: str = ""
) -> int:
    """Chapter 6, mass-spring-damper networks."""
    from loco_learning import msd_jobs, msd_page
    from loco_sim.msd.params import preset as known

    known(preset)
    folder = folder or Path("results") / f"msd_{preset}_{plan}"
    with bar("{task.completed}/{task.total} runs", "{task.fields[last]}") as progress:
        task = progress.add_task(f"msd, {preset}", total=None, last="")

        def tell(done: int, total: int, name: str) -> None:
            progress.update(task, completed=done, total=total, last=name)

        msd_jobs.run(plan, preset, folder / "runs", workers, scheduler, tell)
    page, verdicts = msd_page.write(plan, preset, folder / "runs", folder)
    for v in verdicts:
        console.print(f"{v.claim:>5}  {v.verdict:<12} {v.wanted}\n       found: {v.found}")
    counts = [
        f"{sum(v.verdict == word for v in verdicts)} {word}"
        for word in ("agrees", "disagrees", "not decided")
    ]
    console.print(f"{', '.join(counts)}; page: {page}")
    return 0
