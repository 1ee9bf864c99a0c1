# SPDX-License-Identifier: Apache-2.0
"""`loco reinforce`: improve a readout by reinforcement learning, with live line and summary."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.files import check_writable
from loco_control.reading import within
from loco_learning.reflex.weights import read_readout
from loco_learning.reinforce import learn
from loco_learning.reinforce.episode import checked, first_weights, kind
from loco_learning.reinforce.learn import Progress
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.reinforce.trials import Row, TrialParams, judge
from loco_learning.runs.experiment import Experiment, load

from ..settings import overrides
from ..terminal import bar, console, table
from . import page


def run(a: argparse.Namespace) -> int:
    """`loco reinforce`: improve a readout; returns the exit code."""
    experiment = checked(load(a.experiment, overrides(a.set, None, a.engine)))
    keys = ("seed", "seconds", "lead", "episode", "batch", "exploration", "step", "push")
    params = ReinforceParams(randomise=a.randomise, **{key: getattr(a, key) for key in keys})
    updates, seconds = learn.cost_of(experiment, params)
    folder = a.out or within("results", f"{experiment.name}_reinforce", "name of an experiment")
    check_writable(folder)
    start_learning(experiment, folder, a.weights, a.zero)
    console.print(
        f"{experiment.name}: {updates} updates of {params.batch + 1} episodes, at most "
        f"{seconds:g} s of simulated time"
    )
    with bar("{task.completed}/{task.total} updates", "{task.fields[now]}") as progress:
        task = progress.add_task(experiment.name, total=updates, now="starting")

        def show_progress(p: Progress) -> None:
            progress.update(task, completed=p.update, now=line(p))

        result = learn.learn(experiment, params, folder, a.workers, show_progress)
    paths = learn.write(experiment, params, folder, result.readout, a.test)
    trials = a.trials and run_trials(experiment, params.lead, folder, TrialParams(count=a.trials))
    if trials:
        console.print(compared(trials))
    paths.append(page.write(experiment, params, result, trials or {}, folder))
    console.print(
        f"return {result.first:.3f} before, {result.value:.3f} after update {result.update} of "
        f"{result.updates}; {result.seconds:g} s simulated"
    )
    for path in paths:
        console.print(f"  {path}")
    return 0


def start_learning(experiment: Experiment, folder: Path, weights: Path | None, zero: bool) -> None:
    """Write the initial readout, unless the folder already has it with a record of the learning.

    Raises:
        ParameterError: Both a file and zeros are requested, or the folder has another initial
            readout.
    """
    if weights and zero:
        raise ParameterError(f"--zero and --weights {weights} exclude each other; give one")
    start = folder / learn.START
    if not (start.is_file() and (folder / learn.RECORD).is_file()):
        teaching_time = first_weights(experiment, start, weights or "", zero)
        if teaching_time:
            console.print(f"{experiment.name}: FORCE taught the readout in {teaching_time:g} s")
        return
    stored = read_readout(start, kind(experiment))
    requested = read_readout(weights, kind(experiment)) if weights else np.zeros_like(stored)
    if (weights or zero) and not np.array_equal(requested, stored):
        raise ParameterError(
            f"{folder} holds work that began with another readout; choose another --out"
        )


def line(p: Progress) -> str:
    """State of the learning in one line."""
    text = f"return {p.value:.3f}, best {p.best:.3f}"
    if not math.isnan(p.eta):
        text += f", {p.eta / 60.0:.1f} min left"
    return f"{text}, {p.falls} fell" if p.falls else text


def run_trials(
    experiment: Experiment, lead: float, folder: Path, params: TrialParams
) -> dict[str, dict[str, Row]]:
    """Trials of the readout, by ``before`` or ``after`` and by condition."""
    files = {"before": learn.START, "after": learn.WEIGHTS}
    rows = {}
    for name, file in files.items():
        learner = experiment.learner.replace(
            weights=str(folder / file), train=lead, closing=0.0, test=params.length
        )
        start = learner.stand + lead
        rows[name] = judge(experiment.replace(learner=learner), params.replace(start=start))
    return rows


HEAD = (
    "readout", "speed [m/s]", "COT", "falls", "pushed: speed", "falls", "bodies: speed", "falls"
)  # fmt: skip


def cells(rows: dict[str, Row]) -> list[str]:
    """Cells of a table row, without the first cell with its name."""
    nominal, disturbed, bodies = (rows[name] for name in ("calm", "pushed", "bodies"))
    columns = [f"{nominal.speed:.3f}", f"{nominal.cost:.3f}", f"{nominal.falls} of {nominal.count}"]
    for row in (disturbed, bodies):
        columns += [f"{row.speed:.3f}", f"{row.falls} of {row.count}"]
    return columns


def compared(trials: dict[str, dict[str, Row]]):
    """Table of the trials for the terminal."""
    return table("", HEAD, [[name, *cells(rows)] for name, rows in trials.items()])
