# SPDX-License-Identifier: Apache-2.0
"""Pool of experiments to choose the next one from, and what a model says in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import correlate

from loco_control.exceptions import DivergedError, LocoError, NameUnknownError, ParameterError
from loco_sim.plant.model import Model
from loco_sim.robot.robot import Robot

from ...runs.experiment import Experiment
from ...runs.log import Log
from ...runs.rollout import rollout
from ..prediction import running
from ..recordings.record import Record, bridged
from .excitation import joints_of, library

SAME = 0.98  # cosine from which on two motions are the same: noise and smoothing are less (taste)
SHRINK, TRIES = 0.7, 6  # of a motion that is beyond a limit


def pool(model: Model, notes: list[str] | None = None) -> list[Experiment]:
    """All experiments for the robot of a model; arguments as of `excitation.library`."""
    return library(model, notes)


def alike(
    model: Model, experiments: Sequence[Experiment], robots: Sequence[Robot]
) -> list[Experiment]:
    """Those in which the robot is bolted, or free, as in some recording; else all.

    On the ground contacts join in, of which recordings on a stand say nothing: what the model
    lacks there would be a gap of its own.

    Args:
        model: Model before the search.
        experiments: Experiments to choose from.
        robots: Robots as they were held in the recordings.
    """
    ways = {robot.fixed_base for robot in robots}
    found = [e for e in experiments if _with(model, e).plant.fixed_base in ways]
    return found or list(experiments)


def same_motion(experiment: Record, given: Record) -> bool:
    """Whether a recording holds the motion that an experiment commands, at any time.

    What robots that are led along their motion were told is not there: where no kind of command is
    common, measured positions are compared.
    """
    kinds = [kind for kind in experiment.command if kind in given.command]
    if kinds:
        sides = [(r.t, r.command[kinds[0]], r.driven) for r in (experiment, given)]
    else:
        sides = [(r.t, bridged(r.signals["q"]), r.joints) for r in (experiment, given)]
    if set(sides[0][2]) != set(sides[1][2]):
        return False
    order = [sides[1][2].index(name) for name in sides[0][2]]
    dt = max(experiment.dt, given.dt)
    a = _even(*sides[0][:2], dt)
    b = _even(sides[1][0], sides[1][1][:, order], dt)
    short, long = sorted((a, b), key=len)
    return 2 * len(short) > len(a) and _likeness(short, long) > SAME


def _even(t: np.ndarray, values: np.ndarray, dt: float) -> np.ndarray:
    """Columns on an even axis, without their means, (S, n)."""
    axis = np.arange(t[0], t[-1] + 0.5 * dt, dt)
    found = np.column_stack([np.interp(axis, t, column) for column in values.T])
    return found - found.mean(axis=0)


def _likeness(short: np.ndarray, long: np.ndarray) -> float:
    """Largest cosine of a motion with a part of a longer one, both (S, n)."""
    pairs = list(zip(short.T, long.T, strict=True))
    product = sum(correlate(b, a, mode="valid", method="fft") for a, b in pairs)
    ones = np.ones(len(short))
    energy = sum(correlate(b**2, ones, mode="valid", method="fft") for _, b in pairs)
    size = np.sqrt(np.square(short).sum() * np.maximum(energy, 0.0))
    return float(np.max(product / np.maximum(size, 1e-12 + 1e-9 * np.max(size))))


def choose(experiments: Sequence[Experiment], name: str) -> Experiment:
    """An experiment by its name.

    Raises:
        NameUnknownError: It is not in the pool.
    """
    for experiment in experiments:
        if experiment.name == name:
            return experiment
    raise NameUnknownError("experiment", name, [e.name for e in experiments])


def records(
    model: Model, experiments: Sequence[Experiment], notes: list[str] | None = None
) -> list[Record]:
    """Readings of the model's sensors in each experiment, as if they had been measured.

    Args:
        model: Model that runs them.
        experiments: Experiments to run.
        notes: Gets a sentence for each experiment that the model cannot run, which is left out;
            without it that is an error.

    Raises:
        LocoError: The model cannot run an experiment, and there is nowhere to note it.
    """
    found = []
    for experiment in experiments:
        try:
            found.append(record_of(rollout(_with(model, experiment)), experiment.name))
        except LocoError as error:
            if notes is None:
                raise
            notes.append(f"the experiment {experiment.name} is not possible: {error}")
    return found


def _with(model: Model, experiment: Experiment) -> Experiment:
    """The experiment with a model's effects, and its values under those of the experiment.

    Its control period is a whole number of physics steps, as in a search, whatever the rates.
    """
    made = experiment.replace(
        overrides={**model.overrides, **experiment.overrides},
        effects=tuple(dict(e) for e in model.effects),
    )
    rate = running.steps_in(made.dt, made.sim_params.physics_rate) / made.dt
    return made.replace(sim={**made.sim, "physics_rate": rate})


def record_of(log: Log, name: str = "") -> Record:
    """A run as a `Record`: commands, joints and IMU."""
    robot = log.experiment.plant
    driven = tuple(robot.joints[i] for i in robot.driven)
    torque = not np.isfinite(joints_of(robot).speed).any()
    kind = "torque" if torque else "position"
    signals = {"q": log.q, "dq": log.dq, "tau": log.tau}
    signals |= {"gyro": log.gyro, "acceleration": log.acceleration}
    known = {k: v for k, v in log.experiment.overrides.items() if k in ("fixed_base", "height")}
    command = {kind: log.command} if torque else {kind: log.command, "velocity": log.command_dq}
    return Record(
        name or log.experiment.name, log.t - log.t[0], command, driven,
        {k: np.array(v) for k, v in signals.items()}, robot.joints, overrides=known,
    )  # fmt: skip


def beyond(log: Log) -> str:
    """The first limit of the robot that a run does not keep, in words; empty if it keeps all."""
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
        geared = getattr(robot.drives.get(name), "rotor_inertia", 0.0) > 0.0  # limits its motor
        if not geared and np.abs(log.tau[:, i]).max() > 0.98 * robot.effort[i]:
            return f"{name} meets its torque limit"
    return ""


def within_limits(experiment: Experiment) -> Experiment:
    """The experiment, its motion made smaller until the model keeps within the robot's limits.

    Raises:
        ParameterError: The smallest one does not.
    """
    why = ""
    for _ in range(TRIES):
        try:
            why = beyond(rollout(experiment))
        except DivergedError as error:
            why = str(error)
        if not why:
            return experiment
        target = experiment.target
        smaller = tuple(round(SHRINK * a, 5) for a in target.amplitude)
        experiment = experiment.replace(target=target.replace(amplitude=smaller))
    raise ParameterError(f"{experiment.name} is not possible within the robot's limits: {why}")
