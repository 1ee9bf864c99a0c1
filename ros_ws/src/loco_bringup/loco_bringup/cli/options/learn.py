# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that evaluate many runs, such as study, optimise and reinforce."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from .registry import group
from .run import SCHEDULER, engine

command = group("Learn from many runs")

GRID = """

A study file names variants of experiments, seeds, metrics and figures; with axes it is a grid:

  variants: {open: {experiment: hyq_trot_open}}
  axes:
    gait.speed: [0.1, 0.2, 0.3]                     a parameter by its dotted name
    kp: {logspace: [1, 3, 20], unit: N·m/rad, sets: [overrides.drives.*_kfe_joint.kp]}
  map: {legal: {speed_ratio: [0.7, 1.3]}}           two axes or more: maps in study.html

Stop it and start it again: it goes on. The cost of the rest is told after three cases.
cases.npz holds the columns of cases.csv for NumPy. Seeds repeat only what is random.
"""


@command("study", "study.terminal:show_study",
         "run a study: variants x grid x seeds, tables and maps (resumable)")  # fmt: skip
def study(p: ArgumentParser) -> None:
    """Options of `loco study`."""
    engine(p)
    p.description += GRID
    p.add_argument("study", help="name (see `loco list studies`) or path of a YAML file")
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--out", type=Path, help="results folder (default results/NAME)")
    p.add_argument("--seeds", type=int, help="only the first N seeds")
    p.add_argument("--points", type=int, help="points on each spaced axis of a grid, fewer or more")
    p.add_argument("--cost", action="store_true",
                   help="run three cases, tell the core-hours of the rest, and stop")  # fmt: skip
    p.add_argument("--scheduler", default="", help=SCHEDULER)


@command("optimise", "cli.optimise:run", "search a gait by CMA-ES over rollouts (resumable)")
def optimise(p: ArgumentParser) -> None:
    """Options of `loco optimise`."""
    engine(p)
    p.description += (
        "\n\nThe oscillators' amplitudes, duty factors, offsets and phase for the highest forward\n"
        "speed over a rollout; a fall is worse than standing. Stop it and start it again with\n"
        "the same arguments: it goes on to the same end."
    )
    p.add_argument("gait", help="tigrillo_bound, tigrillo_walk, hyq_trot or hyq_walk")
    p.add_argument("--robot", default="", help="robot, robot.yaml or model.yaml")
    p.add_argument("--seeds", type=int, default=1, help="searches, each from its own seed")
    p.add_argument("--seed", type=int, default=0, help="first seed")
    p.add_argument("--evaluations", type=int, default=600, help="rollouts per seed (default 600)")
    p.add_argument("--population", type=int, default=10, help="rollouts per generation")
    p.add_argument("--sigma", type=float, default=0.2, help="first step size, share of the ranges")
    p.add_argument("--plateau", type=int, default=0,
                   help="stop after so many generations without improvement")  # fmt: skip
    p.add_argument("--duration", type=float, default=15.0, help="length of a rollout [s]")
    p.add_argument("--frequency", type=float, default=1.0, help="strides per second [Hz]")
    p.add_argument("--randomise", type=float, default=0.0, metavar="SHARE",
                   help="spread of stiffness, friction and masses, e.g. 0.1")  # fmt: skip
    p.add_argument("--samples", type=int, default=1, help="bodies per evaluation")
    p.add_argument("--from", dest="start", type=Path, metavar="GAIT.yaml",
                   help="start from the parameters of a gait")  # fmt: skip
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--scheduler", default="", help=SCHEDULER)
    p.add_argument("--out", type=Path, help="folder (default results/GAIT)")
    p.add_argument("--gif", action="store_true", help="draw the best gait, too")


@command("reinforce", "reinforce.terminal:run",
         "improve the readout of a reflex by the policy gradient (resumable)")  # fmt: skip
