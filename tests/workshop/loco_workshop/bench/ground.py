# SPDX-License-Identifier: Apache-2.0
"""`loco bench ground`: speed of the compiled loop around MuJoCo's C step, on the ground.

The same commands, drives and effects run in three variants: step by step with PyBullet, in the
compiled loop including readings, and only the engine's step with constant torques.
Two more rows are complete ticks of a rollout, with network and learning.
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import build
from loco_sim import effects
from loco_sim.engines import ENGINES, installed
from loco_sim.plant.joint_commands import JointCommands
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots
from loco_sim.robot.robot import Robot

TWO = [{"name": "coulomb_friction", "torque": 0.05}, {"name": "actuator_lag", "time": 0.002}]
CASES = {"hyq, drives": ("hyq", []), "hyq, two effects": ("hyq", TWO),
         "tigrillo, two effects": ("tigrillo", TWO)}  # fmt: skip
ROLLOUT = "hyq_trot_reflex"
SECONDS, TURNS = 2.0, 5
ALONE = 0.1  # engine alone: short, since the robot is not controlled [s]
TICKS, WARM = 500, 250


def bench_ground() -> list[dict[str, Any]]:
    """Smallest time of a physics step, and of a tick of the rollout [µs].

    Raises:
        ParameterError: An engine is not installed.
    """
    if missing := [engine for engine in ENGINES if engine not in installed()]:
        raise ParameterError(f"bench ground compares engines, and {missing[0]} is not installed")
    rows = [_steps(name, *case) for name, case in CASES.items()]
    return [*rows, _rollout()]


def _steps(name: str, robot: str, listed: list[dict[str, Any]]) -> dict[str, Any]:
    setups = {engine: _moving(robot, engine, listed) for engine in ENGINES}
    best = dict.fromkeys((*ENGINES, "alone"), np.inf)
    for _ in range(TURNS):
        for engine, (sim, commands) in setups.items():
            sim.reset()
            began = time.process_time()
            for _ in sim.follow(commands):
                pass
            elapsed = (time.process_time() - began) / len(commands.q)
            best[engine] = min(best[engine], 1e6 * elapsed * sim.physics_dt / sim.dt)
        sim, commands = setups["mujoco"]
        sim.reset()
        for _ in sim.follow(commands.rows(0, 100)):
            pass
        steps = round(ALONE / sim.physics_dt)
        best["alone"] = min(best["alone"], 1e6 * sim.loop.engine_time(steps) / steps)
    for sim, _ in setups.values():
        sim.close()
    return _row(f"step of {name}", best["pybullet"], best["mujoco"], best["alone"])


def _moving(name: str, engine: str, listed: list[dict[str, Any]]) -> tuple[Simulation, Any]:
    """A plant, and commands with small motions of each driven joint."""
    robot: Robot = robots.load(name, {"sim.engine": engine})
    if robot.sensors:
        robot = replace(robot, sensors=robot.sensors.replace(exact=True))
    t = np.arange(round(SECONDS * robot.control_rate)) / robot.control_rate
    wave = 0.02 * np.sin(2.0 * np.pi * t)[:, None]
    commands = JointCommands(robot).sequence(robot.standing[robot.driven] + wave)
    return Simulation(effects=effects.from_list(listed), robot=robot), commands


def _rollout() -> dict[str, Any]:
    best = {}
    loops = {}
    for engine in ENGINES:
        experiment = load(ROLLOUT)
        loops[engine] = build(experiment.replace(sim={**experiment.sim, "engine": engine}))
        for _ in range(WARM):
            loops[engine].step()
    for _ in range(TURNS):
        for engine, loop in loops.items():
            began = time.process_time()
            for _ in range(TICKS // TURNS):
                loop.step()
            elapsed = 1e6 * (time.process_time() - began) / (TICKS // TURNS)
            best[engine] = min(best.get(engine, np.inf), elapsed)
    for loop in loops.values():
        loop.close()
    return _row(f"tick of {ROLLOUT}", best["pybullet"], best["mujoco"])


def _row(what: str, bullet: float, ours: float, alone: float | None = None) -> dict[str, Any]:
    return {
        "µs a": what,
        "PyBullet": bullet,
        "compiled": ours,
        "ratio": bullet / ours,
        "mj_step alone": "" if alone is None else alone,
        "over it": "" if alone is None else ours / alone,
    }
