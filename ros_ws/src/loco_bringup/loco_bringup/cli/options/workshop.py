# SPDX-License-Identifier: Apache-2.0
"""Options of the commands for developers of loco."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from .gap import add_out
from .registry import group

command = group("Work on loco itself")


@command("install", "cli.install:install",
         "install what only some commands need: view, rl, lerobot, dynamixel and more")  # fmt: skip
def install(p: ArgumentParser) -> None:
    """Options of `loco install`."""
    p.description += "\n\nIn a clone `./loco install` takes the versions of its lock file."
    p.add_argument("extra", nargs="+", help="view, rl, ppo, lerobot, cluster, dynamixel, battery, "
                   "docs, test or ros")  # fmt: skip


@command("completion", "cli.listing:show_completion", "print what makes a shell complete loco: "
         "eval \"$(loco completion bash)\" or zsh")  # fmt: skip
def completion(p: ArgumentParser) -> None:
    """Options of `loco completion`."""
    p.description += """

  echo 'eval "$(loco completion bash)"' >> ~/.bashrc
  echo 'eval "$(loco completion zsh)"' >> ~/.zshrc
"""
    p.add_argument("shell", choices=("bash", "zsh"), help="shell that reads it")


command("test", "loco_workshop.tests:run_tests", "run the tests (arguments go to pytest)")(None)


@command("bench", "loco_workshop.bench.bench:show_bench", "measure speed beside named baselines")
def bench(p: ArgumentParser) -> None:
    """Options of `loco bench`."""
    p.add_argument("what", help="rls, graph, messages, bag, damage, msd, population, realtime, "
                   "effects, bolted, engines or ground")  # fmt: skip
    p.add_argument("--json", type=Path, help="write the rows to this file too")
    p.add_argument("--seconds", type=float, help="realtime: length of a measurement (default 60)")
    p.add_argument("--rate", type=float, help="realtime: ticks per second (default 250)")
    p.add_argument("--layout", help="realtime: composed (default) or processes")


@command("gap battery", "loco_workshop.battery.terminal:show_battery",
         "many hidden effects: how often `loco gap` names the right one")  # fmt: skip
def battery(p: ArgumentParser) -> None:
    """Options of `loco gap battery`."""
    p.description += "\n\nMakes cases with a hidden effect, runs the workflow on their bags, " \
        "scores it."  # fmt: skip
    p.add_argument("--cases", type=int, default=20, help="number of cases (default 20)")
    p.add_argument("--seed", type=int, default=1, help="seed of everything drawn (default 1); "
                   "below 1000 for development")  # fmt: skip
    p.add_argument("--robots", nargs="+", default=[], metavar="NAME", help="default: all that are "
                   "held; hyq_trot and a1_trot walk, and take minutes a case")  # fmt: skip
    p.add_argument("--effects", nargs="+", default=[], metavar="NAME",
                   help="only single effects, of these names or patterns")  # fmt: skip
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--limit", type=float, default=900.0, help="seconds per case (default 900)")
    p.add_argument("--baselines", nargs="*", metavar="NAME",
                   help="everything, sparse, cma, sysid (default: all, sysid if "
                   "`./loco install battery` was run; none of robots that walk)")  # fmt: skip
    p.add_argument("--follow", action="store_true", help="where the verdict is ambiguous, run the "
                   "experiment that it proposes on the robot, and look again")  # fmt: skip
    p.add_argument("--settings", type=int, default=0, metavar="N", help="ask each name again under "
                   "N of 26 other settings: pieces of 0.5 or 2 s, another record that judges, an "
                   "accuracy of 1 or 3 %% (default 0)")  # fmt: skip
    p.add_argument("--bags-only", action="store_true", help="make the cases, run nothing")
    add_out(p, "folder of the battery (default results/gap_battery_SEED)")


@command("chaos", "loco_workshop.stress.chaos_terminal:show_chaos",
         "stop, kill and damage everything, and judge the robot (resumable)")  # fmt: skip
def chaos(p: ArgumentParser) -> None:
    """Options of `loco chaos`."""
    p.description += """

Signals: SIGSTOP and SIGKILL to each process of the HyQ graph, at random moments.
Faults: every kind of `loco run --fault`, and pairs of them, on every topic.
docs/faults.md says what has to happen each time. Stop it and start it again: it goes on.
  loco chaos --repeats 1 --only SIGKILL       a quick look at some of it
  loco chaos --only faults_motion_command
"""
    p.add_argument("--repeats", type=int, default=20, help="runs of each cell (default 20)")
    p.add_argument("--seed", type=int, default=0, help="seed of moments and draws")
    p.add_argument("--only", default="", metavar="TEXT",
                   help="cells whose name has it, e.g. SIGSTOP, faults_stance")  # fmt: skip
    p.add_argument("--out", type=Path, default=Path("results/chaos"), help="results folder")


@command("crash", "loco_workshop.stress.crash_terminal:show_crash", "kill long commands and fill "
         "their disk, and see whether they come to the same end")  # fmt: skip
def crash(p: ArgumentParser) -> None:
    """Options of `loco crash`."""
    p.description += """

