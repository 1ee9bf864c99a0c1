# SPDX-License-Identifier: Apache-2.0
"""Simulation of a model along a record, without the physics engine where possible."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from loco_control.exceptions import DivergedError, ParameterError
from loco_sim.bolted.loop import Bolted, Segments, needs_engine
from loco_sim.drives.actuators import Actuators
from loco_sim.drives.servo_kernels import INTEGRAL
from loco_sim.effects.base import Effect
from loco_sim.plant.orders import CommandSequence, ramped
from loco_sim.plant.simulation import Simulation
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ServoParams, TorqueDrive
from loco_sim.world.world import Base

from ..recordings.record import Record
from .channels import Channel, Track, assembled

WINDING = 1e-3  # tried change of an integrator over its limit: below dry friction (taste)
LEAST_SLOPE = 0.05  # torque of a drive by that of its integrator; less is delayed or cut (taste)


class Start(NamedTuple):
    """Initial state of a piece of a record."""

    row: int  # first row
    stop: int  # row after the last
    q: np.ndarray  # joint positions [rad or m], (n,)
    dq: np.ndarray  # joint velocities, (n,)
    base: Base | None = None  # None: as after a reset
    integral: np.ndarray | float = 0.0  # torques of the integrators [N·m or N], (n,)
    needed: np.ndarray | float = math.nan  # torques of the measured motion [N·m or N], (n,)
    wound: np.ndarray | bool = False  # integrators that hold a load, not just switched on, (n,)
    measured: np.ndarray | bool = False  # of these, whose drive's torque was measured, (n,)


def period(record: Record) -> float:
    """Time between samples [s]; the rate is rounded, since time stamps are."""
    return 1.0 / round(1.0 / record.dt, 3)


def steps_in(dt: float, rate: float) -> int:
    """Physics steps in a control period, for at least a given rate [Hz]."""
    return max(1, math.ceil(dt * rate - 0.01))  # tolerance for a rounded rate


def step(robot: Robot, dt: float) -> float:
    """Physics step of a simulation [s], including its substeps for damping."""
    if not needs_engine(robot, []):
        return Bolted(robot, [], 0, dt).physics_dt
    with _engine(robot, (), dt) as sim:
        return sim.physics_dt


def _engine(robot: Robot, effects: Sequence[Effect], dt: float) -> Simulation:
    """Simulation with the same damping scheme for all effects, so that models differ by these."""
    sim = robot.sim.replace(implicit_damping=False)
    return Simulation(None, effects, 0, dt, replace(robot, sim=sim))


def sequence(record: Record, robot: Robot) -> CommandSequence:
    """Commands of a record.

    Raises:
        ParameterError: The record lacks the kind of command that a drive needs, or a command is
            not finite.
    """
    driven = robot.driven
    drives = [robot.drives[robot.joints[i]] for i in driven]
    torque = np.array([isinstance(drive, TorqueDrive) for drive in drives], dtype=bool)
    speed = np.array([drive.command == "velocity" for drive in drives], dtype=bool)
    tables = {kind: np.zeros((len(record.t), len(robot.joints))) for kind in ("q", "dq", "tau")}
    needed = {"position": ~torque & ~speed, "velocity": speed, "torque": torque}
    for key, kind, columns in (("q", "position", ~torque & ~speed), ("dq", "velocity", ~torque),
                            ("tau", "torque", torque | ~_servos(drives))):  # fmt: skip
        is_required = kind in needed and needed[kind].any()
        if columns.any() and (is_required or kind in record.command):
            tables[key][:, driven[columns]] = record.command_of(robot, kind)[:, columns]
    if not all(np.all(np.isfinite(values)) for values in tables.values()):
        raise ParameterError(f"{record.name}: a command is not finite")
    power = None
    if record.inputs:
        unity = np.ones(len(record.t))
        power = np.stack([record.inputs.get(k, unity) for k in ("supply", "enable")], axis=1)
    ramps = tuple(kind in record.ramps for kind in ("position", "velocity", "torque"))
    stance = record.stance_of(robot.feet)
    return CommandSequence(tables["q"], tables["dq"], tables["tau"], power, ramps, stance)


def _servos(drives: Sequence[Any]) -> np.ndarray:
    """Flags of drives that accept no torque in addition to a position, (m,) bool."""
    return np.array([isinstance(drive, ServoParams) for drive in drives], dtype=bool)


def integral_limits(robot: Robot) -> np.ndarray:
    """Largest torque of the integrator of each joint [N·m or N], (n,); 0 without one.

    Where neither drive nor joint has a limit, it is the torque by an error of 1 rad or m for 1 s.
    """
    limits = np.zeros(len(robot.joints))
    for i, joint in enumerate(robot.joints):
        drive = robot.drives.get(joint)
        if getattr(drive, "integrates", False):
            gain = drive.kp + drive.ki + (drive.kd + drive.speed_ki) * (1.0 + drive.position_gain)
            limit = min(drive.integral_limit, robot.effort[i])
            limits[i] = limit if math.isfinite(limit) else gain
    return limits


def loads(
    robot: Robot, commands: CommandSequence, dt: float, state: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Torques with which a robot moves as measured [N·m or N], by inverse dynamics.

    Args:
        robot: The robot.
        commands: Commands.
        dt: Time between rows [s].
        state: Joint positions, velocities and accelerations at the first row, (3, n).

    Returns:
        Torques of the motion, (n,), NaN if the robot needs the engine; of these the part that
        integrators hold, (n,), within `integral_limits`, 0 if the robot needs the engine.
    """
    limit = integral_limits(robot)
    if needs_engine(robot):
        return np.full(len(limit), np.nan), np.zeros(len(limit))
    plant = Bolted(robot, (), 0, dt)
    moved, weight = plant.needed(*state[:, None])
    moving = moved[0] + weight[0] @ plant.gravity
    if not (limit.any() and np.isfinite(moving).all()):
        return moving, np.zeros(len(limit))
    loops = Actuators(robot, step(robot, dt))
    loops.limit(np.full(len(limit), np.inf))
    loops.reset(state[0])
    loops.follow(*robot.coupled(commands.q[0], commands.dq[0]))
    demand = np.add(loops.torque(*state[:2]), commands.tau[0])
    return moving, np.clip(moving - demand, -limit, limit)


