# SPDX-License-Identifier: Apache-2.0
"""`loco bench effects`: cost of effects, as shares of a physics step.

A step is one physics step of the robot without effects, moving its legs in place: drive, engine
and joint states, and a share of the sensing at the end of the control period.

* off: all applicable effects are listed, none is switched on.
* on, calls: time in hooks and kernels including their data transfer, called repeatedly
  without the engine: the lower bound of their cost.
* on, whole step: time of the whole step with all effects on, relative to the bare step.
  It includes additional work of the engine: brakes, soft contacts, a joint in the trunk.

Bare and other plants run alternately, block by block; the results are medians of ratios, so
that other load on the machine has little influence.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots

ROBOTS = ("hyq", "tigrillo")
BLOCK, BLOCKS = 10, 60  # control periods per block, blocks


class Bench:
    """A robot with effects that moves its legs in place."""

    def __init__(self, robot: str, listed: list[dict[str, Any]]):
        self.robot = robots.load(robot)
        n, m = len(self.robot.joints), len(self.robot.feet)
        self.sim = Simulation(effects=effects.from_list(listed), robot=self.robot)
        wave = 0.05 * np.sin(2.0 * np.pi * 1.5 * self.sim.dt * np.arange(BLOCK * BLOCKS))
        sign = np.where(np.arange(n) % 2, -1.0, 1.0)
        self._q = self.robot.standing + wave[:, None] * sign
        self._rest, self._flags = np.zeros(n), np.ones(m, dtype=bool)
        self._tick = 0

    def block(self) -> float:
        """Mean time of a physics step over a block [µs]."""
        began = time.perf_counter()
        for _ in range(BLOCK):
            k = self._tick % len(self._q)
            self.sim.step(
                MotionCommand(k, 0.0, self._q[k], self._rest),
                TrunkTorque(k, 0.0, self._rest, np.zeros(6), self._flags),
            )
            self._tick += 1
        steps = round(self.sim.dt / self.sim.physics_dt)
        return 1e6 * (time.perf_counter() - began) / BLOCK / steps


def weak(name: str) -> dict[str, Any]:
    """The effect at a strength that hardly changes the motion of the robot."""
    identity = effects.EFFECTS[name].identity
    values: dict[str, Any] = {"channel": "tau"} if name == "sensor_stuck" else {}
    for key in identity.strengths:
        low, _, high = identity.priors[key]
        size = low if low > 0.0 else 0.01 * high
        default = getattr(effects.EFFECTS[name], key)
        values[key] = (size,) * len(default) if isinstance(default, tuple) else size
    return {"name": name, **values}


def bench_effects() -> list[dict[str, Any]]:
    """Cost of all applicable effects, switched off and switched on."""
    rows = []
    for robot in ROBOTS:
        names = effects.applicable(robots.load(robot))
        nominal = Bench(robot, [])
        inactive = Bench(robot, [{"name": name} for name in names])
        on = Bench(robot, [weak(name) for name in names])
        times = np.array([[b.block() for b in (nominal, inactive, on)] for _ in range(BLOCKS)])
        step = float(np.median(times[:, 0]))
        ratio = np.median(times[:, 1:] / times[:, :1], axis=0) - 1.0
        calls = _calls(on.sim, nominal.sim)
        rows.append(
            {
                "robot": robot,
                "effects": len(names),
                "bare step µs": step,
                "off %": 100.0 * float(ratio[0]),
                "on, calls µs": calls[0],
                "on, calls %": 100.0 * calls[0] / calls[1],
                "on, whole step %": 100.0 * float(ratio[1]),
            }
        )
        for b in (nominal, inactive, on):
            b.sim.close()
    return rows


def _calls(on: Simulation, bare: Simulation) -> tuple[float, float]:
    """Smallest time of all effects in a step, and of the bare step [µs]."""
    per_tick = round(on.dt / on.physics_dt)
    joints, state = on.loop._joints, bare.reset()
    nominal = _least(lambda: bare._drive.torque(*bare.loop._joints))

    def affected() -> None:
        on._world._frames.clear()  # clear the cache, as each step does
        on.loop._affected_torque(*joints)

    torque = _least(affected) - nominal
    hooks = on._on_measurement
    sensing = sum(_least(lambda f=change: f(state)) for *_, change in hooks) / per_tick
    tick = MotionCommand(0, 0.0, bare.robot.standing, np.zeros(len(bare.robot.joints)))
    return torque + sensing, _least(lambda: bare.step(tick), 20) / per_tick


def _least(call: Any, calls: int = 50, repeats: int = 60) -> float:
    """Smallest mean time of a call [µs]."""
    best = float("inf")
    for _ in range(repeats):
        began = time.perf_counter()
        for _ in range(calls):
            call()
        best = min(best, (time.perf_counter() - began) / calls)
    return 1e6 * best