optimise, study, gap, gap battery, reproduce and calibrate, small: each is killed with all its
processes, or its disk gets full; it is started again, and all files are compared byte by byte with
those of a run that was left alone. Exit code 1: something differs, is torn or left over.
  loco crash --kills 2 --disks 1 --only study
"""
    p.add_argument("--kills", type=int, default=20, help="kills of each command (default 20)")
    p.add_argument("--disks", type=int, default=5, help="full disks of each (default 5)")
    p.add_argument("--seed", type=int, default=0, help="seed of moments and sizes")
    p.add_argument("--only", nargs="+", metavar="NAME", help="these commands only")
    p.add_argument("--out", type=Path, default=Path("results/crash"), help="results folder")


@command("fuzz", "loco_workshop.fuzz.terminal:show_fuzz", "damage input for the parsers of files, "
         "texts and messages (exit code 1: a find)")  # fmt: skip
def fuzz(p: ArgumentParser) -> None:
    """Options of `loco fuzz`."""
    p.description += (
        "\n\nA find is an input whose answer is not one error of ours: a traceback, an end of the"
        "\nprocess, or none within 10 s of processor time. Each is kept as a file with what it did,"
        "\nand damaged further by the next run with the same --out."
        "\n  loco fuzz --damage flip --inputs 10000"
    )
    p.add_argument("target", nargs="?", default="all",
                   help="experiment, robot, model, gait, study, node_set, mapping, csv, json, gz, "
                   "npz, urdf, bag, mcap, messages or all (default)")  # fmt: skip
    p.add_argument("--minutes", type=float, default=2.0, help="wall time in all (default 2)")
    p.add_argument("--inputs", type=int, default=0, metavar="N",
                   help="as many inputs instead, in equal shares")  # fmt: skip
    p.add_argument("--damage", default="any",
                   help="any (default), cut (truncations) or flip (one byte each)")  # fmt: skip
    p.add_argument("--workers", type=int, default=2, help="targets at a time (default 2)")
    p.add_argument("--seed", type=int, default=0, help="seed of all damage")
    p.add_argument("--out", type=Path, default=Path("results/fuzz"), help="folder of the finds")


@command("mutants", "loco_workshop.mutants.terminal:show_mutants", "change the code that protects, "
         "and see whether tests notice (exit code 1: too few)")  # fmt: skip
def mutants(p: ArgumentParser) -> None:
    """Options of `loco mutants`."""
    p.description += (
        "\n\nEach mutant is one small change (a comparison, a sign, a number, a call left out) in a"
        "\ncopy of the sources, on which the tests of that module run. Those that no test notices"
        "\nare listed. Stop it and start it again: it goes on."
    )
    p.add_argument("--only", default="", metavar="TEXT", help="modules whose path has it: safety")
    p.add_argument("--limit", type=int, default=0, metavar="N",
                   help="mutants of each module, drawn at random (default all)")  # fmt: skip
    p.add_argument("--seed", type=int, default=0, help="seed of the draw")
    p.add_argument("--workers", type=int, default=2, help="mutants tested at a time (default 2)")
    p.add_argument("--by-hand", action="store_true", help="only those made by hand")
    p.add_argument("--survivors", action="store_true",
                   help="after a change of tests: only what they had not noticed")  # fmt: skip
    p.add_argument("--out", type=Path, default=Path("results/mutants"), help="results folder")


@command("soak", "loco_workshop.stress.soak_terminal:show_soak",
         "run a graph for long and see whether anything grows (exit code 1: it does)")  # fmt: skip
def soak(p: ArgumentParser) -> None:
    """Options of `loco soak`."""
    p.description += (
        "\n\nMemory, descriptors, threads and /dev/shm of each process, once a second."
        "\nOnly events and diagnostics are recorded, and the bag is removed at the end."
    )
    p.add_argument("experiment", nargs="?", default="hyq_trot_reflex", help="as in `loco run`")
    p.add_argument("--ticks", type=int, default=1_000_000, help="how long (default 1,000,000)")
    p.add_argument("--layout", default="composed", help="composed or processes")
    p.add_argument("--clock", default="lockstep", help="lockstep, asap or realtime")
    p.add_argument("--out", type=Path, help="folder of table and picture (default results/soak)")


@command("docs", "loco_workshop.docs.reference:show_docs",
         "print the generated tables of docs/ (topics, parameters)")  # fmt: skip
def docs(p: ArgumentParser) -> None:
    """Options of `loco docs`."""
    p.add_argument("--write", action="store_true", help="write them into docs/")
    p.add_argument("--figures", action="store_true", help="draw the pictures of the effects anew")
    p.add_argument("--site", action="store_true", help="build all pages as a site")
    p.add_argument("--out", default="site", help="folder of the site (default: site)")
