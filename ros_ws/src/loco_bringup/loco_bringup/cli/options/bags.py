# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that record and read bags."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from .registry import add_out, folder, group, option
from .run import split

command = group("Record and read bags")


def _bag(p: ArgumentParser) -> None:
    p.add_argument("bag", type=Path, help="bag folder or .mcap file")


@command("record", "cli.logs:record", "record topics of any running graph to a bag")
def record(p: ArgumentParser) -> None:
    """Options of `loco record`.

    Types and QoS are those of the publishers; topics that appear later are recorded too.
    Ctrl-C ends it.
    """
    p.add_argument("topics", nargs="*", help="names (default all)")
    add_out(p, "new bag folder (default bags/record_TIME)")
    option(p, "--exclude", "", "leave out names that match", "REGEX")
    option(p, "--duration", 0.0, "stop after so many seconds")
    option(p, "--messages", 0, "stop after so many messages")
    option(p, "--stamps", False, "log by the messages' stamps (simulated time), not by arrival")
    split(p)


@command("replay --verify", "record.verify_terminal:verify_bag",
         "compare what live controllers answer with the bag, byte for byte")  # fmt: skip
@command("replay", "cli.logs:replay",
         "publish a bag's topics again, or test live controllers with it")  # fmt: skip
def replay(p: ArgumentParser) -> None:
    """Options of `loco replay`.

    Keys in a terminal: space pauses, s steps, + and - change the speed, q ends.
    With --verify the recorded sensor values are sent to running controllers tick by
    tick, and the output of the controllers is compared with the bag, byte for byte.
    """
    _bag(p)
    option(p, "--speed", 1.0, "x real time, 0 as fast as possible")
    p.add_argument("--topics", nargs="*", help="only these topics")
    option(p, "--start", 0.0, "seconds from the bag's begin")
    option(p, "--end", float, "seconds from the bag's begin")
    option(p, "--loop", False, "begin again at the end, until Ctrl-C")
    option(p, "--pause", False, "wait for a key (or /replayer/control)")
    option(p, "--remap", list, "publish under another name (repeatable)", "FROM:=TO")
    v = p.add_argument_group("verify")
    option(v, "--verify", False, "compare live controllers with the bag")
    v.add_argument("--layout", default="composed", choices=("composed", "processes"))
    option(v, "--nodes", str, "node set, name or YAML path (default: as the experiment)")
    option(v, "--set", list, "change a value of the experiment first (repeatable)", "KEY=VALUE")
    option(v, "--tolerance", 0.0, "largest difference of numbers that count as equal")
    option(v, "--json", Path, "write the differences to this file too")


def _mapping(p: ArgumentParser) -> None:
    option(p, "--mapping", Path, "mapping.yaml of the topics or columns of another program "
           "(default: the one beside the recording, else guessed by names)")  # fmt: skip


@command("info", "cli.bags:info", "show what a bag holds")
def info(p: ArgumentParser) -> None:
    """Options of `loco info`."""
    _bag(p)
    option(p, "--check", False, "read every chunk, check every sum")
    option(p, "--json", False, "print JSON")


@command("report", "report.report:show_report", "write one self-contained HTML page about a bag")
def report(p: ArgumentParser) -> None:
    """Options of `loco report`.

    A run of loco, or a bag or table of another program with positions of joints.
    """
    _bag(p)
    _mapping(p)
    add_out(p, "HTML file, or its folder (default BAG/report.html)", file=True)
    option(p, "--no-gif", False, "leave the animation out (faster)")


@command("compare", "report.compare:show_comparison", "write a page with two or more runs on the "
         "same axes, and what differs beyond noise")  # fmt: skip
def compare(p: ArgumentParser) -> None:
    """Options of `loco compare`."""
    _mapping(p)
    p.add_argument("bag", type=Path, nargs="+", help="bags of one robot, the reference first")
    add_out(p, "HTML file, or its folder (default results/compare.html)", file=True)


@command("view --layouts", "view.layouts_terminal:show_layouts",
         "write layouts for Foxglove and RViz")  # fmt: skip
@command("view --foxglove", "view.foxglove_server:show_foxglove",
         "serve the topics of a bag to Foxglove")  # fmt: skip
@command("view", "view.terminal:show_view", "show bags or a gap in Rerun: legs move, forces, "
         "curves; all but the first are ghosts")  # fmt: skip
def view(p: ArgumentParser) -> None:
    """Options of `loco view`."""
    p.add_argument("bag", type=Path, nargs="*",
                   help="bags of runs, results of `loco gap`, or with --robot a recording of "
                   "another program")  # fmt: skip
    option(p, "--robot", "", "robot, robot.yaml or model.yaml of that recording")
    _mapping(p)
    option(p, "--save", Path, "write this .rrd file and start no viewer")
    p.add_argument("--foxglove", type=int, nargs="?", const=8765, metavar="PORT",
                   help="serve the topics of one bag to Foxglove (default port 8765)")  # fmt: skip
    p.add_argument("--layouts", type=folder, nargs="?", const=Path("results/layouts"),
                   metavar="DIR", help="write layouts for Foxglove and RViz (default "
                   "results/layouts)")  # fmt: skip


@command("recover", "cli.bags:recover", "make a whole bag of a damaged or unfinished one")
def recover(p: ArgumentParser) -> None:
    """Options of `loco recover`.

    Copies every complete chunk and lists what is lost. The new folder appears when it is complete.
    """
    _bag(p)
    add_out(p, "new bag folder (default BAG_recovered)")


@command("export", "cli.bags:export", "write topics of a bag as CSV or NumPy files")
def export(p: ArgumentParser) -> None:
    """Options of `loco export`.

    Writes one file per topic: columns for messages of constant layout, JSON lines for the others.
    """
    _bag(p)
    add_out(p, "folder (default BAG/export)")
    p.add_argument("--format", default="npz", choices=("npz", "csv"), help="default npz")
    p.add_argument("--topics", nargs="+", help="only these topics")


@command("extract", "cli.bags:extract", "copy some topics of a bag into a smaller bag")
def extract(p: ArgumentParser) -> None:
    """Options of `loco extract`."""
    _bag(p)
    p.add_argument("out", type=folder, help="new bag folder")
    p.add_argument("--topics", nargs="+", metavar="TOPIC[:N]",
                   help="names, with N each N-th message (default all)")  # fmt: skip
    split(p)
