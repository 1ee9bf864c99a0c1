# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco calibrate --live`: live progress and summary."""

from __future__ import annotations

import argparse
import math

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict

from ..bag.reader import Bag
from ..calibrate.options import options
from ..graph.run import default_folder
from ..report.live_log import read_live
from ..report.report import write_report
from ..terminal import bar, console
from . import calibration as runner


def show_live(a: argparse.Namespace) -> int:
    """Calibrate a running model against a running robot; returns the exit code.

    Raises:
        LocoError: An option is wrong or not available in a live calibration.
    """
    if a.bag is not None:
        raise ParameterError("loco calibrate takes either a bag or --live")
    for name in ("validate", "scheduler"):
        if getattr(a, name):
            raise ParameterError(f"--{name} does not go with --live")
    measured = runner.measured_robot(a.measured)
    live = from_dict(runner.LiveParams, {"speed": a.speed}, "live")
    selected = options(a)
    folder = a.out or default_folder(measured)
    with bar("{task.completed}/{task.total} gen", "{task.fields[state]}") as progress:
        task = progress.add_task("starting", total=selected.generations, state="")

        def tell(p: runner.LiveProgress) -> None:
            progress.update(task, description=p.phase, completed=p.generation, state=_state(p))

        outcome = runner.calibrate_live(measured, a.robot, folder, selected, live, tell)
    show_outcome("live calibration", outcome)
    return outcome.exit_code


def _state(p: runner.LiveProgress) -> str:
    gap = f"gap {p.gaps[-1].gap:.3f} rad" if p.gaps else ""
    best = "" if math.isnan(p.best) else f"best {p.best:.4g}"
    return f"{p.sim_time:6.1f} s  {best}  {gap}"


def show_outcome(what: str, outcome: runner.LiveOutcome) -> None:
    """Print the result of a live run: gap before and after, paths of page and bag."""
    console.print(f"{what}: {outcome.status or 'interrupted'}, {outcome.run.text}")
    if outcome.status == "done":
        run = read_live(Bag(outcome.folder))
        before, after = run.error(run.before), run.error(run.after)
        console.print(f"  gap over topics: {before:.3f} rad before, {after:.3f} rad after")
        console.print(f"  page: {write_report(run.bag)}")
    console.print(f"  bag: {outcome.folder}")
