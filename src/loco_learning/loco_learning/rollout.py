# SPDX-License-Identifier: Apache-2.0
"""The one loop: an experiment in, a log out, no ROS."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.exceptions import DivergedError
from loco_control.gait import TargetGenerator, standing_pose
from loco_control.stance import StanceController
from loco_sim import effects as sim_effects
from loco_sim.simulation import Simulation

from .experiment import Experiment
from .log import PARTS, Column, Log
from .reflex import TEST, ReflexNetwork


@dataclass
class Loop:
    """Plant and controllers of an experiment, and one tick of them.

    The nodes make the same objects and send the same values as messages.
    """

    experiment: Experiment
    seed: int
    sim: Simulation
    generator: TargetGenerator
    reflex: ReflexNetwork
    stance: StanceController

    def reset(self) -> None:
        """Everything back to tick 0."""
        self.generator.reset()
        self.reflex.reset()
        self.stance.reset()
        self.state = self.sim.reset()
        self.reflex_time = 0.0

    def step(self) -> dict[str, Any]:
        """One control period; returns its messages by the names of `log.PARTS`."""
        state, truth = self.state, self.sim.ground_truth()
        target = self.generator.step(state)
        before = time.perf_counter()
        command, learning = self.reflex.step(state, target)
        self.reflex_time = time.perf_counter() - before
        stance, trunk = self.stance.step(state, target, command)
        self.state = self.sim.step(command, trunk)
        return {
            "state": state,
            "target": target,
            "command": command,
            "learning": learning,
            "stance": stance,
            "trunk": trunk,
            "truth": truth,
        }

    def close(self) -> None:
        """Free the plant."""
        self.sim.close()


def build(experiment: Experiment, seed: int | None = None) -> Loop:
    """Plant and controllers of an experiment, reset and ready to step.

    Args:
        experiment: What to build.
        seed: Instead of the seed of the experiment.
    """
    seed = experiment.seed if seed is None else seed
    dt = experiment.dt
    loop = Loop(
        experiment,
        seed,
        Simulation(
            experiment.sim,
            experiment.impedance,
            sim_effects.from_list(experiment.effects),
            seed,
            dt,
            experiment.robot,
            standing_pose(experiment.gait.origin),
        ),
        TargetGenerator(experiment.gait, dt),
        ReflexNetwork(experiment.learner, dt, seed),
        StanceController(experiment.stance, experiment.trunk, dt),
    )
    loop.reset()
    return loop


def rollout(
    experiment: Experiment,
    seed: int | None = None,
    on_tick: Callable[[int, Loop], None] | None = None,
    save_weights: str = "",
) -> Log:
    """Run an experiment to its end or until the robot falls.

    Args:
        experiment: What to run.
        seed: Instead of the seed of the experiment.
        on_tick: Called after each tick with its number and the loop, for progress.
        save_weights: Path for the trained network, written when the test phase begins.
    """
    loop = build(experiment, seed)
    try:
        return _run(loop, on_tick, save_weights)
    finally:
        loop.close()


def _run(loop: Loop, on_tick: Callable[[int, Loop], None] | None, save_weights: str) -> Log:
    ticks = loop.experiment.ticks
    columns = {name: Column(kind, ticks) for name, kind in PARTS.items()}
    reflex_time = np.zeros(ticks)
    started, done = time.perf_counter(), 0
    fall = None
    while done < ticks and not fall:
        try:
            messages = loop.step()
        except DivergedError as error:
            fall = str(error)
            break
        for name, message in messages.items():
            columns[name].add(done, message)
        reflex_time[done] = loop.reflex_time
        if save_weights and messages["learning"].phase == TEST:  # nothing learns from here on
            loop.reflex.save(save_weights)
            save_weights = ""
        done += 1
        fall = loop.sim.fallen
        if on_tick:
            on_tick(done, loop)
    return Log(
        **{name: column.stacked(done) for name, column in columns.items()},
        experiment=loop.experiment,
        seed=loop.seed,
        fall=fall or "",
        reflex_time=reflex_time[:done],
        wall_time=time.perf_counter() - started,
    )
