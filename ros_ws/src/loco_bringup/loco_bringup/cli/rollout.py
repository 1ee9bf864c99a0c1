# SPDX-License-Identifier: Apache-2.0
"""`loco run --layout rollout`: run an experiment without ROS and record the same bag."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from loco_control.exceptions import ParameterError
from loco_learning.runs.experiment import Experiment, load
from loco_sim import lazy

from ..bag.writer import Limits
from ..outcome import Outcome, Progress, default_folder, duration_of
from ..settings import overrides
from ..terminal import bar, console
from .table import call

# Loads numba when it is used: the supervisor of a graph imports this module, too, and needs none.
_bag = lazy.module("loco_bringup.logs.rollout_bag")


def run(a: argparse.Namespace) -> int:
    """Run an experiment in this process; returns the exit code.

    Raises:
        ParameterError: An option concerns topics, clocks or the kernel, which a rollout lacks.
    """
    experiment = load(a.experiment, overrides(a.set, a.seed, a.engine, a.duration))
    for name in ("fault", "tick", "realtime"):
        if getattr(a, name):
            raise ParameterError(f"layout rollout has no nodes, so no --{name}; take composed")
    folder = a.out or default_folder(experiment)
    limits = Limits(a.max_bag_size, a.max_bag_duration)
    outcome = show_run(experiment, lambda tell: _bag.run_rollout(experiment, folder, tell, limits))
    return finish(outcome, a.report, a.view)


def finish(outcome: Outcome, report: bool, view: bool = False) -> int:
    """Write the report of a run and open the view if requested; returns the run's exit code."""
    if report and not outcome.interrupted:
        console.print("report:", end=" ")
        call("report", outcome.folder)
    if view and not outcome.interrupted:
        call("view", outcome.folder)
    return outcome.exit_code


def show_run(
    experiment: Experiment, start: Callable[[Callable[[Progress], None]], Outcome]
) -> Outcome:
    """Call `start`, display the `Progress` it reports in a live line, and print a summary."""
    duration = duration_of(experiment)
    columns = "{task.completed:6.1f}/{task.total:.0f} s", "{task.fields[rtf]:.1f} x real time"
    with bar(*columns, "{task.fields[phase]}") as progress:
        task = progress.add_task(experiment.name, total=duration, rtf=0.0, phase="starting")

        def show(p: Progress) -> None:
            progress.update(task, completed=p.sim_time, rtf=p.real_time_factor, phase=p.phase)

        outcome = start(show)
    state = "interrupted" if outcome.interrupted else "fell" if outcome.fallen else "done"
    console.print(f"{experiment.name}: {state}, {outcome.text}")
    speed = f"{outcome.real_time_factor:.1f} x real time, {outcome.dropped} messages dropped"
    for line in (speed, *_punctual(outcome), f"bag: {outcome.folder}"):
        console.print(f"  {line}")
    return outcome


def _punctual(outcome: Outcome) -> list[str]:
    """Lateness of the ticks of a real-time run, and the kernel settings that were granted."""
    t = outcome.timing
    lines = [] if not t else [
        f"ticks began {t['lateness_p50_ms']:.2f} ms late (median), {t['lateness_p99_ms']:.2f} ms "
        f"(99 %), {t['lateness_max_ms']:.1f} ms (worst); {t['missed_ticks']:.0f} missed, "
        f"{t['dropped_ticks']:.0f} of them dropped; {t['late_ticks']:.0f} commands late"
    ]  # fmt: skip
    return lines + outcome.granted
