# SPDX-License-Identifier: Apache-2.0
"""`loco run`. Heavy imports live in the function, so that ``--help`` is instant."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import ParameterError

FAULTS = """\
Faults stand between the writer and the readers of a topic; any number, also on one topic:
  --fault motion_command:drop:probability=0.1          every tenth command is lost
  --fault robot_state:delay:messages=3:start=2:stop=4  three ticks late, from 2 s to 4 s
kinds: drop, delay (messages), duplicate (times), reorder (messages), nan, freeze,
       clock_jump (offset [s]), stuck; all have start and stop [s], probability and seed.
Topics are those of docs/topics.md; docs/faults.md says what the robot does then.
"""


def add(make: Callable[..., argparse.ArgumentParser]) -> None:
    """Add the command.

    Args:
        make: Makes the parser of a command, from its name, function, help and more help.
    """
    p = make(
        "run", run, "run an experiment as a ROS 2 graph and record it",
        "Clocks: lockstep steps when every command has arrived and the recorder keeps up\n"
        "(deterministic); asap does not wait for the recorder; realtime follows the wall clock.\n"
        "Layouts: composed puts all nodes in one process, processes gives each its own,\n"
        "rollout calls the same objects without ROS and writes the same topics to a bag.\n\n"
        + FAULTS,
    )  # fmt: skip
    p.add_argument("experiment", help="name (see `loco list`) or path of a YAML file")
    p.add_argument("--layout", default="composed", help="composed, processes or rollout")
    p.add_argument("--clock", default="lockstep", help="lockstep, asap or realtime")
    p.add_argument("--speed", type=float, default=0.0, help="lockstep: at most this x real time")
    p.add_argument("--seed", type=int, help="seed, instead of the experiment's")
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                   help="override one value, e.g. gait.speed=0.3 (repeatable)")  # fmt: skip
    p.add_argument("--nodes", help="node set, name or YAML path (default: as the experiment)")
    p.add_argument("--fault", action="append", default=[], metavar="TOPIC:KIND[:NAME=VALUE]",
                   help="damage the messages of a topic (repeatable)")  # fmt: skip
    p.add_argument("--tick", action="append", default=[], metavar="KEY=VALUE",
                   help="a parameter of the plant's clock, e.g. late=safe-stop")  # fmt: skip
    p.add_argument("--realtime", action="append", default=[], metavar="KEY=VALUE",
                   help="ask the kernel, e.g. for fifo=80, cpus=1, lock_memory=true, "
                   "timer_slack=1000")  # fmt: skip
    p.add_argument("--namespace", default="", help="namespace of all nodes")
    p.add_argument("--out", type=Path, help="new bag folder (default bags/NAME_TIME)")
    p.add_argument("--report", action="store_true", help="write the report when it is done")


def run(a: argparse.Namespace) -> int:
    """`loco run`."""
    from loco_control.params import from_dict
    from loco_learning.experiment import load
    from loco_sim.params import TickParams

    from . import run as runner
    from .console import show_run

    experiment = load(a.experiment, overrides(a.set, a.seed))
    tick = values_of("--tick", a.tick, "late=safe-stop")
    for key in {"clock", "speed", "duration"} & tick.keys():
        instead = "--set duration" if key == "duration" else f"--{key}"
        raise ParameterError(f"{key} is not for --tick; take {instead}")
    from_dict(TickParams, tick, "tick")
    realtime = values_of("--realtime", a.realtime, "fifo=80")
    if "cpus" in realtime:
        realtime["cpus"] = str(realtime["cpus"])  # one alone is a number
    folder = a.out or runner.default_folder(experiment)
    if a.layout == "rollout":
        if a.fault:
            raise ParameterError("layout rollout has no topics, so no --fault; take composed")
        from .rollout_bag import run_rollout

        outcome = show_run(experiment, lambda tell: run_rollout(experiment, folder, tell))
    else:
        outcome = show_run(
            experiment,
            lambda tell: runner.run(
                experiment, folder, a.layout, a.clock, a.speed, a.nodes, tell, a.namespace,
                a.fault, realtime=realtime, **tick,
            ),
        )  # fmt: skip
    if a.report and not outcome.interrupted:
        from .report import write_report

        sys.stdout.write(f"report: {write_report(folder)}\n")
    return outcome.exit_code


def overrides(pairs: list[str], seed: int | None) -> dict[str, Any]:
    """Values of an experiment by dotted name, as ``--set`` and ``--seed`` say."""
    values = values_of("--set", pairs, "gait.speed=0.3")
    return values if seed is None else {"seed": seed, **values}


def values_of(option: str, pairs: list[str], example: str) -> dict[str, Any]:
    """Values by name from ``KEY=VALUE`` texts; the value is YAML.

    Args:
        option: That they were given to.
        pairs: The texts.
        example: Of a text.

    Raises:
        ParameterError: A text is none of these.
    """
    values = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            equals = ""
        if not equals or not key:
            raise ParameterError(f"{option} wants KEY=VALUE, e.g. {example}, got {pair!r}")
        values[key] = value
    return values