def along(
    robot: Robot, commands: CommandSequence, dt: float, motion: np.ndarray, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Torques of drives that act on a measured motion [N·m or N].

    Args:
        robot: The robot.
        commands: Commands.
        dt: Time between rows [s].
        motion: Joint positions and velocities, (2, T, n).
        first: Torques of integrators at the first row, (n,).

    Returns:
        Torques of integrators at each row, (T, n); mean torques of the drives from each row to the
        next, without springs, (T, n).
    """
    steps, table = steps_in(dt, robot.sim.physics_rate), motion.transpose(1, 0, 2)
    loops = Actuators(replace(robot, springs={}), dt / steps)
    integral, torque = np.zeros((2, *motion[0].shape))
    loops.start(*table[0], 0, first)
    changes = np.diff(table, axis=0, append=table[-1:]) / steps
    for row, (state, change) in enumerate(zip(table, changes, strict=True)):
        integral[row] = loops.rows()[2][:, INTEGRAL]
        loops.follow(*robot.coupled(commands.q[row], commands.dq[row]))
        for k in range(steps):
            torque[row] += np.divide(loops.torque(*(state + k * change)), steps)
    return integral, torque + commands.tau[: len(torque)]


def run(
    robot: Robot,
    effects: Sequence[Effect],
    inputs: CommandSequence,
    starts: Sequence[Start],
    dt: float,
    channels: Sequence[Channel],
) -> np.ndarray:
    """Simulated readings of a robot, (T, C); NaN outside of pieces, and where it diverges.

    Args:
        robot: The robot.
        effects: Effects on the robot.
        inputs: Commands.
        starts: Initial states of the pieces; empty for the whole record from rest in standing.
        dt: Time between rows [s].
        channels: Columns of the result.

    Raises:
        LocoError: An effect is invalid for the robot.
    """
    noiseless = [effect for effect in effects if not effect.identity.noise]
    if needs_engine(robot, noiseless):
        return _with_engine(robot, noiseless, inputs, starts, dt, channels)
    starts = _loaded(robot, noiseless, inputs, starts, dt)
    readings = _readings(robot, noiseless, inputs, starts, dt)
    return assembled(robot, channels, readings._asdict(), len(inputs.q))


def _readings(
    robot: Robot,
    effects: Sequence[Effect],
    inputs: CommandSequence,
    starts: Sequence[Start],
    dt: float,
) -> Any:
    """Readings of a bolted robot in all rows; arguments as for `run`."""
    segments = None
    if starts:
        rows = np.array([[s.row, s.stop] for s in starts])
        states = [np.broadcast_arrays(s.q, s.dq, s.integral, s.needed) for s in starts]
        segments = Segments(rows, np.array(states, dtype=float))
    plant = Bolted(robot, effects, 0, dt)
    with np.errstate(over="ignore", invalid="ignore"):
        swinging = inputs.swinging(robot)
        return plant.run(*inputs[:3], None, inputs.power, segments, inputs.ramps, swinging)


def _loaded(
    robot: Robot,
    effects: Sequence[Effect],
    inputs: CommandSequence,
    starts: Sequence[Start],
    dt: float,
) -> Sequence[Start]:
    """Initial states whose integrators make up for effects on the motors; arguments as for `run`.

    What a drive holds when a record begins does not depend on its torque constant: its integrator
    does. In the first row drives give the torque that they would give without these effects.
    Integrators of later pieces hold as much more.
    """
    motors = [effect for effect in effects if effect.identity.touches == ("drive",)]
    if not motors or not starts or not np.any(starts[0].wound):
        return starts
    first, limit = starts[0], integral_limits(robot)
    stop, drives = min(first.row + 2, first.stop), replace(robot, motor_torque=True)

    def torque_of(acting: Sequence[Effect], change: np.ndarray | float) -> np.ndarray:
        start = first._replace(stop=stop, integral=first.integral + change)
        return _readings(drives, acting, inputs, [start], dt).tau[stop - 1]

    by = np.where(first.wound & (limit > 0.0), WINDING * limit, 1.0)
    torque = torque_of(motors, 0.0)
    slope = (torque_of(motors, by) - torque) / by
    acts = first.wound & (limit > 0.0) & (slope > LEAST_SLOPE)
    change = np.divide(torque_of([], 0.0) - torque, slope, out=np.zeros(len(limit)), where=acts)
    return [
        s._replace(integral=np.clip(s.integral + np.nan_to_num(change), -limit, limit))
        for s in starts
    ]


def divided(
    commands: CommandSequence, starts: Sequence[Start], parts: int
) -> tuple[CommandSequence, list[Start]]:
    """Commands and initial states of the same run with `parts` rows in place of each."""
    rows = [s._replace(row=parts * s.row, stop=parts * s.stop) for s in starts]
    table, which = ramped(np.stack(commands[:3], axis=1), parts, commands.ramps)
    power = None if commands.power is None else np.repeat(commands.power, parts, axis=0)
    stance = np.repeat(commands.stance, parts, axis=0)
    return CommandSequence(*table[which].transpose(1, 0, 2), power, commands.ramps, stance), rows


def instants(
    robot: Robot,
    effects: Sequence[Effect],
    commands: CommandSequence,
    starts: Sequence[Start],
    dt: float,
    channels: Sequence[Channel],
) -> np.ndarray:
    """Change of torques if they are those of an instant, not means over the period before.

    A drive may report the torque at the reading, or the one that it has just computed from the
    command of that row. Arguments as of `run`; the run has a row for each physics step.

    Returns:
        (T, C, 2): change to the instant before the command of the row, and from there to the one
        after it; 0 in other channels, with one step per period, and if the engine is needed.
    """
    effects = [effect for effect in effects if not effect.identity.noise]
    parts = steps_in(dt, robot.sim.physics_rate)
    change = np.zeros((len(commands.q), len(channels), 2))
    torques = [i for i, channel in enumerate(channels) if channel.signal == "tau"]
    if parts < 2 or not torques or needs_engine(robot, effects):
        return change
    fine, rows = divided(commands, starts, parts)
    by_step = run(robot, effects, fine, rows, dt / parts, channels)[:, torques]
    by_step = by_step.reshape(len(commands.q), parts, -1)  # torque of the step before each
    first = by_step[:, 1]  # under the command of the row
    previous = np.roll(by_step[:, -1], 1, axis=0)
    before = 2.0 * by_step[:, 0] - previous
    total = np.roll(by_step[:, 1:], 1, axis=0).sum(axis=1) + by_step[:, 0]
    mean = (total + 0.5 * (before - np.roll(first, 1, axis=0))) / parts  # trapezoidal rule
    change[1:, torques] = np.stack([before - mean, first - before], axis=-1)[1:]
    return np.nan_to_num(change)


def _with_engine(
    robot: Robot,
    effects: list,
    inputs: CommandSequence,
    starts: Sequence[Start],
    dt: float,
    channels: Sequence[Channel],
) -> np.ndarray:
    rows = len(inputs.q)
    out = np.full((rows, len(channels)), np.nan)
    with _engine(robot, effects, dt) as sim:
        for start in starts or (Start(0, rows, robot.standing, None),):
            track = Track(robot, channels)
            if start.dq is None:
                sim.reset()
            else:
                sim.place(start.q, start.dq, start.base, tick=start.row, integral=start.integral)
            try:
                for state in sim.follow(inputs.rows(start.row, start.stop)):
                    track.add(state, sim)
            except DivergedError:
                pass
            out[start.row : start.stop] = track.matrix(start.stop - start.row)
    return out
