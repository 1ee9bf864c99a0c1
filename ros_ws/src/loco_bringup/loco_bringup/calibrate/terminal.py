# SPDX-License-Identifier: Apache-2.0
"""`loco calibrate` at the terminal: live progress and summary."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict
from loco_learning.calibration import results
from loco_learning.calibration.mawe import UNITS
from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.progress import Generation
from loco_learning.calibration.results import Comparison, Result

from ..terminal import bar, console
from . import run as runner

HEAD = ("parameter", "unit", "default", "calibrated", "", "thesis")


def options(a: argparse.Namespace) -> CalibrationParams:
    """Settings from the parsed command line.

    Raises:
        LocoError: A value is out of range, or a name is unknown.
    """
    changes = {"parameters": a.parameters, "loss": a.loss, "seed": a.seed}
    if a.generations is not None:
        changes["generations"] = a.generations
    return from_dict(CalibrationParams, changes, "calibrate")


def show_calibration(a: argparse.Namespace) -> int:
    """Run `loco calibrate` with live progress.

    Returns:
        The exit code.

    Raises:
        ParameterError: No bag is given.
    """
    if a.bag is None:
        raise ParameterError("loco calibrate takes either a bag or --live")
    job = runner.prepare(
        a.bag, a.robot, options(a), a.validate, a.seeds, a.out, a.workers, a.scheduler
    )
    max_generations = job.options.generations
    with bar("{task.completed}/{task.total} gen", "{task.fields[state]}") as progress:
        tasks, began = {}, {}

        def show_progress(seed: int, g: Generation) -> None:
            if seed not in tasks:
                tasks[seed] = progress.add_task(f"seed {seed}", total=max_generations, state="")
                began[seed] = (time.perf_counter(), g.evaluations)
            start, first = began[seed]
            elapsed = time.perf_counter() - start
            rate = (g.evaluations - first) / elapsed if elapsed > 0.0 else math.nan
            state = f"best {g.best:.4g}  step {g.sigma:.3f}  {rate:.1f}/s"
            progress.update(tasks[seed], completed=g.index, state=state)

        result = runner.calibrate(job, show_progress)
    show(result, job.folder)
    return 0


def show(result: Result, folder: Path) -> None:
    """Print a summary of a result and the folder that holds it."""
    if result.surrogate:
        console.print("SURROGATE: the recordings come from a simulated robot, not from a machine")
    for text, unit, default, calibrated, _, thesis in (HEAD, *results.body_table(result)[1]):
        console.print(f"  {text:45}{unit:>5}{default:>9}{calibrated:>12}  {thesis}")
    for row in result.comparisons:
        console.print(_line(result, row))
    errors = [fit.error for fit in result.fits]
    plateaus = [fit.plateau for fit in result.fits]
    console.print(
        f"  {len(errors)} searches: {min(errors):.4g} to {max(errors):.4g}; plateau at generation "
        f"{min(plateaus)} to {max(plateaus)}"
    )
    console.print(f"  page: {folder / 'calibration.html'}")


def _line(result: Result, row: Comparison) -> str:
    kind = "fitted" if row.fitted else "not fitted"
    before, after, unit = row.before[result.loss], row.after[result.loss], UNITS[result.loss]
    falls = [
        f"; the {name} model falls ({reason})"
        for name, reason in (("default", row.fall_before), ("calibrated", row.fall_after))
        if reason
    ]
    return (
        f"  {row.name} ({kind}): {before:.4g} to {after:.4g} {unit}, ratio "
        f"{row.ratio(result.loss):.2f}; robot lags by {1e3 * row.lag_after:.0f} ms{''.join(falls)}"
    )
