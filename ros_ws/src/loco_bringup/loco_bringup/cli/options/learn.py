# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that evaluate many runs, such as study, optimise and reinforce."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from .registry import add_out, group, option
from .run import SCHEDULER, engine

command = group("Learn from many runs")


@command("study", "study.terminal:show_study",
         "run a study: variants x grid x seeds, tables and maps (resumable)")  # fmt: skip
def study(p: ArgumentParser) -> None:
    """Options of `loco study`.

    A study file lists variants of experiments, seeds, metrics and figures; with axes it is a grid:

      variants: {open: {experiment: hyq_trot_open}}
      axes:
        gait.speed: [0.1, 0.2, 0.3]                     a parameter by its dotted name
        kp: {logspace: [1, 3, 20], unit: N·m/rad, sets: [overrides.drives.*_kfe_joint.kp]}
      map: {legal: {speed_ratio: [0.7, 1.3]}}           two axes or more: maps in study.html

    A stopped study continues with the same command. After three cases the remaining time is shown.
    cases.npz has the columns of cases.csv for NumPy. Variants without randomness run for one seed.
    """
    engine(p)
    p.add_argument("study", help="name (see `loco list studies`) or path of a YAML file")
    option(p, "--workers", 2, "processes (default 2)")
    add_out(p, "results folder (default results/NAME)")
    option(p, "--seeds", int, "only the first N seeds")
    option(p, "--points", int, "points on each spaced axis of a grid, fewer or more")
    option(p, "--cost", False, "run three cases, tell the core-hours of the rest, and stop")
    option(p, "--scheduler", "", SCHEDULER)


@command("optimise", "cli.optimise:run", "search a gait by CMA-ES over rollouts (resumable)")
def optimise(p: ArgumentParser) -> None:
    """Options of `loco optimise`.

    Searches amplitudes, duty factors, offsets and phase of the oscillators for the highest
    forward speed in a rollout; a fall is worse than standing. A stopped search continues
    with the same command, to the same result.
    """
    engine(p)
    p.add_argument("gait", help="tigrillo_bound, tigrillo_walk, hyq_trot or hyq_walk")
    option(p, "--robot", "", "robot, robot.yaml or model.yaml")
    option(p, "--seeds", 1, "searches, each from its own seed")
    option(p, "--seed", 0, "first seed")
    option(p, "--evaluations", 600, "rollouts per seed (default 600)")
    option(p, "--population", 10, "rollouts per generation")
    option(p, "--sigma", 0.2, "first step size, share of the ranges")
    option(p, "--plateau", 0, "stop after so many generations without improvement")
    option(p, "--duration", 15.0, "length of a rollout [s]")
    option(p, "--frequency", 1.0, "strides per second [Hz]")
    option(p, "--randomise", 0.0, "spread of stiffness, friction and masses, e.g. 0.1", "SHARE")
    option(p, "--samples", 1, "bodies per evaluation")
    p.add_argument("--from", dest="start", type=Path, metavar="GAIT.yaml",
                   help="start from the parameters of a gait")  # fmt: skip
    option(p, "--workers", 2, "processes (default 2)")
    option(p, "--scheduler", "", SCHEDULER)
    add_out(p, "folder (default results/GAIT)")
    option(p, "--gif", False, "draw the best gait, too")


@command("reinforce", "reinforce.terminal:run",
         "improve the readout of a reflex by the policy gradient (resumable)")  # fmt: skip
def reinforce(p: ArgumentParser) -> None:
    """Options of `loco reinforce`.

    The third learning step: the readout trained by FORCE is perturbed in each episode, and changed
    towards a higher reward for speed, low power and no fall. Writes weights.npz, reinforced.yaml
    for `loco run`, and a page. A stopped run continues with the same command, to the same result.
    """
    engine(p)
    p.add_argument("experiment", help="one with a reflex network, e.g. tigrillo_bound_reflex")
    option(
        p, "--weights", Path, "trained weights to begin with (default: FORCE teaches them)", "FILE"
    )
    option(p, "--zero", False, "begin with a readout of zeros")
    option(p, "--seconds", 600.0, "budget of simulated time [s]")
    option(p, "--seed", 0, "seed of the learning")
    option(p, "--lead", 1.5, "the target drives first so long [s]")
    option(p, "--episode", 5.0, "the readout drives so long [s]")
    option(p, "--set", list, "override one value of the experiment (repeatable)", "KEY=VALUE")
    option(p, "--trials", 4, "trials of each condition before and after, 0 for none")
    option(p, "--test", 60.0, "length of the run that reinforced.yaml describes [s]")
    option(p, "--batch", 12, "perturbed episodes per update")
    option(p, "--exploration", 0.03, "rms of a perturbation at the joints [rad]", "RAD")
    option(p, "--step", 1.0, "learning rate, in perturbations")
    option(p, "--push", 0.0, "random pushes while it learns, e.g. 0.1 of the weight", "SHARE")
    option(p, "--randomise", 0.0, "spread of stiffness, friction and masses, e.g. 0.1", "SHARE")
    option(p, "--workers", 2, "processes (default 2)")
    add_out(p, "folder (default results/NAME_reinforce)")


@command("reproduce", "reproduce.terminal:run",
         "run experiments of the thesis again, claim by claim (resumable)")  # fmt: skip
def reproduce(p: ArgumentParser) -> None:
    """Options of `loco reproduce`.

    tigrillo: chapter 5; msd: chapter 6; hyq: chapters 7 and 9; clock: chapter 8; all: every claim.
    The rules are in loco_learning/thesis/claims.yaml, the runs of each plan in plans.yaml in the
    same folder. A stopped plan continues with the same command.
    """
    p.add_argument("what", choices=("tigrillo", "msd", "hyq", "clock", "all"))
    option(p, "--quick", False, "the plan quick: a few minutes")
    option(p, "--plan", "full", "quick, medium, full (default), mujoco (chapters 7 to 9 of full), "
           "or a YAML file")  # fmt: skip
    option(p, "--cost", False, "time three cases of each study, tell its core-hours, stop")
    p.add_argument("--preset", default="thesis", choices=("thesis", "author_code"), help="for msd")
    option(p, "--workers", 2, "processes (default 2)")
    option(p, "--scheduler", "", SCHEDULER)
    add_out(p, "results (default results/thesis_PLAN or msd_PRESET_PLAN)")
