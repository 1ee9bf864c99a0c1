# SPDX-License-Identifier: Apache-2.0
"""Commands beside a running graph: `loco top`, `loco doctor`, `loco estop`; and `loco soak`."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

CHAOS = """\
Signals: SIGSTOP and SIGKILL to each process of the HyQ graph, at random moments.
Faults: every kind of `loco run --fault`, and pairs of them, on every topic.
docs/faults.md says what has to happen each time. Stop it and start it again: it goes on.
  loco chaos --repeats 1 --only SIGKILL       a quick look at some of it
  loco chaos --only faults_motion_command
"""


def add(make: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the commands.

    Args:
        make: Makes the parser of a command, from its name, function, help and more help.
    """
    p = make("top", top, "show the live graph: rates, lateness, drops, CPU, phase")
    p.add_argument("--once", action="store_true", help="print once, for scripts")
    p.add_argument("--interval", type=float, default=1.0, help="seconds between pictures")
    p = make("doctor", doctor, "say why nothing moves (exit code 1: found something)")
    p.add_argument("--seconds", type=float, default=5.0, help="how long to listen (default 5)")
    p.add_argument("--json", action="store_true", help="print JSON")
    p.add_argument("--clean", action="store_true", help="remove shared memory of dead processes")
    p = make(
        "estop", estop, "stop the robots that run: their joints are damped until a reset",
        "Stops every robot on the ROS domain, or that of a namespace.",
    )  # fmt: skip
    p.add_argument("--reset", action="store_true", help="let them move again")
    p.add_argument("--keys", action="store_true",
                   help="stay: space stops, r resets, q quits")  # fmt: skip
    p.add_argument("--namespace", default=None, help="only the robot in this namespace")
    p = make(
        "soak", soak, "run a graph for long and see whether anything grows (exit code 1: it does)",
        "In lockstep; memory, descriptors, threads and /dev/shm of each process, once a second.\n"
        "Of the bag only events and diagnostics are written, and it is removed at the end.",
    )  # fmt: skip
    p.add_argument("experiment", nargs="?", default="hyq_trot_reflex", help="as in `loco run`")
    p.add_argument("--ticks", type=int, default=1_000_000, help="how long (default 1,000,000)")
    p.add_argument("--layout", default="composed", help="composed or processes")
    p.add_argument("--out", type=Path, help="folder of table and picture (default results/soak)")
    p = make("chaos", chaos, "stop, kill and damage everything, and judge the robot", CHAOS)
    p.add_argument("--repeats", type=int, default=20, help="of each cell (default 20)")
    p.add_argument("--seed", type=int, default=0, help="of moments and draws")
    p.add_argument("--only", default="", metavar="TEXT",
                   help="cells whose name has it, e.g. SIGSTOP, faults_stance")  # fmt: skip
    p.add_argument("--out", type=Path, default=Path("results/chaos"), help="results folder")


def chaos(a: argparse.Namespace) -> int:
    """`loco chaos`."""
    from .console_chaos import show_chaos

    return show_chaos(a)


def top(a: argparse.Namespace) -> int:
    """`loco top`."""
    from .console_top import show_top

    return show_top(a.once, a.interval)


def doctor(a: argparse.Namespace) -> int:
    """`loco doctor`."""
    from .console_doctor import show_doctor

    return show_doctor(a.seconds, a.json, a.clean)


def estop(a: argparse.Namespace) -> int:
    """`loco estop`, `loco chaos`."""
    from .console_estop import show_estop

    return show_estop(a.reset, a.keys, a.namespace)


def soak(a: argparse.Namespace) -> int:
    """`loco soak`."""
    from .console_soak import show_soak

    return show_soak(a)
