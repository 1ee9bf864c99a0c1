# SPDX-License-Identifier: Apache-2.0
"""The loop of a joint robot without ROS: a `JointExperiment` in, a `JointLog` out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from loco_control.exceptions import DivergedError
from loco_control.types import RobotState
from loco_sim import effects as sim_effects
from loco_sim.joint_commands import JointCommands
from loco_sim.simulation import Simulation

from .joint_experiment import JointExperiment
from .joint_log import JointLog, empty
from .joint_reflex import PHASES, JointReflex
from .joint_sensors import passive_joints, sensor_kinds, sensor_vector

TEST = PHASES.index("test")


class Target(Protocol):
    """What tells the driven joints where to go: a `Cpg`, or a recording."""

    def reset(self) -> None:
        """Back to tick 0."""

    def step(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Positions [rad] and velocities [rad/s] at time t [s], (m,) each."""


@dataclass
class JointLoop:
    """Plant and controllers of an experiment, and one tick of them.

    The nodes make the same objects and send the same values as messages.

    Attributes:
        state: What the sensors say at the next tick.
        spoken: What was said in the last tick: target, target_dq, command, command_dq,
            prediction, phase, error.
    """

    experiment: JointExperiment
    seed: int
    sim: Simulation
    target: Target
    reflex: JointReflex
    spoken: tuple = field(default=(), repr=False)

    def __post_init__(self) -> None:
        robot = self.sim.robot
        self._commands = JointCommands(robot)
        self._passive = passive_joints(robot)
        self._learns = self.experiment.learner.enabled

    def reset(self, seed: int | None = None) -> RobotState:
        """Everything back to tick 0; a new seed draws the effects anew, not the hidden weights."""
        self.target.reset()
        self.reflex.reset()
        self.state = self.sim.reset(seed)
        return self.state

    def step(self) -> RobotState:
        """One control period; returns the state after it."""
        state = self.state
        q, dq = self.target.step(state.t)
        sensors = sensor_vector(state, self.sim.robot, self._passive) if self._learns else None
        out = self.reflex.step(state.tick, state.t, sensors, q, dq)
        command, command_dq, prediction, phase, error = out
        self.spoken = (q, dq, command, command_dq, prediction, phase, error)
        self.state = self.sim.step(*self._commands(state.tick, state.t, command, command_dq))
        return self.state

    def close(self) -> None:
        """Free the plant."""
        self.sim.close()


def build(
    experiment: JointExperiment, seed: int | None = None, target: Target | None = None
) -> JointLoop:
    """Plant and controllers of an experiment, reset and ready to step.

    Args:
        experiment: What to build.
        seed: Instead of the seed of the experiment.
        target: Instead of the oscillators of the experiment, e.g. a recording.
    """
    seed = experiment.seed if seed is None else seed
    robot, dt = experiment.plant, experiment.dt
    loop = JointLoop(
        experiment,
        seed,
        Simulation(
            experiment.sim_params, None, sim_effects.from_list(experiment.effects), seed, dt, robot
        ),
        target or experiment.make_target(),
        JointReflex(experiment.learner, sensor_kinds(robot), len(robot.driven), dt, seed),
    )
    loop.reset()
    return loop


def rollout(
    experiment: JointExperiment,
    seed: int | None = None,
    on_tick: Callable[[int, JointLoop], Any] | None = None,
    until: float | None = None,
    target: Target | None = None,
    save_weights: str = "",
) -> JointLog:
    """Run an experiment to its end, or until the robot falls or the physics diverges.

    Args:
        experiment: What to run.
        seed: Instead of the seed of the experiment.
        on_tick: Called after each tick with the count of ticks and the loop.
        until: Stop at this simulated time [s], if the experiment is longer.
        target: Instead of the oscillators of the experiment, e.g. a recording.
        save_weights: Path for the trained network, written when the test phase begins.
    """
    loop = build(experiment, seed, target)
    try:
        return run(loop, on_tick, until, save_weights)
    finally:
        loop.close()


def run(
    loop: JointLoop,
    on_tick: Callable[[int, JointLoop], Any] | None = None,
    until: float | None = None,
    save_weights: str | Path = "",
) -> JointLog:
    """Run a loop that was just reset, as `rollout` does; the loop stays open."""
    experiment = loop.experiment
    ticks = experiment.ticks
    if until is not None:
        ticks = min(ticks, round(until * experiment.control_rate))
    columns = empty(experiment, ticks)
    write = _writer(columns)
    save_at = TEST if save_weights and experiment.learner.enabled else -1
    started, done, fall = time.perf_counter(), 0, ""
    while done < ticks and not fall:
        state, truth = loop.state, loop.sim.ground_truth()
        try:
            loop.step()
        except DivergedError as error:
            fall = str(error)
            break
        write(done, state, truth, loop.spoken)
        if loop.spoken[5] == save_at:  # nothing learns from here on
            loop.reflex.save(save_weights)
            save_at = -1
        done += 1
        fall = loop.sim.fallen or ""
        if on_tick:
            on_tick(done, loop)
    columns = {name: column[:done] for name, column in columns.items()}
    return JointLog(columns, experiment, loop.seed, fall, time.perf_counter() - started)


def _writer(columns: dict[str, np.ndarray]) -> Callable:
    """Function that writes one row of all columns."""
    c = columns
    t, q, dq, tau = c["t"], c["q"], c["dq"], c["tau"]
    position, orientation, velocity, spin = (
        c["position"], c["orientation"], c["velocity"], c["spin"]
    )  # fmt: skip
    imu, gyro, acceleration, contact = (
        c["imu_orientation"], c["gyro"], c["acceleration"], c["contact"]
    )  # fmt: skip
    names = ("target", "target_dq", "command", "command_dq", "prediction", "phase", "error")
    said = [c[name] for name in names]

    def write(row: int, state: RobotState, truth: Any, spoken: tuple) -> None:
        t[row], q[row], dq[row], tau[row] = state.t, state.q, state.dq, state.tau
        imu[row], gyro[row] = state.orientation, state.angular_velocity
        acceleration[row], contact[row] = state.linear_acceleration, state.contact
        position[row], orientation[row] = truth.position, truth.orientation
        velocity[row], spin[row] = truth.linear_velocity, truth.angular_velocity
        for column, value in zip(said, spoken, strict=True):
            column[row] = value

    return write
