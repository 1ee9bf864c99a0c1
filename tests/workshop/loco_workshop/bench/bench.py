# SPDX-License-Identifier: Apache-2.0
"""`loco bench`: speeds as ratios to named baselines, measured in the same run."""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from loco_bringup.graph import run as runner
from loco_bringup.terminal import console
from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.names import JOINTS
from loco_control.ros.messages.codec import Codec
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import build
from loco_msgs.msg import RobotState

from ..reliability.figures import keep
from .bag import bench_bag
from .bolted import bench_bolted
from .damage import COLUMNS, HARM, bench_damage
from .effects import bench_effects
from .engines import bench_engines
from .ground import bench_ground
from .msd import bench_msd
from .population import bench_population
from .realtime import bench_realtime
from .rls import bench_rls

Rows = list[dict[str, Any]]


def show_bench(a: argparse.Namespace) -> int:
    """`loco bench`: run a benchmark and print its table; ``--json`` writes the rows to a file.

    Raises:
        NameUnknownError: There is no such benchmark.
        ParameterError: The benchmark has no such option.
    """
    what = a.what
    options = {key: getattr(a, key) for key in ("seconds", "rate", "layout") if getattr(a, key)}
    if what not in BENCHES:
        raise NameUnknownError("bench", what, BENCHES)
    if options and what != "realtime":
        raise ParameterError(f"bench {what} has no options {', '.join(sorted(options))}")
    title, baseline, bench = BENCHES[what]
    rows = [{**row, "baseline": baseline} for row in bench(**options)]
    console.print("\n".join([title, *lines(rows)]), markup=False, highlight=False, soft_wrap=True)
    if what == "damage":
        keep(Path("results/damage"), "damage", {
            row["damage"]: (not any(row[k] for k in HARM), {k: row[k] for k in COLUMNS})
            for row in rows
        })  # fmt: skip
    if a.json:
        a.json.write_text(json.dumps({"bench": what, "rows": rows}, indent=1))
    return 0


def lines(rows: Rows, width: int = 80) -> list[str]:
    """Lines of a table that fits the width of a terminal.

    If the table is too wide, it is transposed; if that is too wide too, each row becomes a
    paragraph, in which only long texts exceed the width.

    Args:
        rows: Values by column, the same columns in each.
        width: Characters of a line.
    """
    cells = [[_text(value) for value in row.values()] for row in rows]
    table = [list(rows[0]), *cells]
    for block in (_aligned(table), _aligned([list(column) for column in zip(*table, strict=True)])):
        if max(map(len, block)) <= width:
            return block
    longest = max(map(len, rows[0]))
    return [
        line
        for row in cells
        for line in ("", *(f"  {k:<{longest}}  {v}" for k, v in zip(rows[0], row, strict=True)))
    ]


def _aligned(table: list[list[str]]) -> list[str]:
    """Lines of a table with the first column left-aligned and the others right-aligned."""
    wide = [max(map(len, column)) for column in zip(*table, strict=True)]
    rows = [[row[0].ljust(wide[0]), *map(str.rjust, row[1:], wide[1:])] for row in table]
    return ["  ".join(row).rstrip() for row in rows]


def _text(value: Any) -> str:
    return f"{value:.2f}" if isinstance(value, float) else str(value)


def rls_rows() -> Rows:
    """Time of one FORCE step: loco, textbook NumPy, BLAS and the memory limit."""
    return [
        {
            "neurons": r.neurons,
            "ours": r.ours,
            "textbook NumPy": r.numpy,
            "BLAS dsymv+dsyr": r.blas,
            "memory limit": r.limit,
            "ours / limit": r.ratio,
        }
        for r in bench_rls()
    ]


def bench_graph(name: str = "hyq_trot_reflex") -> Rows:
    """Real-time factor without ROS, composed and in processes, and the time per stage of a tick."""
    experiment = load(name)
    stages, total = _rollout_stages(experiment)
    rows = [_graph_row("rollout, no ROS", total, stages, experiment, total)]
    for layout in runner.LAYOUTS:
        with tempfile.TemporaryDirectory() as folder:
            outcome = runner.run(experiment, Path(folder) / "bench", layout)
        tick = 1e6 * experiment.dt / outcome.real_time_factor
        rows.append(_graph_row(layout, tick, stages, experiment, total))
    return rows


def _graph_row(
    name: str, tick: float, stages: dict[str, float], experiment: Any, rollout: float
) -> dict[str, Any]:
    """Shares of a tick; the rest after physics, control and network is messaging.

    Args:
        name: Name of the layout.
        tick: Time of a tick [µs].
        stages: Times of the stages without ROS [µs].
        experiment: The experiment.
        rollout: Time of a tick without ROS [µs].
    """
    rest = tick - sum(stages.values())
    shares = {key: 100.0 * value / tick for key, value in (*stages.items(), ("messaging", rest))}
    columns = {f"{key} %": value for key, value in shares.items()}
    speed = {"x real time": 1e6 * experiment.dt / tick, "of rollout": rollout / tick}
    return {"layout": name, **speed, "tick µs": tick, **columns}


