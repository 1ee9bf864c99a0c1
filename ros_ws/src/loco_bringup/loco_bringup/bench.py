# SPDX-License-Identifier: Apache-2.0
"""`loco bench`: speeds as ratios against named baselines, measured in the same run."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rich.table import Table

from loco_control.exceptions import NameUnknownError, ParameterError

from .console import console

Rows = list[dict[str, Any]]


def show_bench(what: str, out: Path | None = None, **options: Any) -> None:
    """Run a bench and print its table; write the rows as JSON when `out` is given.

    Args:
        what: Which.
        out: JSON file.
        options: Of the bench `realtime`.

    Raises:
        NameUnknownError: There is no such bench.
        ParameterError: It has no such option.
    """
    if what not in BENCHES:
        raise NameUnknownError("bench", what, BENCHES)
    if options and what != "realtime":
        raise ParameterError(f"bench {what} has no options {', '.join(sorted(options))}")
    title, bench = BENCHES[what]
    rows = bench(**options)
    table = Table(title=title, title_justify="left", box=None)
    for column in rows[0]:
        table.add_column(column, justify="right")
    for row in rows:
        table.add_row(*(f"{v:.2f}" if isinstance(v, float) else str(v) for v in row.values()))
    console.print(table)
    if out:
        out.write_text(json.dumps({"bench": what, "rows": rows}, indent=1))


def bench_rls() -> Rows:
    """One FORCE step: ours, textbook NumPy, BLAS and the memory limit."""
    from loco_learning.bench import bench_rls as run

    return [
        {
            "neurons": r.neurons,
            "ours": r.ours,
            "textbook NumPy": r.numpy,
            "BLAS dsymv+dsyr": r.blas,
            "memory limit": r.limit,
            "ours / limit": r.ratio,
        }
        for r in run()
    ]


def bench_graph(name: str = "hyq_trot_reflex") -> Rows:
    """Real-time factor without ROS, composed and in processes, and where a tick goes."""
    from loco_learning.experiment import load

    from . import run as runner

    experiment = load(name)
    stages, total = _rollout_stages(experiment)
    rows = [_graph_row("rollout, no ROS", total, stages, experiment)]
    for layout in runner.LAYOUTS:
        with tempfile.TemporaryDirectory() as folder:
            outcome = runner.run(experiment, Path(folder) / "bench", layout)
        tick = 1e6 * experiment.dt / outcome.real_time_factor
        rows.append(_graph_row(layout, tick, stages, experiment))
    return rows


def _graph_row(name: str, tick: float, stages: dict[str, float], experiment: Any) -> dict:
    """Shares of a tick; what physics, control and network do not take is messaging."""
    rest = tick - sum(stages.values())
    shares = {key: 100.0 * value / tick for key, value in (*stages.items(), ("messaging", rest))}
    columns = {f"{key} %": value for key, value in shares.items()}
    return {"layout": name, "x real time": 1e6 * experiment.dt / tick, "tick µs": tick, **columns}


def _rollout_stages(experiment: Any) -> tuple[dict[str, float], float]:
    """Mean time of each stage of a tick, and of the tick [µs], without ROS."""
    from loco_learning.rollout import build

    loop = build(experiment)
    clock = time.perf_counter
    spent = {"physics": 0.0, "control": 0.0, "network": 0.0}
    for _ in range(250):  # loads the compiled kernels
        loop.step()
    began = clock()
    ticks = experiment.ticks - 250
    for _ in range(ticks):
        state, marks = loop.state, [clock()]
        loop.sim.ground_truth()
        target = loop.generator.step(state)
        marks.append(clock())
        command, _ = loop.reflex.step(state, target)
        marks.append(clock())
        _, trunk = loop.stance.step(state, target, command)
        marks.append(clock())
        loop.state = loop.sim.step(command, trunk)
        marks.append(clock())
        spent["control"] += marks[1] - marks[0] + marks[3] - marks[2]
        spent["network"] += marks[2] - marks[1]
        spent["physics"] += marks[4] - marks[3]
    total = clock() - began
    loop.close()
    return {key: 1e6 * value / ticks for key, value in spent.items()}, 1e6 * total / ticks


def bench_messages() -> Rows:
    """One message to bytes and back: our codec beside rclpy's serialiser."""
    import numpy as np
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import JointState

    from loco_control.names import JOINTS
    from loco_control.ros.codec import Codec
    from loco_msgs.msg import RobotState

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

        ways = {
            "encode ours": encode,
            "encode rclpy": ros_encode,
            "decode ours": lambda codec=codec, data=data, f=field: codec.decode(data)[f],
            "decode rclpy": lambda data=data, kind=kind: deserialize_message(data, kind),
        }
        rows.append({"message": kind.__name__, **_best_of(ways)})
    return rows


def bench_msd() -> Rows:
    """Networks alone and in populations: ours, textbook NumPy and the arithmetic's limit."""
    from .bench_msd import bench_msd as run

    return run()


def _best_of(ways: dict[str, Callable[[], Any]], repeats: int = 20, calls: int = 500) -> dict:
    """Fastest time of each way [µs], measured in turns."""
    best = dict.fromkeys(ways, float("inf"))
    for _ in range(repeats):
        for name, way in ways.items():
            began = time.perf_counter()
            for _ in range(calls):
                way()
            best[name] = min(best[name], 1e6 * (time.perf_counter() - began) / calls)
    return best


def bench_population() -> Rows:
    """Population engine: a plain loop, the engine alone, two workers."""
    from loco_learning.population_bench import bench_population as run

    return [
        {
            "evaluation": r.problem,
            "plain loop 1/s": r.loop,
            "engine 1/s": r.here,
            "2 workers 1/s": r.two,
            "overhead ms": r.overhead,
            "efficiency %": 100.0 * r.efficiency,
        }
        for r in run()
    ]


def bench_effects() -> Rows:
    """What effects cost that are off, and all that apply at once."""
    from .bench_effects import bench_effects as run

    return run()


def bench_bolted() -> Rows:
    """A bolted robot without the engine, and with it."""
    from .bench_bolted import bench_bolted as run

    return run()


def bench_bag() -> Rows:
    """Reading a bag into arrays: ours, rosbags, mcap-ros2-support."""
    from .bench_bag import bench_bag as run

    return run()


def bench_damage() -> Rows:
    """What comes back of a bag that was cut off or had a byte changed."""
    from .bench_damage import bench_damage as run

    return run()


def bench_realtime(**options: Any) -> Rows:
    """Lateness of ticks: the graph beside a bare loop."""
    from .bench_realtime import bench_realtime as run

    return run(**options)


BENCHES: dict[str, tuple[str, Callable[..., Rows]]] = {
    "rls": ("FORCE step, 16 outputs [µs]", bench_rls),
    "graph": ("Lockstep with recorder, network and RLS", bench_graph),
    "messages": ("One message [µs]", bench_messages),
    "msd": ("One step of one mass-spring-damper network", bench_msd),
    "population": ("Evaluations per second, 7 parameters", bench_population),
    "bag": ("Reading: messages a second of processor time, from disk to an array", bench_bag),
    "damage": ("A bag cut off or with a byte changed, read and recovered", bench_damage),
    "realtime": ("Clock realtime: how late ticks begin", bench_realtime),
    "effects": ("Effects, in shares of a physics step", bench_effects),
    "bolted": ("One physics step of a bolted robot", bench_bolted),
}
