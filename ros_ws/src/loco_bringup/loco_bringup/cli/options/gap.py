# SPDX-License-Identifier: Apache-2.0
"""Options of `loco gap` and of the commands under it."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from .registry import add_out, group, option
from .run import SCHEDULER, engine, live

command = group("Find out why a model and a robot differ")


@command("gap --live", "live.terminal:show_gap",
         "the same with two robots that run, over topics")  # fmt: skip
@command("gap", "gap.terminal:show_gap",
         "find where a model and recordings differ, and name the cause")  # fmt: skip
def search(p: ArgumentParser) -> None:
    """Options of `loco gap BAG...`.

      loco gap BAG... --robot R     search; writes gap.html, gap.json and model.yaml
      loco gap my.csv --robot my.urdf   the same; guesses on log and robot are listed and written
      loco gap DIR --add BAG...     search again with more recordings
      loco gap --live --robot R     the same for two running robots, over topics
      loco gap check BAG... --robot R   before a search: what these recordings can identify
      loco gap mapping FILE         draft the mapping of a table or bag, with reasons
      loco gap next DIR             write the most informative next experiment to a file
      loco gap experiments ROBOT    write experiments that excite a robot to files
      loco gap fleet FOLDER --robot R   thousands of recordings: which robots have what, since when
      loco gap battery              many hidden effects: how often the name is right

    Verdicts: named, ambiguous, unknown, no gap, or set-up: units, signs or names must be corrected
    first.
    """
    engine(p)
    p.add_argument("bags", nargs="*", metavar="BAG", help="bag folder, .mcap, CSV or JSON file; or "
                   "a folder of results, with --add")  # fmt: skip
    option(p, "--robot", str, "robot, robot.yaml, model.yaml or URDF to begin with")
    option(p, "--mapping", Path, "role and unit of each column of a table (default: beside it, or "
           "drafted)", "YAML")  # fmt: skip
    p.add_argument("--hold-out", nargs="+", default=[], metavar="BAG",
                   help="recordings to judge on, never fitted (default: the last)")  # fmt: skip
    option(p, "--add", tuple, "more recordings for a folder of results", "BAG")
    add_out(p, "folder of the results (default results/gap_BAG)")
    p.add_argument("--free", nargs="+", default=[], metavar="NAME",
                   help="values of robot.yaml that may be wrong and are fitted along")  # fmt: skip
    option(p, "--effects", tuple, "only these effects are offered as causes (default: all)", "NAME")
    option(p, "--residual", False, "where something without a name is left, fit a learned "
           "correction, which explains nothing")  # fmt: skip
    option(p, "--set", list, "a setting of the search (repeatable), e.g. accuracy=0.1: an error "
           "below a tenth of a signal's deviation counts as explained", "KEY=VALUE")  # fmt: skip
    option(p, "--seed", int, "seed of everything drawn (default 0)")
    option(p, "--workers", 2, "processes (default 2)")
    option(p, "--scheduler", "", SCHEDULER)
    live(p, "no bag: run a surrogate robot and a model, over topics")


@command("gap check", "gap.check:show_check",
         "say what recordings can tell before a search, in half a minute")  # fmt: skip
def check(p: ArgumentParser) -> None:
    """Options of `loco gap check`.

    Takes half a minute, for a robot on the ground longer. Checks the set-up (units, signs, names
    of joints, scales, gravity, masses, gains), and prints a correction for each mistake. Lists
    telemetry, timing, the visible effects with joint and smallest visible size, what is missing,
    and the time of a search. Exit code 2: a recording cannot be used.
    """
    engine(p)
    p.add_argument("bags", nargs="+", metavar="BAG", help="bag folder, .mcap, CSV or JSON file")
    option(p, "--robot", str, "robot, robot.yaml, model.yaml or URDF that was measured")
    option(p, "--mapping", Path, "role and unit of each column, for files that are no bags", "YAML")
    option(p, "--workers", 2, "processes (default 2)")
    option(p, "--json", False, "print check.json instead of tables")
    option(p, "--fix", False, "write the lines that mend the set-up: a mapping.yaml, and a "
           "model.yaml, beside the page; nothing else changes")  # fmt: skip
    add_out(p, "folder of the page (default results/check_BAG)")


@command("gap fleet", "gap.fleet.terminal:show_fleet",
         "thousands of recordings: which robots have which effect, since which day")  # fmt: skip
def fleet(p: ArgumentParser) -> None:
    """Options of `loco gap fleet`.

    FOLDER holds recordings as ROBOT/DAY/FILE, or a recordings.csv with the columns file, robot and
    day. Writes fleet.html, fleet.json and a row for each recording (fleet.parquet, or fleet.csv
    without pyarrow). Stopped, it goes on when the same command is typed again; with more
    recordings, only what is new is computed.
    """
    engine(p)
    p.add_argument("folder", type=Path, metavar="FOLDER", help="folder of the recordings, or a "
                   "table of them")  # fmt: skip
    option(p, "--robot", str, "robot, robot.yaml, model.yaml or URDF of all robots")
    option(p, "--mapping", Path, "role and unit of each column, for files that are no bags", "YAML")
    add_out(p, "folder of the results (default results/fleet_FOLDER)")
    option(p, "--effects", tuple, "only these effects are offered as causes (default: all)", "NAME")
    option(p, "--set", list, "a setting of the fleet or of its searches (repeatable), e.g. "
           "seconds=20", "KEY=VALUE")  # fmt: skip
    option(p, "--seed", 0, "seed of everything drawn (default 0)")
    option(p, "--workers", 2, "processes (default 2)")
    option(p, "--scheduler", "", SCHEDULER)


@command("gap mapping", "gap.drafts.terminal:show_draft", "draft a mapping: what the columns or "
         "topics of a recording probably are, and why")  # fmt: skip
def draft(p: ArgumentParser) -> None:
    """Options of `loco gap mapping`.

    Roles, joints and units are guessed from names and values; each line has its reason. Check all
    lines.
    """
    p.add_argument("file", metavar="FILE", help="CSV, JSON or other table, a folder of them, or a "
                   "bag")  # fmt: skip
    option(p, "--robot", str, "robot, robot.yaml or model.yaml, whose joints are looked for")
    add_out(p, "YAML file to write, or its folder (default: print it)", file=True)


@command("gap next", "gap.terminal:show_next",
         "write the experiment that would tell the leading explanations apart")  # fmt: skip
def next_experiment(p: ArgumentParser) -> None:
    """Options of `loco gap next`."""
    p.add_argument("folder", type=Path, help="folder of results of `loco gap`")
    option(p, "--rank", 1, "1 is the best, then the next (default 1)")
    add_out(p, "YAML file, or its folder (default DIR/next_EXPERIMENT.yaml)", file=True)


@command("gap experiments", "gap.terminal:show_library",
         "write experiments that excite a robot, within its limits")  # fmt: skip
def experiments(p: ArgumentParser) -> None:
    """Options of `loco gap experiments`."""
    p.add_argument("robot", help="robot, robot.yaml or model.yaml")
    add_out(p, "folder of the experiments (default results/experiments_ROBOT)")


@command("export-model", "export_model.terminal:show_export",
         "write a model for MuJoCo, URDF readers, Isaac Lab, PACE or ros2_control")  # fmt: skip
def export_model(p: ArgumentParser) -> None:
    """Options of `loco export-model`.

    Exports armature, damping, friction, delays, gains, masses and contact. Properties that the
    target cannot represent are listed. Results of `loco gap` also give ranges for domain
    randomisation, and their held-out recordings are replayed in MuJoCo alone.
    """
    p.add_argument("model", type=Path, help="robot, model.yaml, or folder of results of loco gap")
    p.add_argument("--to", required=True, choices=("mjcf", "urdf", "isaac", "pace", "ros2_control"))
    p.add_argument("--replay", nargs="+", default=[], metavar="BAG",
                   help="mjcf: recordings to check it with (default: those held out)")  # fmt: skip
    option(p, "--mapping", Path, "mapping of the recordings", "YAML")
    p.add_argument("--gear", choices=("elastic", "rigid"),
                   help="mjcf: elastic, with a joint for each servo's rotor (default), or rigid, "
                   "with the robot's joints alone")  # fmt: skip
    add_out(p, "folder (default results/export_ROBOT_TARGET)")


@command("calibrate --live", "live.terminal:show_calibration",
         "the same with a running model and a running robot")  # fmt: skip
@command("calibrate", "calibrate.terminal:show_calibration",
         "fit a robot's body to a recorded bag (thesis chapter 5, resumable)")  # fmt: skip
def calibrate(p: ArgumentParser) -> None:
    """Options of `loco calibrate`.

    The bag must have joint_states and joint_command of a robot whose driven joints moved
    periodically. Writes model.yaml, calibration.json, tables, figures and a page.
    """
    engine(p)
    p.add_argument("bag", type=Path, nargs="?", help="bag folder or .mcap file")
    option(p, "--robot", "tigrillo", "robot, robot.yaml or model.yaml")
    p.add_argument("--parameters", default="seven", choices=("seven", "ten", "legs"),
                   help="seven (eq. 5.1, default), ten (author's) or legs (HyQ)")  # fmt: skip
    p.add_argument("--loss", default="thesis", choices=("thesis", "author"),
                   help="thesis (eq. 5.4, default) or author (normalised)")  # fmt: skip
    option(p, "--seeds", 5, "searches (default 5)")
    option(p, "--seed", 0, "seed of the first search")
    option(p, "--generations", int, "most generations of a search")
    p.add_argument("--validate", type=Path, nargs="*", default=[], metavar="BAG",
                   help="recordings that are compared but not fitted")  # fmt: skip
    add_out(p, "results folder (default results/calibration_BAG)")
    option(p, "--workers", 2, "processes (default 2)")
    option(p, "--scheduler", "", SCHEDULER)
    live(p, "no bag: start a surrogate robot and a model, fit over topics")
