# SPDX-License-Identifier: Apache-2.0
"""The commands about logs: `loco record`, `replay`, `recover`, `info` and `export`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path


def add_arguments(commands, command: Callable) -> None:
    """Add the commands to the parser of `loco`."""
    _add_record(commands, command)
    _add_replay(commands, command)
    p = command(commands, "info", info, "show what a bag holds")
    _bag(p)
    p.add_argument("--check", action="store_true", help="read every chunk, check every sum")
    p.add_argument("--json", action="store_true", help="as JSON")
    p = command(
        commands, "recover", recover, "make a whole bag of a damaged or unfinished one",
        "Copies every whole chunk, says what is lost. The new folder appears when it is complete.",
    )  # fmt: skip
    _bag(p)
    p.add_argument("--out", type=Path, help="new bag folder (default BAG_recovered)")
    p = command(
        commands, "export", export, "write topics of a bag as CSV or NumPy files",
        "A file per topic: columns for messages of constant layout, JSON lines for the others.",
    )  # fmt: skip
    _bag(p)
    p.add_argument("--out", type=Path, help="folder (default BAG/export)")
    p.add_argument("--format", default="npz", help="npz or csv (default npz)")
    p.add_argument("--topics", nargs="+", help="only these topics")


def _bag(p: argparse.ArgumentParser) -> None:
    p.add_argument("bag", type=Path, help="bag folder or .mcap file")


def _add_record(commands, command: Callable) -> None:
    p = command(
        commands, "record", record, "record topics of any running graph to a bag",
        "Types and QoS are those of the publishers; topics that appear later are recorded too.\n"
        "Ctrl-C ends it.",
    )  # fmt: skip
    p.add_argument("topics", nargs="*", help="names (default all)")
    p.add_argument("--out", type=Path, help="new bag folder (default bags/record_TIME)")
    p.add_argument("--exclude", default="", metavar="REGEX", help="leave out names that match")
    p.add_argument("--duration", type=float, default=0.0, help="stop after so many seconds")
    p.add_argument("--messages", type=int, default=0, help="stop after so many messages")
    p.add_argument("--stamps", action="store_true",
                   help="log by the messages' stamps (simulated time), not by arrival")  # fmt: skip


def _add_replay(commands, command: Callable) -> None:
    p = command(
        commands, "replay", replay, "publish a bag's topics again, or test live controllers by it",
        "Keys in a terminal: space pauses, s steps, + and - change the speed, q ends.\n"
        "With --verify the plant's topics go tick by tick to live controllers, and what\n"
        "they answer is compared with the bag, byte for byte.",
    )  # fmt: skip
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
    v.add_argument("--layout", default="composed", help="composed or processes")
    v.add_argument("--nodes", help="node set, name or YAML path (default: as the experiment)")
    v.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                   help="change a value of the experiment first (repeatable)")  # fmt: skip
    v.add_argument("--tolerance", type=float, default=0.0,
                   help="largest difference of numbers that count as equal")  # fmt: skip
    v.add_argument("--json", type=Path, help="write the differences to this file too")


# ---- commands: each returns the exit code


def info(a: argparse.Namespace) -> int:
    """`loco info`."""
    from .listing import show_bag

    show_bag(a.bag, a.check, a.json)
    return 0


def recover(a: argparse.Namespace) -> int:
    """`loco recover`."""
    from .bag_recover import recover as run

    recovery = run(a.bag, a.out)
    sys.stdout.write(f"{recovery}\n" + "".join(f"  {note}\n" for note in recovery.notes))
    return 0


def export(a: argparse.Namespace) -> int:
    """`loco export`."""
    from .bag_export import export as run

    for path in run(a.bag, a.out, a.format, a.topics):
        sys.stdout.write(f"{path}\n")
    return 0


def record(a: argparse.Namespace) -> int:
    """`loco record`."""
    from .bag_record import record as run

    return run(a.topics, a.out, a.exclude, a.duration, a.stamps, a.messages)


def replay(a: argparse.Namespace) -> int:
    """`loco replay`."""
    if a.verify:
        return _verify(a)
    from .replayer import Cut, replay_bag

    return replay_bag(
        a.bag, a.speed, a.topics, Cut(a.start, a.end), a.loop, a.pause, tuple(a.remap)
    )


def _verify(a: argparse.Namespace) -> int:
    """Exit code 0: identical, 1: differences."""
    from .cli_run import overrides
    from .console_verify import show_verify
    from .replay_verify import verify

    changes = overrides(a.set, None)
    found = show_verify(
        a.bag, lambda tell: verify(a.bag, a.layout, a.nodes, changes, a.tolerance, tell)
    )
    if a.json:
        a.json.write_text(json.dumps(found.to_dict(), indent=1))
    return 0 if found.identical else 1
