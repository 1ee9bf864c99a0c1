# SPDX-License-Identifier: Apache-2.0
"""`loco bench engines`: comparison of PyBullet and MuJoCo.

Fixed-base robots follow commands on both engines, with 1 mrad noise on the readings. `loco gap`
measures the error of the compiled loop without an engine; 1 noise floor means agreement. Further
rows: the same runs on the ground, the time of a physics step in the air and of a rollout's tick.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_learning.metrics import registry as metrics
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import build, rollout
from loco_sim.bolted.loop import Bolted
from loco_sim.engines import ENGINES, installed
from loco_sim.plant.joint_commands import JointCommands
from loco_sim.plant.model import Model
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots
from loco_sim.world.world import make_world

Rows = list[dict[str, Any]]
BOLTED = {"servo_pendulum": {}, "linear_axis": {}, "hyq_leg": {},
          "tigrillo": {"fixed_base": True, "height": 1.0}}  # fmt: skip
NOISE, SECONDS = 0.001, 6.0  # noise of readings [rad or m]; length of a recording [s]
RUNS = {
    "chapter8_rse": {},
    "hyq_trot_open": {"learner.train": 30.0},
    "tigrillo_bound": {},
    "tigrillo_walk": {},
}
SHOWN = {"forward_speed": "speed [m/s]", "heading_drift": "turned by [rad]"}
STEPS, TICKS, TURNS = 1000, 100, 5


def bench_engines() -> Rows:
    """Agreement in the air, results on the ground, and times of both engines.

    Raises:
        ParameterError: An engine is not installed.
    """
    if missing := [engine for engine in ENGINES if engine not in installed()]:
        raise ParameterError(f"bench engines compares engines, and {missing[0]} is not installed")
    rows = [_row(f"{name}: floors", lambda e, n=name: floors(n, e)) for name in BOLTED]
    for name, values in RUNS.items():
        rows += on_ground(name, values)
    return [*rows, *_times()]


def floors(name: str, engine: str) -> float:
    """Error of the loop without an engine as a model of one [noise floors].

    It is 1 if the two differ only by the noise of the readings, which is one floor.

    Args:
        name: Robot of `BOLTED`.
        engine: Name of the engine.
    """
    robot = robots.load(name, {**BOLTED[name], "sim.engine": engine})
    if robot.sensors:
        robot = replace(robot, sensors=robot.sensors.replace(exact=True))
    t = np.arange(round(SECONDS * robot.control_rate)) / robot.control_rate
    wave = np.sin(2.0 * np.pi * (0.5 + 0.1 * t) * t)[:, None] + 0.3 * np.sin(15.0 * t)[:, None]
    commands = JointCommands(robot).sequence(robot.standing[robot.driven] + 0.08 * wave)
    with Simulation(robot=robot) as sim:
        sim.reset()
        q = np.array([state.q for state in sim.follow(commands)])
    noise = NOISE * np.random.default_rng(1).standard_normal(q.shape)
    model = Model(name, BOLTED[name])
    driven = tuple(robot.joints[i] for i in robot.driven)
    command = {"position": commands.q[:, robot.driven]}
    record = Record(name, t, command, driven, {"q": q + noise}, robot.joints)
    case = cases.prepare(Forward(model, [record]), [record], [])
    reference = Bolted(robot).run(commands.q).q
    return float(np.sqrt(1.0 + np.mean(np.square((q - reference) / case.floors[0]))))


def on_ground(name: str, values: dict[str, Any]) -> Rows:
    """Time until a fall, speed and turn of an experiment on each engine.

    Args:
        name: Name of the experiment.
        values: Values that replace those of the experiment, by dotted name.
    """
    logs = {e: rollout(load(name, {**values, "sim.engine": e})) for e in ENGINES}
    last = {engine: list(metrics.table(log).values())[-1] for engine, log in logs.items()}
    rows = [_row(f"{name}: up for [s]", lambda e: len(logs[e]) * logs[e].dt)]
    for key, what in SHOWN.items():
        rows.append(_row(f"{name}: {what}", lambda e, k=key: last[e][k]))
    return rows


def _times() -> Rows:
    """Smallest times of alternating measurements [µs]."""
    hyq = robots.load("hyq")
    worlds = {e: make_world(hyq, hyq.sim.replace(engine=e), 0.001) for e in ENGINES}
    loops = {e: build(load("hyq_trot_reflex", {"sim.engine": e})) for e in ENGINES}
    step, tick = dict.fromkeys(ENGINES, np.inf), dict.fromkeys(ENGINES, np.inf)
    for _ in range(TURNS):
        for engine in ENGINES:
            worlds[engine].rebuild(hyq.standing, height=5.0)
            zeros = [0.0] * len(hyq.joints)
            elapsed = _spent(lambda w=worlds[engine], z=zeros: w.step(z), STEPS)
            step[engine] = min(step[engine], elapsed)
            tick[engine] = min(tick[engine], _spent(loops[engine].step, TICKS))
    for each in (*worlds.values(), *loops.values()):
        each.close()
    return [
        _row("bare step of hyq in the air [µs]", step.__getitem__),
        _row("tick of hyq_trot_reflex [µs]", tick.__getitem__),
    ]


def _spent(work: Callable[[], Any], times: int) -> float:
    work()
    began = time.process_time()
    for _ in range(times):
        work()
    return 1e6 * (time.process_time() - began) / times


def _row(what: str, value: Callable[[str], float]) -> dict[str, Any]:
    bullet, mujoco = (value(engine) for engine in ENGINES)
    return {"of": what, "PyBullet": bullet, "MuJoCo": mujoco, "ratio": bullet / mujoco}
