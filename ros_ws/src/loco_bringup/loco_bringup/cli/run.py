# SPDX-License-Identifier: Apache-2.0
"""`loco run`: run an experiment as a ROS graph, with live progress and a summary."""

from __future__ import annotations

import argparse

from loco_control.exceptions import ParameterError
from loco_control.params import from_dict
from loco_learning.runs.experiment import load
from loco_sim.params import TickParams

from ..bag.writer import Limits
from ..graph import run as runner
from ..outcome import default_folder
from ..settings import overrides, values_of
from .rollout import finish, show_run


def run(a: argparse.Namespace) -> int:
    """`loco run`: run an experiment as a ROS graph; returns the exit code.

    Raises:
        LocoError: An option is wrong, or the graph does not start.
    """
    experiment = load(a.experiment, overrides(a.set, a.seed, a.engine, a.duration))
    tick = values_of("--tick", a.tick, "late=safe-stop")
    for key in {"clock", "speed", "duration"} & tick.keys():
        raise ParameterError(f"{key} is not for --tick; take --{key}")
    from_dict(TickParams, tick, "tick")
    realtime = values_of("--realtime", a.realtime, "fifo=80")
    if "cpus" in realtime:
        realtime["cpus"] = str(realtime["cpus"])  # a single CPU is parsed as a number
    limits = Limits(a.max_bag_size, a.max_bag_duration)
    folder = a.out or default_folder(experiment)
    outcome = show_run(
        experiment,
        lambda report: runner.run(
            experiment, folder, a.layout, "realtime" if a.hardware else a.clock, a.namespace,
            speed=a.speed, nodes=a.nodes, on_progress=report, faults=a.fault, realtime=realtime,
            limits=limits, hardware=a.hardware, start_timeout=a.start_timeout, **tick,
        ),
    )  # fmt: skip
    return finish(outcome, a.report, a.view)
