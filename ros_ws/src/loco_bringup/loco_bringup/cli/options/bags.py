# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that record and read bags."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from .registry import group
from .run import split

command = group("Record and read bags")


def _bag(p: ArgumentParser) -> None:
    p.add_argument("bag", type=Path, help="bag folder or .mcap file")


@command("record", "cli.logs:record", "record topics of any running graph to a bag")
def record(p: ArgumentParser) -> None:
    """Options of `loco record`."""
    p.description += (
        "\n\nTypes and QoS are those of the publishers; topics that appear later are recorded"
        " too.\nCtrl-C ends it."
    )
    p.add_argument("topics", nargs="*", help="names (default all)")
    p.add_argument("--out", type=Path, help="new bag folder (default bags/record_TIME)")
    p.add_argument("--exclude", default="", metavar="REGEX", help="leave out names that match")
    p.add_argument("--duration", type=float, default=0.0, help="stop after so many seconds")
    p.add_argument("--messages", type=int, default=0, help="stop after so many messages")
    p.add_argument("--stamps", action="store_true",
                   help="log by the messages' stamps (simulated time), not by arrival")  # fmt: skip
    split(p)


@command("replay --verify", "record.verify_terminal:verify_bag",
         "compare what live controllers answer with the bag, byte for byte")  # fmt: skip
@command("replay", "cli.logs:replay",
         "publish a bag's topics again, or test live controllers with it")  # fmt: skip
def replay(p: ArgumentParser) -> None:
    """Options of `loco replay`."""
    p.description += (
        "\n\nKeys in a terminal: space pauses, s steps, + and - change the speed, q ends.\n"
        "With --verify the plant's topics go tick by tick to live controllers, and what\n"
        "they answer is compared with the bag, byte for byte."
    )
    _bag(p)
    p.add_argument("--speed", type=float, default=1.0, help="x real time, 0 as fast as possible")
    p.add_argument("--topics", nargs="*", help="only these topics")
    p.add_argument("--start", type=float, default=0.0, help="seconds from the bag's begin")
    p.add_argument("--end", type=float, help="seconds from the bag's begin")
    p.add_argument("--loop", action="store_true", help="begin again at the end, until Ctrl-C")
    p.add_argument("--pause", action="store_true", help="wait for a key (or /replayer/control)")
    p.add_argument("--remap", action="append", default=[], metavar="FROM:=TO",
                   help="publish under another name (repeatable)")  # fmt: skip
    v = p.add_argument_group("verify")
    v.add_argument("--verify", action="store_true", help="compare live controllers with the bag")
    v.add_argument("--layout", default="composed", choices=("composed", "processes"))
    v.add_argument("--nodes", help="node set, name or YAML path (default: as the experiment)")
    v.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                   help="change a value of the experiment first (repeatable)")  # fmt: skip
    v.add_argument("--tolerance", type=float, default=0.0,
                   help="largest difference of numbers that count as equal")  # fmt: skip
    v.add_argument("--json", type=Path, help="write the differences to this file too")


@command("info", "cli.bags:info", "show what a bag holds")
def info(p: ArgumentParser) -> None:
    """Options of `loco info`."""
    _bag(p)
    p.add_argument("--check", action="store_true", help="read every chunk, check every sum")
    p.add_argument("--json", action="store_true", help="print JSON")


@command("report", "report.terminal:show_report", "write one self-contained HTML page about a bag")
def report(p: ArgumentParser) -> None:
    """Options of `loco report`."""
    _bag(p)
    p.add_argument("--out", type=Path, help="HTML file (default report.html in the bag folder)")
    p.add_argument("--no-gif", action="store_true", help="leave the animation out (faster)")


@command("compare", "report.compare:show_comparison", "write a page with two or more runs on the "
         "same axes, and what differs beyond noise")  # fmt: skip
def compare(p: ArgumentParser) -> None:
    """Options of `loco compare`."""
    p.add_argument("bag", type=Path, nargs="+", help="bags of one robot, the reference first")
    p.add_argument("--out", type=Path, default=Path("compare.html"),
                   help="HTML file (default compare.html here)")  # fmt: skip


@command("view --layouts", "view.layouts_terminal:show_layouts",
         "write layouts for Foxglove and RViz")  # fmt: skip
@command("view", "view.terminal:show_view", "show bags or a gap in Rerun: legs move, forces, "
         "curves; all but the first are ghosts")  # fmt: skip
def view(p: ArgumentParser) -> None:
    """Options of `loco view`."""
    p.add_argument("bag", type=Path, nargs="*",
                   help="bags of runs, or a folder of results of `loco gap`")  # fmt: skip
    p.add_argument("--save", type=Path, help="write this .rrd file and start no viewer")
    p.add_argument("--layouts", type=Path, nargs="?", const=Path("layouts"), metavar="DIR",
                   help="write layouts for Foxglove and RViz (default: into layouts/)")  # fmt: skip


@command("recover", "cli.bags:recover", "make a whole bag of a damaged or unfinished one")
def recover(p: ArgumentParser) -> None:
    """Options of `loco recover`."""
    p.description += (
        "\n\nCopies every whole chunk, says what is lost. The new folder appears when it is"
        " complete."
    )
    _bag(p)
    p.add_argument("--out", type=Path, help="new bag folder (default BAG_recovered)")


@command("export", "cli.bags:export", "write topics of a bag as CSV or NumPy files")
def export(p: ArgumentParser) -> None:
    """Options of `loco export`."""
    p.description += (
        "\n\nA file per topic: columns for messages of constant layout, JSON lines for the others."
    )
    _bag(p)
    p.add_argument("--out", type=Path, help="folder (default BAG/export)")
    p.add_argument("--format", default="npz", choices=("npz", "csv"), help="default npz")
    p.add_argument("--topics", nargs="+", help="only these topics")


@command("extract", "cli.bags:extract", "copy some topics of a bag into a smaller bag")
def extract(p: ArgumentParser) -> None:
    """Options of `loco extract`."""
    _bag(p)
    p.add_argument("out", type=Path, help="new bag folder")
    p.add_argument("--topics", nargs="+", metavar="TOPIC[:N]",
                   help="names, with N each N-th message (default all)")  # fmt: skip
    split(p)
