# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco calibrate --live` and `loco gap --live`: live progress and summary."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from typing import Any

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict

from ..bag.reader import Bag
from ..calibrate.terminal import options
from ..outcome import default_folder
from ..report.live_log import read_live
from ..report.report import write_report
from ..terminal import bar, console
from . import run as runner


def show_calibration(a: argparse.Namespace) -> int:
    """Calibrate a running model against a running robot; returns the exit code.

    Raises:
        LocoError: An option is wrong or not available in a live calibration.
    """
    if a.bag is not None:
        raise ParameterError("loco calibrate takes either a bag or --live")
    reject_options(a, ("validate", "scheduler"))
    return show(a, runner.Calibration, options(a), a.robot)


def show_gap(a: argparse.Namespace) -> int:
    """Find the gap between two running robots; returns the exit code.

    Raises:
        LocoError: An option is wrong or not available in a live search.
    """
    reject_options(a, ("bags", "hold_out", "add", "mapping"))
    values = {"seed": a.seed or 0, "effects": a.effects, "free": a.free}
    return show(a, runner.GapSearch, values, a.robot)


def reject_options(a: argparse.Namespace, names: Sequence[str]) -> None:
    """Raise a `ParameterError` for options that are not available live."""
    for name in names:
        if getattr(a, name):
            option = name if name == "bags" else f"--{name.replace('_', '-')}"
            raise ParameterError(f"{option} does not go with --live")


def show(a: argparse.Namespace, kind: type[runner.Client], selected: Any, robot: str | None) -> int:
    """Run an action with a progress line; returns the exit code.

    Args:
        a: Parsed command line.
        kind: Client of the action.
        selected: Settings of the action.
        robot: Initial model; None for the measured robot without its effects.
    """
    measured = runner.measured_robot(a.measured)
    live = from_dict(runner.LiveParams, {"speed": a.speed}, "live")
    folder, calibrates = a.out or default_folder(measured), kind is runner.Calibration
    total = selected.generations if calibrates else 1.0
    done = "{task.completed}/{task.total} gen" if calibrates else "{task.percentage:3.0f} %"
    with bar(done, "{task.fields[state]}") as progress:
        task = progress.add_task("starting", total=total, state="")

        def show_progress(p: runner.LiveProgress) -> None:
            gap = f"gap {p.gaps[-1].gap:.3f} rad" if p.gaps else ""
            best = p.found if math.isnan(p.best) else f"best {p.best:.4g}"
            state, completed = f"{p.sim_time:6.1f} s  {best}  {gap}", p.generation or p.share
            progress.update(task, description=p.phase, completed=completed, state=state)

        robot = robot or measured.plant.name
        outcome = runner.run_live(kind, measured, robot, folder, selected, live, show_progress)
    what = "live calibration" if calibrates else "live gap"
    console.print(f"{what}: {outcome.status or 'interrupted'}, {outcome.run.text}")
    if outcome.status == "done":
        run = read_live(Bag(outcome.folder))
        before, after = run.error(run.before), run.error(run.after)
        console.print(f"  gap over topics: {before:.3f} rad before, {after:.3f} rad after")
        console.print(f"  page: {write_report(run.bag)}")
    console.print(f"  bag: {outcome.folder}")
    return outcome.exit_code
