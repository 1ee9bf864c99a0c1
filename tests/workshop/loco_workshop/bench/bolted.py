# SPDX-License-Identifier: Apache-2.0
"""`loco bench bolted`: speed of a fixed-base robot with and without the physics engine.

Both run the same commands with the same drives, springs and physics steps. The time without the
engine includes the set-up of each run (effects, tree, sensors), spread over 4 s, as in `loco gap`.
A search changes little between runs: `one joint` is a run in which only the commands of one joint
differ from the previous run, so that the results of other limbs are cached.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.bolted import limbs
from loco_sim.bolted.loop import Bolted
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots

AIR = {"fixed_base": True, "height": 1.0}
ROBOTS = {"servo_pendulum": {}, "linear_axis": {}, "hyq_leg": {}, "tigrillo": AIR, "hyq": AIR}
FRICTION = {"name": "coulomb_friction", "torque": 0.05}
SECONDS, TURNS = 4.0, 3


def bench_bolted() -> list[dict[str, Any]]:
    """Time of a physics step, with and without dry friction, best of several repetitions."""
    return [
        _row(name, overrides, listed)
        for name, overrides in ROBOTS.items()
        for listed in ([], [FRICTION])
    ]


def _row(name: str, overrides: dict[str, Any], listed: list[dict[str, Any]]) -> dict[str, Any]:
    robot = robots.load(name, overrides)
    if robot.sensors:
        robot = replace(robot, sensors=robot.sensors.replace(exact=True))
    t = np.arange(round(SECONDS * robot.control_rate)) / robot.control_rate
    targets = np.tile(robot.standing, (len(t), 1))
    targets[:, robot.driven] += 0.05 * np.sin(2.0 * np.pi * t)[:, None]
    best = {"ours": np.inf, "one": np.inf, "engine": np.inf}
    for _ in range(TURNS):
        limbs.CACHE.clear()
        for who, simulate in (("ours", _alone), ("one", _alone), ("engine", _with_engine)):
            targets[:, robot.driven[0]] += 0.01
            began = time.process_time()
            steps = simulate(robot, listed, targets)
            best[who] = min(best[who], 1e6 * (time.process_time() - began) / steps)
    return {
        "robot": name,
        "joints": len(robot.joints),
        "dry friction": "yes" if listed else "no",
        "ours µs": best["ours"],
        "one joint µs": best["one"],
        "with PyBullet µs": best["engine"],
        "ratio": best["engine"] / best["ours"],
    }


def _alone(robot: Any, listed: list[dict[str, Any]], targets: np.ndarray) -> int:
    plant = Bolted(robot, effects.from_list(listed))
    plant.run(targets)
    return round(len(targets) * plant.dt / plant.physics_dt)


def _with_engine(robot: Any, listed: list[dict[str, Any]], targets: np.ndarray) -> int:
    zeros, flags = np.zeros(len(robot.joints)), np.ones(len(robot.feet), dtype=bool)
    with Simulation(None, effects.from_list(listed), 0, None, robot) as sim:
        sim.reset()
        for k, q in enumerate(targets):
            trunk = TrunkTorque(k, k * sim.dt, zeros, np.zeros(6), flags)
            sim.step(MotionCommand(k, k * sim.dt, q, zeros), trunk)
        return round(len(targets) * sim.dt / sim.physics_dt)
