# SPDX-License-Identifier: Apache-2.0
"""Options of the commands for developers of loco, which exist in a clone alone."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from loco_bringup.cli.options.registry import add_out, group, option
from loco_bringup.cli.options.run import engine

command = group("Work on loco itself")

command("test", "loco_workshop.tests:run_tests", "run the tests (arguments go to pytest)")(None)


@command("bench", "loco_workshop.bench.bench:show_bench", "measure speed beside named baselines")
def bench(p: ArgumentParser) -> None:
    """Options of `loco bench`."""
    p.add_argument("what", help="rls, graph, messages, bag, damage, msd, population, realtime, "
                   "effects, bolted, engines or ground")  # fmt: skip
    option(p, "--json", Path, "write the rows to this file too")
    option(p, "--seconds", float, "realtime: length of a measurement (default 60)")
    option(p, "--rate", float, "realtime: ticks per second (default 250)")
    option(p, "--layout", str, "realtime: composed (default) or processes")


@command("gap battery", "loco_workshop.battery.terminal:show_battery",
         "many hidden effects: how often `loco gap` names the right one")  # fmt: skip
def battery(p: ArgumentParser) -> None:
    """Options of `loco gap battery`.

    Makes cases with hidden effects, runs `loco gap` on their bags, and scores the answers.
    """
    option(p, "--cases", 20, "number of cases (default 20)")
    option(p, "--seed", 1, "seed of everything drawn (default 1); below 1000 for development")
    p.add_argument("--robots", nargs="+", default=[], metavar="NAME", help="default: all listed "
                   "that are held; drawn: another random robot in each case (drawn3: of at most "
                   "3 joints); hyq_trot and a1_trot walk, and take minutes a case")  # fmt: skip
    p.add_argument("--effects", nargs="+", default=[], metavar="NAME",
                   help="only single effects, of these names or patterns")  # fmt: skip
    option(p, "--workers", 2, "processes (default 2)")
    option(p, "--limit", 900.0, "seconds per case (default 900)")
    p.add_argument("--baselines", nargs="*", metavar="NAME",
                   help="everything, sparse, cma, sysid (default: all, sysid if "
                   "`./loco install battery` was run; none of robots that walk)")  # fmt: skip
    p.add_argument("--follow", nargs="?", type=int, const=1, default=0, metavar="N",
                   help="while the verdict is ambiguous, run the experiment that it proposes on "
                   "the robot, and look again: at most N times (default 1)")  # fmt: skip
    option(p, "--settings", 0, "ask each name again with N of 6 other divisions of the data: in "
           "reverse order, another held-out record, first or second halves, halves as records, "
           "another seed (default 0)", "N")  # fmt: skip
    option(p, "--bags-only", False, "make the cases, run nothing")
    add_out(p, "folder of the battery (default results/gap_battery_SEED)")


@command("reinforce contest", "loco_workshop.contest_terminal:run",
         "CMA-ES, two steps, three steps and PPO on equal simulated time (resumable)")  # fmt: skip
def reinforce_contest(p: ArgumentParser) -> None:
    """Options of `loco reinforce contest`."""
    engine(p)
    option(p, "--seconds", 600.0, "simulated time of each way [s]")
    option(p, "--seeds", 5, "seeds of each way (default 5)")
    option(p, "--workers", 2, "processes (default 2)")
    add_out(p, "results folder (default results/reinforce_contest)")


@command("chaos", "loco_workshop.stress.chaos_terminal:show_chaos",
         "stop, kill and damage everything, and judge the robot (resumable)")  # fmt: skip
def chaos(p: ArgumentParser) -> None:
    """Options of `loco chaos`.

    Signals: SIGSTOP and SIGKILL to each process of the HyQ graph, at random moments.
    Faults: every kind of `loco run --fault`, and pairs of them, on every topic.
    docs/faults.md has the required reactions. A stopped run continues with the same command.
      loco chaos --repeats 1 --only SIGKILL       a short run
      loco chaos --only faults_motion_command
    """
    option(p, "--repeats", 20, "runs of each cell (default 20)")
    option(p, "--seed", 0, "seed of moments and draws")
    option(p, "--only", "", "cells whose name has it, e.g. SIGSTOP, faults_stance", "TEXT")
    add_out(p, "results folder (default results/chaos)", default=Path("results/chaos"))


@command("crash", "loco_workshop.stress.crash_terminal:show_crash", "kill long commands and fill "
         "their disk, and see whether they come to the same end")  # fmt: skip
def crash(p: ArgumentParser) -> None:
    """Options of `loco crash`.

    Runs small cases of optimise, study, gap, gap battery, reproduce and calibrate. Each is
    interrupted by SIGKILL, SIGINT, SIGSTOP, a second run in the same folder, or a full disk, and
    continued. All files are compared byte by byte with those of an uninterrupted run. Exit code 1:
    a file differs, is incomplete or left over.
      loco crash --kills 2 --disks 1 --only study
    """
    option(p, "--kills", 20, "disturbances of each command (default 20)")
    option(p, "--disks", 5, "full disks of each (default 5)")
    option(p, "--seed", 0, "seed of moments and sizes")
    p.add_argument("--only", nargs="+", metavar="NAME", help="these commands only")
    add_out(p, "results folder (default results/crash)", default=Path("results/crash"))


@command("fuzz", "loco_workshop.fuzz.terminal:show_fuzz", "damage input for the parsers of files, "
         "texts and messages (exit code 1: a find)")  # fmt: skip
def fuzz(p: ArgumentParser) -> None:
    """Options of `loco fuzz`.

    A find is an input that does not give one line of error: a traceback, a crash of the process, or
    no answer within 10 s of processor time. Each is kept as a file with its result, and damaged
    further by the next run with the same --out.
      loco fuzz --damage flip --inputs 10000
    """
    p.add_argument("target", nargs="?", default="all", help="default all; a wrong name lists them")
    option(p, "--minutes", 2.0, "wall time in all (default 2)")
    option(p, "--inputs", 0, "as many inputs instead, in equal shares", "N")
    option(p, "--damage", "any", "any (default), cut (truncations) or flip (one byte each)")
    option(p, "--workers", 2, "targets at a time (default 2)")
    option(p, "--seed", 0, "seed of all damage")
    add_out(p, "folder of the finds (default results/fuzz)", default=Path("results/fuzz"))


@command("mutants", "loco_workshop.mutants.terminal:show_mutants", "change the code that protects, "
         "and see whether tests notice (exit code 1: too few)")  # fmt: skip
def mutants(p: ArgumentParser) -> None:
    """Options of `loco mutants`.

    Each mutant is one small change (a comparison, a sign, a number, a removed call) in a
    copy of the sources. The tests of that module run on it, then the others of their folder
    and those that import it. Mutants that no test detects are listed. A stopped run continues
    with the same command.
    """
    option(p, "--only", "", "modules whose path has it: safety", "TEXT")
    option(p, "--limit", 0, "mutants in all, drawn at random (default all)", "N")
    option(p, "--seed", 0, "seed of the draw")
    option(p, "--workers", 2, "mutants tested at a time (default 2)")
    option(p, "--by-hand", False, "only those made by hand")
    option(p, "--survivors", False, "after a change of tests: only what they had not noticed")
    add_out(p, "results folder (default results/mutants)", default=Path("results/mutants"))


@command("soak", "loco_workshop.stress.soak_terminal:show_soak",
         "run a graph for long and see whether anything grows (exit code 1: it does)")  # fmt: skip
def soak(p: ArgumentParser) -> None:
    """Options of `loco soak`.

    Measures memory, descriptors, threads and /dev/shm of each process, once a second.
    Only events and diagnostics are recorded, and the bag is removed at the end.
    """
    p.add_argument("experiment", nargs="?", default="hyq_trot_reflex", help="as in `loco run`")
    option(p, "--ticks", 1_000_000, "how long (default 1,000,000)")
    option(p, "--layout", "composed", "composed or processes")
    option(p, "--clock", "lockstep", "lockstep, asap or realtime")
    add_out(p, "folder of table and picture (default results/soak)")


@command("reliability", "loco_workshop.reliability.terminal:show_reliability",
         "write one page of what was measured (exit code 1: not as required)")  # fmt: skip
def reliability(p: ArgumentParser) -> None:
    """Options of `loco reliability`.

    Takes what fuzz, mutants, chaos, crash, soak, bench damage and test last wrote, and writes
    docs/results/reliability.json and docs/reliability_figures.md.
    """
    p.add_argument("--run", nargs="*", metavar="NAME", help="measure these, or all that is missing")


@command("docs", "loco_workshop.docs.reference:show_docs",
         "print the generated tables of docs/ (topics, parameters)")  # fmt: skip
def docs(p: ArgumentParser) -> None:
    """Options of `loco docs`."""
    option(p, "--write", False, "write them into docs/")
    option(p, "--figures", False, "draw the pictures of the effects anew")
    option(p, "--site", False, "build all pages as a site")
    add_out(p, "folder of the site (default site)", default=Path("site"))
