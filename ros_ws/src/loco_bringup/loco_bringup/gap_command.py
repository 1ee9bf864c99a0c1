# SPDX-License-Identifier: Apache-2.0
"""`loco gap`: its options, and those of `loco gap next` and `loco gap battery`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from loco_control.exceptions import ParameterError

TEXT = """\
find where a model and a recording differ, name the cause, add it to the model

  loco gap BAG... --robot R     search; writes gap.html, gap.json and model.yaml
  loco gap DIR --add BAG...     search again with more recordings
  loco gap --live --robot R     the same with two robots that run, over topics
  loco gap next DIR             write the experiment that would tell most as a file
  loco gap experiments ROBOT    write experiments that excite a robot, as files
  loco gap battery              many hidden effects: how often the name is right

Verdicts: named, ambiguous, unknown, no gap."""


def from_arguments(arguments: Sequence[str]) -> int:
    """Run `loco gap` with what follows it on the command line; returns the exit code."""
    commands = {"next": _next, "experiments": _experiments, "battery": _battery}
    if arguments and arguments[0] in commands:
        return commands[arguments[0]](list(arguments[1:]))
    return _search(list(arguments))


def parser() -> argparse.ArgumentParser:
    """Options of `loco gap BAG...`."""
    p = argparse.ArgumentParser(
        prog="loco gap", description=TEXT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    p.add_argument("bags", nargs="*", metavar="BAG", help="bag folder, .mcap, CSV or JSON file; or "
                   "a folder of results, with --add")  # fmt: skip
    p.add_argument("--robot", help="robot, robot.yaml or model.yaml to begin with")
    p.add_argument("--mapping", type=Path, metavar="YAML",
                   help="role and unit of each column, for files that are no bags")  # fmt: skip
    p.add_argument("--hold-out", nargs="+", default=[], metavar="BAG",
                   help="recordings to judge on, never fitted (default: the last)")  # fmt: skip
    p.add_argument("--add", nargs="+", default=[], metavar="BAG",
                   help="more recordings for a folder of results")  # fmt: skip
    p.add_argument("--output", type=Path, metavar="DIR", help="folder (default results/gap_BAG)")
    p.add_argument("--free", nargs="+", default=[], metavar="NAME",
                   help="values of robot.yaml that may be wrong and are fitted along")  # fmt: skip
    p.add_argument("--effects", nargs="+", default=[], metavar="NAME",
                   help="only these effects are offered as causes (default: all)")  # fmt: skip
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                   help="a setting of the search (repeatable), e.g. accuracy=0.1: an error below a "
                   "tenth of a signal's deviation counts as explained")  # fmt: skip
    p.add_argument("--seed", type=int, default=0, help="of everything that is drawn (default 0)")
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--live", action="store_true",
                   help="no bag: run a surrogate robot and a model, over topics")  # fmt: skip
    p.add_argument("--measured", default="surrogate_sine", metavar="EXPERIMENT",
                   help="--live: the robot that stands for the real one")  # fmt: skip
    p.add_argument("--speed", type=float, default=1.0,
                   help="--live: at most this x real time, 0 for no limit")  # fmt: skip
    return p


def _search(arguments: list[str]) -> int:
    from .console_gap import show_gap

    p = parser()
    a = p.parse_args(arguments)
    if a.live:
        from .console_gap_live import show_live

        return show_live(a)
    if not a.bags:
        raise ParameterError("loco gap takes at least one recording; see `loco gap --help`")
    if a.workers < 1:
        raise ParameterError(f"workers must be at least 1, got {a.workers}")
    return show_gap(a)


def _next(arguments: list[str]) -> int:
    from .console_gap import show_next

    p = argparse.ArgumentParser(
        prog="loco gap next",
        description="Write the experiment that would tell the leading explanations apart.",
    )
    p.add_argument("folder", type=Path, help="folder of results of `loco gap`")
    p.add_argument("--rank", type=int, default=1, help="1 is the best, then the next (default 1)")
    p.add_argument("--out", type=Path, help="YAML file (default DIR/next_EXPERIMENT.yaml)")
    return show_next(p.parse_args(arguments))


def _experiments(arguments: list[str]) -> int:
    from .console_gap import show_library

    p = argparse.ArgumentParser(
        prog="loco gap experiments",
        description="Write experiments that excite a robot, within its limits, as files.",
    )
    p.add_argument("robot", help="robot, robot.yaml or model.yaml")
    p.add_argument("--output", type=Path, metavar="DIR", help="folder (default experiments/ROBOT)")
    return show_library(p.parse_args(arguments))


def _battery(arguments: list[str]) -> int:
    from . import gap_battery

    p = argparse.ArgumentParser(
        prog="loco gap battery",
        description="Make cases with a hidden effect, run the workflow on their bags, score it.",
    )
    gap_battery.add_arguments(p)
    return gap_battery.from_arguments(p.parse_args(arguments))
