# SPDX-License-Identifier: Apache-2.0
"""Rollout: the control loop that runs an experiment and returns its log, without ROS."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from loco_control.exceptions import DivergedError
from loco_control.gait.generator import TargetGenerator, standing_pose
from loco_control.stance.controller import StanceController
from loco_control.types import MotionCommand, RobotState
from loco_sim import effects as sim_effects
from loco_sim.plant.joint_commands import JointCommands
from loco_sim.plant.simulation import Simulation

from ..params import PHASES
from ..reflex.joint_sensors import passive_joints, sensor_kinds, sensor_vector
from ..reflex.network import ReflexNetwork
from ..reflex.senses import BodySensors, FootForces
from .experiment import Experiment
from .log import REFLEX_TIME, Log, empty, writer

TEST = PHASES.index("test")


class Motion(Protocol):
    """References of the driven joints over time: oscillators, or a recording."""

    def reset(self) -> None:
        """Return to tick 0."""

    def step(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions [rad] and velocities [rad/s] at time t [s], (m,) each."""


class MotionTarget:
    """A `Motion` with the interface of a target generator."""

    def __init__(self, motion: Motion):
        self.motion, self.reset = motion, motion.reset

    def step(self, state: RobotState) -> MotionCommand:
        """References of the driven joints at the tick of `state`."""
        return MotionCommand(state.tick, state.t, *self.motion.step(state.t))


@dataclass
class Loop:
    """Plant and controllers of an experiment, and their step of one tick.

    The ROS nodes use the same objects and send the same values as messages.

    Attributes:
        target: Generator of the joint references.
        reflex: Network that passes these on, or replaces them.
        stance: Controller of the trunk; None for a robot without one.
        state: Readings of the sensors at the next tick.
        reflex_time: Wall-clock time of the last step of `reflex` [s].
    """

    experiment: Experiment
    seed: int
    sim: Simulation
    target: TargetGenerator | MotionTarget
    reflex: ReflexNetwork
    stance: StanceController | None = None

    def __post_init__(self) -> None:
        robot = self.sim.robot
        self._commands = JointCommands(robot)
        self._passive = passive_joints(robot)
        self._learns = self.experiment.learner.enabled

    def reset(self, seed: int | None = None) -> RobotState:
        """Return to tick 0; a new seed changes the random effects, not the hidden weights."""
        self.target.reset()
        self.reflex.reset()
        if self.stance:
            self.stance.reset()
        self.state = self.sim.reset(seed)
        self.reflex_time = 0.0
        return self.state

    def feel(self, state: RobotState) -> np.ndarray | None:
        """Input of the network from a state; None if the network is disabled."""
        if not self._learns:
            return None
        if self.stance:
            return state.grf[:, 2]
        return sensor_vector(state, self.sim.robot, self._passive)

    def step(self) -> dict[str, Any]:
        """Run one control period; returns its messages by the names of the parts in `PARTS`."""
        state, ground_truth = self.state, self.sim.ground_truth()
        target = self.target.step(state)
        before = time.perf_counter()
        command, learning = self.reflex.step(state.tick, state.t, self.feel(state), target)
        self.reflex_time = time.perf_counter() - before
        row = {
            "state": state, "truth": ground_truth, "target": target, "command": command,
            "learning": learning,
        }  # fmt: skip
        if self.stance:
            row["stance"], row["trunk"] = self.stance.step(state, target, command)
            self.state = self.sim.step(command, row["trunk"])
        else:
            commands = self._commands(state.tick, state.t, command.q, command.dq)
            self.state = self.sim.step(*commands)
        return row

    def close(self) -> None:
        """Free the plant."""
        self.sim.close()


def build(
    experiment: Experiment,
    seed: int | None = None,
    motion: Motion | None = None,
    network: type[ReflexNetwork] = ReflexNetwork,
    plant: Callable[[np.ndarray | None], Any] | None = None,
) -> Loop:
    """Plant and controllers of an experiment, reset and ready to step.

    Args:
        experiment: Experiment to build.
        seed: Seed in place of that of the experiment.
        motion: Motion in place of the oscillators, e.g. a recording.
        network: Class of the network, e.g. one that explores.
        plant: Constructor of another plant in place of `Simulation`, from the initial joint
            positions [rad], (n,); None means the robot's own.
    """
    e, seed = experiment, experiment.seed if seed is None else seed
    robot, dt, effects = e.plant, e.dt, sim_effects.from_list(e.effects)
    posture = standing_pose(e.gait.origin, robot.legs) if e.gait else None
    sim = plant(posture) if plant else Simulation(e.sim_params, effects, seed, dt, robot, posture)
    if e.gait:
        senses, target = FootForces(e.learner), TargetGenerator(e.gait, dt, robot.legs)
        stance = StanceController(e.stance, e.trunk, dt, robot.legs)
    else:
        senses = BodySensors(e.learner, sensor_kinds(robot), len(robot.driven))
        target, stance = MotionTarget(motion or e.make_target()), None
    loop = Loop(e, seed, sim, target, network(e.learner, senses, dt, seed), stance)
    loop.reset()
    return loop


def rollout(
    experiment: Experiment,
    seed: int | None = None,
    on_tick: Callable[[int, Loop], Any] | None = None,
    until: float | None = None,
    motion: Motion | None = None,
    save_weights: str | Path = "",
    plant: Callable[[np.ndarray | None], Any] | None = None,
) -> Log:
    """Run an experiment to its end, or until the robot falls or the physics diverges.

    Args:
        experiment: Experiment to run.
        seed: Seed in place of that of the experiment.
        on_tick: Called after each tick with the number of ticks and the loop.
        until: Stop at this simulated time [s], if the experiment is longer.
        motion: Motion in place of the oscillators, e.g. a recording.
        save_weights: Path for the trained network, written when the test phase begins.
        plant: Constructor of another plant, see `build`.
    """
    loop = build(experiment, seed, motion, plant=plant)
    try:
        return run(loop, on_tick, until, save_weights)
    finally:
        loop.close()


def run(
    loop: Loop,
    on_tick: Callable[[int, Loop], Any] | None = None,
    until: float | None = None,
    save_weights: str | Path = "",
) -> Log:
    """Run a loop after its reset, as in `rollout`; the loop remains open."""
    experiment = loop.experiment
    ticks = experiment.ticks
    if until is not None:
        ticks = min(ticks, round(until * experiment.control_rate))
    columns = empty(experiment, ticks)
    write, reflex_time = writer(experiment, columns), np.zeros(ticks)
    save_at = TEST if save_weights and loop.reflex.parts() else -1
    started, done, fall_reason = time.perf_counter(), 0, ""
    while done < ticks and not fall_reason:
        try:
            row = loop.step()
        except DivergedError as error:
            fall_reason = str(error)
            break
        write(done, row)
        reflex_time[done] = loop.reflex_time
        if row["learning"].phase == save_at:  # the readout does not change any more
            loop.reflex.save(save_weights)
            save_at = -1
        done += 1
        fall_reason = loop.sim.fallen or ""
        if on_tick:
            on_tick(done, loop)
    columns = {name: column[:done] for name, column in columns.items()}
    columns[REFLEX_TIME] = reflex_time[:done]
    return Log(columns, experiment, loop.seed, fall_reason, time.perf_counter() - started)
