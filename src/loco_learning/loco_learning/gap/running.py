# SPDX-License-Identifier: Apache-2.0
"""One run of a model along a record: without the engine where that is possible."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from loco_control.exceptions import DivergedError, ParameterError
from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import effects as sim_effects
from loco_sim.bolted import Bolted, Pieces, needs_engine
from loco_sim.robot import Robot
from loco_sim.servo import ServoParams, TorqueDrive
from loco_sim.simulation import Simulation
from loco_sim.world import Base

from .channels import Channel, Track, assembled
from .record import Record

NOISE = ("sensor_noise",)  # effects that a prediction leaves out


class Orders(NamedTuple):
    """What a robot is told, in the order of its joints."""

    q: np.ndarray  # positions wanted [rad or m], (T, n)
    dq: np.ndarray  # velocities wanted, (T, n)
    tau: np.ndarray  # torques wanted [N·m or N], (T, n)
    power: np.ndarray | None  # supply and switch of the drives, (T, 2); None is on
    ramps: tuple[bool, bool, bool]  # positions, velocities, torques go straight between rows


class Start(NamedTuple):
    """State in which a piece of a record begins."""

    row: int  # first row
    stop: int  # row after the last
    q: np.ndarray  # joint positions [rad or m], (n,)
    dq: np.ndarray  # joint velocities, (n,)
    base: Base | None = None  # None is that of a reset


def period(record: Record) -> float:
    """Time between samples [s]; stamps are rounded, rates are not."""
    return 1.0 / round(1.0 / record.dt, 3)


def steps_in(dt: float, rate: float) -> int:
    """Physics steps in a control period, at least as many as a rate [Hz] asks for."""
    return max(1, math.ceil(dt * rate - 0.01))  # a rounded rate asks for no step more


def orders(record: Record, robot: Robot) -> Orders:
    """Commands of a record.

    Raises:
        ParameterError: The record lacks the kind of command that a drive needs, or one is
            not a number.
    """
    driven = robot.driven
    drives = [robot.drives[robot.joints[i]] for i in driven]
    torque = np.array([isinstance(drive, TorqueDrive) for drive in drives], dtype=bool)
    made = {kind: np.zeros((len(record.t), len(robot.joints))) for kind in ("q", "dq", "tau")}
    needed = {"position": ~torque, "torque": torque}
    for key, kind, mine in (("q", "position", ~torque), ("dq", "velocity", ~torque),
                            ("tau", "torque", torque | ~_servos(drives))):  # fmt: skip
        wanted = kind in needed and needed[kind].any()
        if mine.any() and (wanted or kind in record.command):
            made[key][:, driven[mine]] = record.command_of(robot, kind)[:, mine]
    if not all(np.all(np.isfinite(values)) for values in made.values()):
        raise ParameterError(f"{record.name}: a command is not finite")
    power = None
    if record.inputs:
        ones = np.ones(len(record.t))
        power = np.stack([record.inputs.get(k, ones) for k in ("supply", "enable")], axis=1)
    ramps = tuple(kind in record.ramps for kind in ("position", "velocity", "torque"))
    return Orders(made["q"], made["dq"], made["tau"], power, ramps)


def _servos(drives: Sequence[Any]) -> np.ndarray:
    """Drives that take no torque besides a position, (m,) bool."""
    return np.array([isinstance(drive, ServoParams) for drive in drives], dtype=bool)


def run(
    robot: Robot,
    specs: Sequence[Mapping[str, Any]],
    told: Orders,
    starts: Sequence[Start],
    dt: float,
    channels: Sequence[Channel],
) -> np.ndarray:
    """What a robot says, (T, C); NaN where no piece is, and from where it diverges.

    Args:
        robot: The robot.
        specs: Its effects.
        told: Commands.
        starts: Pieces; none at all is the whole record, from standing at rest.
        dt: Time between rows [s].
        channels: Columns of the result.

    Raises:
        LocoError: An effect is not possible.
    """
    made = sim_effects.from_list([e for e in specs if e.get("name") not in NOISE])
    if needs_engine(robot, made):
        return _with_engine(robot, made, told, starts, dt, channels)
    pieces = None
    if starts:
        rows = np.array([[s.row, s.stop] for s in starts])
        pieces = Pieces(rows, np.array([[s.q, s.dq] for s in starts], dtype=float))
    plant = Bolted(robot, made, 0, dt)
    with np.errstate(over="ignore", invalid="ignore"):
        found = plant.run(*told[:3], None, told.power, pieces, told.ramps)
    return assembled(robot, channels, found._asdict(), len(told.q))


def _with_engine(
    robot: Robot,
    effects: list,
    told: Orders,
    starts: Sequence[Start],
    dt: float,
    channels: Sequence[Channel],
) -> np.ndarray:
    rows, told = len(told.q), _between(told)
    out = np.full((rows, len(channels)), np.nan)
    with Simulation(None, None, effects, 0, dt, robot) as sim:
        for start in starts or (Start(0, rows, robot.standing, None),):
            track = Track(robot, channels)
            try:
                _follow(sim, told, start, track)
            except DivergedError:
                pass
            out[start.row : start.stop] = track.matrix(start.stop - start.row)
    return out


def _between(told: Orders) -> Orders:
    """Commands that are held, in place of those that go straight between rows."""
    held = [
        0.5 * (values + np.concatenate([values[1:], values[-1:]])) if ramp else values
        for values, ramp in zip(told[:3], told.ramps, strict=True)
    ]
    return told._replace(q=held[0], dq=held[1], tau=held[2])


def _follow(sim: Simulation, told: Orders, start: Start, track: Track) -> None:
    """Run one piece, telling `track` what the sensors say before each command."""
    stance, still = np.ones(len(sim.robot.feet), dtype=bool), np.zeros(6)
    state = sim.reset() if start.dq is None else sim.place(start.q, start.dq, start.base)
    for row in range(start.row, start.stop):
        tick, t = state.tick, state.t
        track.add(state, sim)
        if told.power is not None:
            sim.power(*told.power[row])
        command = MotionCommand(tick, t, told.q[row], told.dq[row])
        state = sim.step(command, TrunkTorque(tick, t, told.tau[row], still, stance))
