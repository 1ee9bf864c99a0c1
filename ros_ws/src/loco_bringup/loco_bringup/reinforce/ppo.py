# SPDX-License-Identifier: Apache-2.0
"""`loco reinforce ppo`: learn the same readout with PPO of stable-baselines3."""

from __future__ import annotations

import argparse

from loco_control.files import check_writable
from loco_control.reading import within
from loco_learning.reinforce import learn
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.reinforce.ppo import learn_by_ppo
from loco_learning.reinforce.trials import TrialParams

from ..terminal import bar, console
from .terminal import begin, compared, loaded, tried


def run(a: argparse.Namespace) -> int:
    """`loco reinforce ppo`: learn a readout; returns the exit code."""
    experiment = loaded(a)
    params = ReinforceParams(seed=a.seed, seconds=a.seconds, lead=a.lead, episode=a.episode)
    folder = a.out or within("results", f"{experiment.name}_ppo", "name of an experiment")
    check_writable(folder)
    begin(experiment, folder, a.weights, a.zero)
    with bar("{task.completed:.0f}/{task.total:.0f} s simulated") as progress:
        task = progress.add_task(experiment.name, total=params.seconds)
        readout, seconds = learn_by_ppo(
            experiment, params, folder / learn.START,
            lambda done: progress.update(task, completed=done),
        )  # fmt: skip
    paths = learn.write(experiment, params, folder, readout, a.test)
    if a.trials:
        console.print(compared(tried(experiment, a.lead, folder, TrialParams(count=a.trials))))
    console.print(f"{seconds:g} s simulated")
    for path in paths:
        console.print(f"  {path}")
    return 0