def _rollout_stages(experiment: Any) -> tuple[dict[str, float], float]:
    """Mean time of each stage of a tick, and of the tick [µs], without ROS."""
    loop = build(experiment)
    clock = time.perf_counter
    durations = {"physics": 0.0, "control": 0.0, "network": 0.0}
    for _ in range(250):  # loads the compiled kernels
        loop.step()
    began = clock()
    ticks = experiment.ticks - 250
    for _ in range(ticks):
        state, marks = loop.state, [clock()]
        loop.sim.ground_truth()
        target = loop.target.step(state)
        marks.append(clock())
        command, _ = loop.reflex.step(state.tick, state.t, loop.feel(state), target)
        marks.append(clock())
        _, trunk = loop.stance.step(state, target, command)
        marks.append(clock())
        loop.state = loop.sim.step(command, trunk)
        marks.append(clock())
        durations["control"] += marks[1] - marks[0] + marks[3] - marks[2]
        durations["network"] += marks[2] - marks[1]
        durations["physics"] += marks[4] - marks[3]
    total = clock() - began
    loop.close()
    return {key: 1e6 * value / ticks for key, value in durations.items()}, 1e6 * total / ticks


def bench_messages() -> Rows:
    """Time to serialise and deserialise one message: loco's codec and rclpy's serialiser."""
    zeros = [0.0] * len(JOINTS)
    templates = (RobotState(), JointState(name=list(JOINTS), position=zeros, velocity=zeros))
    rows = []
    for template in templates:
        codec = Codec(template)
        record, values = codec.record(), np.linspace(-1.0, 1.0, len(JOINTS))
        field = "q" if "q" in codec.dtype.names else "position"
        data, kind = codec.template, type(template)

        def encode(record=record, field=field, values=values) -> bytes:
            record[field] = values
            return record.tobytes()

        def ros_encode(template=template, field=field, values=values) -> bytes:
            setattr(template, field, values if field == "q" else values.tolist())
            return serialize_message(template)

        variants = {
            "encode ours": encode,
            "encode rclpy": ros_encode,
            "decode ours": lambda codec=codec, data=data, f=field: codec.decode(data)[f],
            "decode rclpy": lambda data=data, kind=kind: deserialize_message(data, kind),
        }
        rows.append({"message": kind.__name__, **_best_of(variants)})
    return rows


def _best_of(ways: dict[str, Callable[[], Any]], repeats: int = 20, calls: int = 500) -> dict:
    """Fastest time of each function [µs], measured alternately."""
    best = dict.fromkeys(ways, float("inf"))
    for _ in range(repeats):
        for name, variant in ways.items():
            began = time.perf_counter()
            for _ in range(calls):
                variant()
            best[name] = min(best[name], 1e6 * (time.perf_counter() - began) / calls)
    return best


def population_rows() -> Rows:
    """Speed of the population engine: a plain loop, the engine alone, two workers."""
    return [
        {
            "evaluation": r.problem,
            "plain loop 1/s": r.loop,
            "engine 1/s": r.here,
            "2 workers 1/s": r.two,
            "overhead ms": r.overhead,
            "efficiency %": 100.0 * r.efficiency,
        }
        for r in bench_population()
    ]


# Title, baseline of the ratios, and function of each benchmark.
BENCHES: dict[str, tuple[str, str, Callable[..., Rows]]] = {
    "rls": ("FORCE step, 16 outputs [µs]", "memory limit", rls_rows),
    "graph": ("Lockstep with recorder, network and RLS", "rollout", bench_graph),
    "messages": ("One message [µs]", "rclpy", bench_messages),
    "msd": ("One step of one mass-spring-damper network", "textbook", bench_msd),
    "population": ("Evaluations per second, 7 parameters", "plain loop", population_rows),
    "bag": (
        "Reading: messages a second of processor time, from disk to an array", "rosbags", bench_bag,
    ),
    "damage": ("A bag cut off or with a byte changed, and recovered", "whole bag", bench_damage),
    "realtime": ("Clock realtime: how late ticks begin", "bare loop, same time", bench_realtime),
    "effects": ("Effects, in shares of a physics step", "step without effects", bench_effects),
    "bolted": ("One physics step of a bolted robot", "PyBullet", bench_bolted),
    "engines": ("PyBullet and MuJoCo side by side", "MuJoCo", bench_engines),
    "ground": ("Robots on the ground, compiled around MuJoCo's step", "PyBullet", bench_ground),
}  # fmt: skip
