# SPDX-License-Identifier: Apache-2.0
"""Pool of experiments from which the next is chosen, and their simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loco_control.exceptions import DivergedError, LocoError, NameUnknownError, ParameterError
from loco_sim import lazy
from loco_sim.bolted.loop import Bolted, needs_engine
from loco_sim.drives.spring_kernels import spring_torques
from loco_sim.effects import from_list
from loco_sim.plant.joint_commands import JointCommands
from loco_sim.plant.model import Model
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import TorqueDrive

from ...runs.experiment import Experiment
from ...runs.log import Log
from ...runs.rollout import rollout
from ..prediction import running
from ..recordings.record import Record, bridged
from .excitation import library

signal = lazy.module("scipy.signal")  # loaded on first use, since it takes 0.5 s

SAME = 0.98  # cosine above which two motions are the same; noise and smoothing are less (taste)
SHRINK, TRIES = 0.7, 6  # scaling of a motion that violates a limit, and number of attempts


def pool(model: Model, notes: list[str] | None = None) -> list[Experiment]:
    """All experiments for the robot of a model; arguments as of `excitation.library`."""
    return library(model, notes)


def usable(
    model: Model, experiments: Sequence[Experiment], robots: Sequence[Robot]
) -> list[Experiment]:
    """Experiments with the base fixed or free as in some recording; all if there is none.

    Recordings on a stand contain no contacts: a wrong contact model would appear as a gap of its
    own on the ground.

    Args:
        model: Model before the search.
        experiments: Experiments to choose from.
        robots: Robots with the base fixed or free as in the recordings.
    """
    bases = {robot.fixed_base for robot in robots}
    matches = [e for e in experiments if _with(model, e).plant.fixed_base in bases]
    return matches or list(experiments)


def same_motion(experiment: Record, record: Record) -> bool:
    """True if a recording contains the commanded motion of an experiment, at any time.

    If the two have no kind of command in common, as with inverse dynamics, measured positions are
    compared.
    """
    modes = [kind for kind in experiment.command if kind in record.command]
    if modes:
        sides = [(r.t, r.command[modes[0]], r.driven) for r in (experiment, record)]
    else:
        sides = [(r.t, bridged(r.signals["q"]), r.joints) for r in (experiment, record)]
    if set(sides[0][2]) != set(sides[1][2]):
        return False
    order = [sides[1][2].index(name) for name in sides[0][2]]
    dt = max(experiment.dt, record.dt)
    a = _even(*sides[0][:2], dt)
    b = _even(sides[1][0], sides[1][1][:, order], dt)
    short, long = sorted((a, b), key=len)
    return 2 * len(short) > len(a) and _likeness(short, long) > SAME


def _even(t: np.ndarray, values: np.ndarray, dt: float) -> np.ndarray:
    """Columns on an evenly spaced time axis, minus their means, (S, n)."""
    axis = np.arange(t[0], t[-1] + 0.5 * dt, dt)
    resampled = np.column_stack([np.interp(axis, t, column) for column in values.T])
    return resampled - resampled.mean(axis=0)


def _likeness(short: np.ndarray, long: np.ndarray) -> float:
    """Largest cosine of a motion and a part of a longer one, both (S, n)."""
    pairs = list(zip(short.T, long.T, strict=True))
    product = sum(signal.correlate(b, a, mode="valid", method="fft") for a, b in pairs)
    window = np.ones(len(short))
    energy = sum(signal.correlate(b**2, window, mode="valid", method="fft") for _, b in pairs)
    size = np.sqrt(np.square(short).sum() * np.maximum(energy, 0.0))
    return float(np.max(product / np.maximum(size, 1e-12 + 1e-9 * np.max(size))))


def choose(experiments: Sequence[Experiment], name: str) -> Experiment:
    """An experiment by its name.

    Raises:
        NameUnknownError: The pool has no experiment of this name.
    """
    for experiment in experiments:
        if experiment.name == name:
            return experiment
    raise NameUnknownError("experiment", name, [e.name for e in experiments])


def records(
    model: Model,
    experiments: Sequence[Experiment],
    notes: list[str] | None = None,
    ideal: bool = False,
) -> list[Record]:
    """Simulated sensor readings of the model in each experiment, as records.

    Args:
        model: Model to simulate.
        experiments: Experiments to simulate.
        notes: List to which a sentence is appended for each experiment that the model cannot run
            and that is left out; if None, that is an error.
        ideal: Whether sensors of bolted robots add no quantisation and no noise, which takes no
            engine and a tenth of the time.

    Raises:
        LocoError: The model cannot run an experiment, and `notes` is None.
    """
    result = []
    for experiment in experiments:
        try:
            variant = _with(model, experiment)
            log = _bolted(variant) if ideal else None
            result.append(record_of(log or rollout(variant), experiment.name))
        except LocoError as error:
            if notes is None:
                raise
            notes.append(f"the experiment {experiment.name} is not possible: {error}")
    return result


def _with(model: Model, experiment: Experiment) -> Experiment:
    """The experiment with the effects and values of a model; its own values have priority.

    The control period is a whole number of physics steps, as in a search, for any rates.
    """
    adapted = experiment.replace(
        overrides={**model.overrides, **experiment.overrides},
        effects=tuple(dict(e) for e in model.effects),
    )
    rate = running.steps_in(adapted.dt, adapted.sim_params.physics_rate) / adapted.dt
    return adapted.replace(sim={**adapted.sim, "physics_rate": rate})


def _bolted(experiment: Experiment) -> Log | None:
    """Run with ideal sensors and without the engine; None if it is needed."""
    robot, effects = experiment.plant, from_list(experiment.effects)
    sensors = robot.sensors and robot.sensors.replace(exact=True)
    robot = replace(robot, sensors=sensors, sim=experiment.sim_params)
    if experiment.gait or experiment.learner.enabled or needs_engine(robot, effects):
        return None
    target, t = experiment.make_target(), np.arange(experiment.ticks) * experiment.dt
    targets, speed = (np.array(rows) for rows in zip(*map(target.step, t), strict=True))
    plant = Bolted(robot, effects, experiment.seed, experiment.dt)
    with np.errstate(over="ignore", invalid="ignore"):
        readings = plant.run(*JointCommands(robot).sequence(targets, speed)[:3])
    imu = {"gyro": np.zeros((len(t), 3)), "acceleration": np.tile(-plant.gravity, (len(t), 1))}
    columns = {"t": t, "command": targets, "command_dq": speed, **readings._asdict(), **imu}
    return Log(columns, experiment) if np.isfinite(readings.q).all() else None


def record_of(log: Log, name: str = "") -> Record:
    """A simulation log as a `Record`: commands, joints and IMU."""
    robot = log.experiment.plant
    driven = tuple(robot.joints[i] for i in robot.driven)
    is_torque = np.array(
        [isinstance(robot.drives[name], TorqueDrive) for name in driven], dtype=bool
    )
    command = {}
    if is_torque.any():
        command["torque"] = np.where(is_torque, log.command, 0.0)
    if not is_torque.all():
        command |= {"position": np.where(is_torque, 0.0, log.command), "velocity": log.command_dq}
    signals = {"q": log.q, "dq": log.dq, "tau": log.tau}
    signals |= {"gyro": log.gyro, "acceleration": log.acceleration}
    overrides = {k: v for k, v in log.experiment.overrides.items() if k in ("fixed_base", "height")}
    return Record(
        name or log.experiment.name, log.t - log.t[0], command, driven,
        {k: np.array(v) for k, v in signals.items()}, robot.joints, overrides=overrides,
        joint_torque=True,
    )  # fmt: skip


def limit_violation(log: Log) -> str:
    """The first limit of the robot that a simulation violates, in words; empty if there is none."""
    from loco_sim.robot.description import Description

    from .excitation import velocities

    robot = log.experiment.plant
    description, fastest = Description(robot.urdf), velocities(robot.urdf)
    if log.fall:
        return log.fall
    for i in robot.driven:
        name = robot.joints[i]
        low, high = description.limits(name)
        if log.q[:, i].min() < low or log.q[:, i].max() > high:
            return f"{name} reaches its stop"
        if np.abs(log.dq[:, i]).max() > fastest.get(name, np.inf):
            return f"{name} is faster than {fastest[name]:g} rad/s"
        geared = getattr(robot.drives.get(name), "rotor_inertia", 0.0) > 0.0  # limit of the motor
        tau = log.tau[:, i]
        if name in robot.springs:  # which act beside the drive
            tau = tau - spring_torques(log.q[:, i], log.dq[:, i], robot.springs[name].row())
        if not geared and np.abs(tau).max() > 0.98 * robot.effort[i]:
            return f"{name} meets its torque limit"
    return ""


def within_limits(experiment: Experiment) -> Experiment:
    """The experiment with its motion scaled down until the model respects the robot's limits.

    Raises:
        ParameterError: The smallest motion violates a limit.
    """
    reason = ""
    for _ in range(TRIES):
        try:
            reason = limit_violation(_bolted(experiment) or rollout(experiment))
        except DivergedError as error:
            reason = str(error)
        if not reason:
            return experiment
        target = experiment.target
        smaller = tuple(round(SHRINK * a, 5) for a in target.amplitude)
        experiment = experiment.replace(target=target.replace(amplitude=smaller))
    raise ParameterError(f"{experiment.name} is not possible within the robot's limits: {reason}")