def reinforce(p: ArgumentParser) -> None:
    """Options of `loco reinforce`."""
    p.description += """

The third learning step: the readout that FORCE taught is perturbed, episode by episode, and
moved to what is paid better: speed, less power, no fall. Writes weights.npz, reinforced.yaml,
which `loco run` plays, and a page. Stop it and start it again with the same arguments: it goes
on to the same end."""
    _episodes(p)
    p.add_argument("--batch", type=int, default=12, help="perturbed episodes per update")
    p.add_argument("--exploration", type=float, default=0.03, metavar="RAD",
                   help="rms of a perturbation at the joints [rad]")  # fmt: skip
    p.add_argument("--step", type=float, default=1.0, help="learning rate, in perturbations")
    p.add_argument("--push", type=float, default=0.0, metavar="SHARE",
                   help="random pushes while it learns, e.g. 0.1 of the weight")  # fmt: skip
    p.add_argument("--randomise", type=float, default=0.0, metavar="SHARE",
                   help="spread of stiffness, friction and masses, e.g. 0.1")  # fmt: skip
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")


@command("reinforce ppo", "reinforce.ppo:run", "the same readout by PPO of stable-baselines3")
def reinforce_ppo(p: ArgumentParser) -> None:
    """Options of `loco reinforce ppo`."""
    p.description += "\n\nNeeds `./loco install ppo`: stable-baselines3, and PyTorch with it."
    _episodes(p)


def _episodes(p: ArgumentParser) -> None:
    """Options that both methods to reinforce a readout share."""
    engine(p)
    p.add_argument("experiment", help="one with a reflex network, e.g. tigrillo_bound_reflex")
    p.add_argument("--weights", type=Path, metavar="FILE",
                   help="trained weights to begin with (default: FORCE teaches them)")  # fmt: skip
    p.add_argument("--zero", action="store_true", help="begin with a readout of zeros")
    p.add_argument("--seconds", type=float, default=600.0, help="budget of simulated time [s]")
    p.add_argument("--seed", type=int, default=0, help="seed of the learning")
    p.add_argument("--lead", type=float, default=1.5, help="the target drives first so long [s]")
    p.add_argument("--episode", type=float, default=5.0, help="the readout drives so long [s]")
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                   help="override one value of the experiment (repeatable)")  # fmt: skip
    p.add_argument("--trials", type=int, default=4,
                   help="trials of each condition before and after, 0 for none")  # fmt: skip
    p.add_argument("--test", type=float, default=60.0,
                   help="length of the run that reinforced.yaml describes [s]")  # fmt: skip
    p.add_argument("--out", type=Path, help="folder (default results/NAME_reinforce or _ppo)")


@command("reinforce contest", "reinforce.contest:run",
         "CMA-ES, two steps, three steps and PPO on equal simulated time (resumable)")  # fmt: skip
def reinforce_contest(p: ArgumentParser) -> None:
    """Options of `loco reinforce contest`."""
    engine(p)
    p.add_argument("--seconds", type=float, default=600.0, help="simulated time of each way [s]")
    p.add_argument("--seeds", type=int, default=5, help="seeds of each way (default 5)")
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--out", type=Path, help="results folder (default results/reinforce_contest)")


@command("reproduce", "reproduce.terminal:run",
         "run experiments of the thesis again, claim by claim (resumable)")  # fmt: skip
def reproduce(p: ArgumentParser) -> None:
    """Options of `loco reproduce`."""
    p.description += """

tigrillo: chapter 5; msd: chapter 6; hyq: chapters 7 and 9; clock: chapter 8; all: every claim.
The rules stand in loco_learning/thesis/claims.yaml, what each plan runs in plans.yaml beside it.
Stop it and start it again: it goes on."""
    p.add_argument("what", choices=("tigrillo", "msd", "hyq", "clock", "all"))
    p.add_argument("--quick", action="store_true", help="the plan quick: a few minutes")
    p.add_argument(
        "--plan",
        default="full",
        help="quick, medium, full (default), mujoco (chapters 7 to 9 of full), or a YAML file",
    )
    p.add_argument("--cost", action="store_true",
                   help="time three cases of each study, tell its core-hours, stop")  # fmt: skip
    p.add_argument("--preset", default="thesis", choices=("thesis", "author_code"), help="for msd")
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--scheduler", default="", help=SCHEDULER)
    p.add_argument("--out", type=Path, metavar="DIR",
                   help="results (default results/thesis_PLAN or msd_PRESET_PLAN)")  # fmt: skip
