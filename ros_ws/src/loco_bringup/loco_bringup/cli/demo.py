# SPDX-License-Identifier: Apache-2.0
"""`loco demo`: run, record, replay and report one experiment."""

from __future__ import annotations

import argparse

from loco_learning.runs.experiment import load

from ..bag.reader import Bag
from ..graph import run as runner
from ..outcome import default_folder
from ..record.replayer import replay_bag
from ..report.report import write_report
from ..terminal import console
from .run import show_run

EXPERIMENT = "hyq_trot_reflex"


def run_demo(a: argparse.Namespace) -> int:
    """Run the demo experiment, replay its bag and write its report; returns the exit code."""
    experiment = load(EXPERIMENT)
    folder = a.out or default_folder(experiment)
    console.rule("1 of 3: a HyQ learns to trot by reflex, over ROS 2 topics")
    outcome = show_run(experiment, lambda show: runner.run(experiment, folder, on_progress=show))
    if outcome.exit_code:
        return outcome.exit_code
    console.rule("2 of 3: its bag, replayed onto the topics as fast as it goes")
    code = replay_bag(folder, speed=0.0)
    if code:
        return code
    console.rule("3 of 3: its report")
    page = write_report(folder)
    console.print(f"report: {page}\nGIF:    {page.with_name('gait.gif')}")
    console.print(f"bag:    {Bag(folder).path}\nlook closer with: loco info {folder}")
    return 0
