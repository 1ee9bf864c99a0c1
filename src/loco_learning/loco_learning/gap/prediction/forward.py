# SPDX-License-Identifier: Apache-2.0
"""Forward model: predictions of a model at the times at which a robot was measured.

    forward = Forward(model, records)
    residual = forward.measured[0] - forward([{"name": "coulomb_friction", "torque": 0.1}])[0]

The sensors of the model add no quantisation and no noise: noise in a prediction would be fitted.
"""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter
from loco_sim.bolted.loop import needs_engine
from loco_sim.effects import EFFECTS, from_list
from loco_sim.effects.base import Effect
from loco_sim.effects.identity import READ_AS
from loco_sim.effects.readings import Measuring, behind
from loco_sim.plant.model import Model
from loco_sim.robot.robot import Robot
from loco_sim.world.world import Setting

from ..recordings.clocks.params import TICKS
from ..recordings.clocks.stamps import Stamps
from ..recordings.record import Record, bridged
from ..statistics import noise
from . import nominal, odometry, running, windows
from .channels import SIGNALS, Channel, measured, of
from .odometry import Legs
from .running import Start

MAX_ROBOTS = 256  # size of the cache of robots
MAX_BYTES = 2**25  # size of the cache of predictions, at least one (taste)
REST_SPEED, AT_HOME = 0.3, 0.02  # speed [rad/s] and distance from standing [rad] of a robot at rest
MIN_FALL = 2e-4  # fall of a joint before its first sample [rad]
CLEARLY = 0.8  # ratio of squared errors below which one start is better than another (taste)
HELD_ROWS = 30  # rows whose measured torques tell what integrators hold at the first (taste)
SIGMAS = 5.0  # sensor deviations above which a joint of a fixed robot is not in its standing pose


@dataclass(frozen=True)
class ForwardParams(Params):
    """Settings of a run of a model along a record."""

    signals: tuple[str, ...] = parameter(SIGNALS, "signals that are compared", any_length=True)
    burn_in: float = parameter(
        0.2, "at the start of a record: what is not weighed, unless the robot stands and is told "
        "to move before that", "s", low=0.0, high=100.0
    )  # fmt: skip
    window: float = parameter(
        0.0, "length of pieces that each begin in the measured state; 0 runs whole records", "s",
        low=0.0, high=100.0,
    )  # fmt: skip
    ground: float = parameter(
        0.0, "the same on the ground, where no run follows a recording for long", "s",
        low=0.0, high=100.0,
    )  # fmt: skip
    most: int = parameter(20, "pieces of a record on the ground, as far apart as can be", low=1)
    settling: float = parameter(
        0.02, "at the start of each such piece: what is not weighed", "s", low=0.0, high=10.0
    )


class Forward:
    """Simulates a model with the recorded commands, under the conditions of each record.

    Attributes:
        how: Name of the compared signals, for messages.
        fine_steps: Whether steps finer than the model's improve the prediction.
        channels: Compared channels, in a fixed order.
        measured: Measured values per record, (T, C); NaN where not measured or not compared.
        records: The records.
        model: The model.
    """

    how, fine_steps = "motion", True

    def __init__(
        self,
        model: Model,
        records: Sequence[Record],
        params: ForwardParams | None = None,
        loaded: dict[Any, Robot] | None = None,
    ):
        """Prepare channels and initial states from the records.

        Args:
            model: Robot, overrides and effects; effects of a call are appended.
            records: Measured records.
            params: Settings of a simulation.
            loaded: Robots of the same file that others have loaded; new ones are added.

        Raises:
            ParameterError: The robot has no drives in its robot.yaml, or a record lacks a
                command.
        """
        self.model, self.records = model, tuple(records)
        self.params = params or ForwardParams()
        self._robots: dict[Any, Robot] = {} if loaded is None else loaded
        self._runs: OrderedDict[str, np.ndarray] = OrderedDict()
        self._said: dict[int, Legs | None] = {}
        robots = [self._robot(index, {}, 1.0) for index in range(len(self.records))]
        if not robots or not all(robot.drives for robot in robots):
            raise ParameterError(
                f"robot {model.robot!r} lists no drives in its robot.yaml, or there is no record"
            )
        both = list(zip(self.records, robots, strict=True))
        self._commands = [running.sequence(record, robot) for record, robot in both]
        self.channels: tuple[Channel, ...] = of(robots, self.records, self.params.signals)
        self._lengths = [
            self.params.window or (0.0 if robot.fixed_base else self.params.ground)
            for robot in robots
        ]
        self._starts = [
            with_integrals(
                *pair, commands, windows.segments(*pair, length) if length else start(*pair)
            )
            for pair, commands, length in zip(both, self._commands, self._lengths, strict=True)
        ]
        if not self.params.window:
            self._starts = [
                windows.select_evenly(starts, self.params.most) if length else starts
                for starts, length in zip(self._starts, self._lengths, strict=True)
            ]
        self.measured = [
            self._weighed(index, measured(robot, self.channels, self.records[index]))
            for index, robot in enumerate(robots)
        ]
        self._stamps = [self._stamped(index) for index in range(len(robots))]
        if any(np.any(s.integral) for starts in self._starts for s in starts):
            self._starts = self._switched_on()

    def _switched_on(self) -> list[list[Start]]:
        """Initial states, with integrators that begin at 0 in records that clearly fit better so.

        Drives are switched on there, and the acceleration just after that is hardly known.
        """
        given, empty = copy(self), copy(self)  # predictions of `self` are kept: none yet
        each = zip(self.records, self._commands, self._starts, strict=True)
        empty._starts = [
            with_integrals(record, self.robot(i), commands, starts, loaded=False)
            for i, (record, commands, starts) in enumerate(each)
        ]
        result = []
        runs = zip(given(), empty(), self.measured, self._starts, empty._starts, strict=True)
        for loaded, unloaded, target, *states in runs:
            rows = np.isfinite(target) & np.isfinite(loaded)
            first, second = (np.sum(np.where(rows, p - target, 0.0) ** 2, axis=0)
                             for p in (loaded, unloaded))  # fmt: skip
            n_clear = np.sum(second < CLEARLY * first)
            result.append(states[int(n_clear > 0.5 * np.sum(rows.any(axis=0)))])
        return result

    def _weighed(self, index: int, values: np.ndarray) -> np.ndarray:
        params, dt, window = self.params, self.records[index].dt, self._lengths[index]
        first = round(params.burn_in / dt) if not window else round(params.settling / dt)
        within = np.zeros(len(values), dtype=bool)
        for segment in self._starts[index]:
            within[segment.row + max(1, first) : segment.stop] = True
        if self._starts[index] or window:  # no prediction outside of the pieces
            values[~within] = np.nan
        if not self._starts[index] and self.robot(index).fixed_base:
            values[: min(first, rest_length(self._commands[index]))] = np.nan
        return values

    def shown(self, hypotheses: Sequence[Any]) -> list[Any]:
        """Hypotheses whose effects change the compared signals."""
        return list(hypotheses)

    def given(self, overrides: Mapping[str, Any] | None = None) -> Robot:
        """The robot of the first record, from its files and overrides."""
        return self._robot(0, nominal.split_drives(overrides or {})[0], 1.0)

    def robot(self, index: int = 0) -> Robot:
        """The robot of a record, from the files and overrides of the model and of the record."""
        return self._robot(index, {}, 1.0)

    def _robot(self, index: int, overrides: Mapping[str, Any], step: float) -> Robot:
        """The robot of a record, with sensors that add no quantisation and no noise."""
        record = self.records[index]
        every = {**self.model.overrides, **record.overrides, **overrides}
        values = json.dumps(every, sort_keys=True, default=repr)
        key = values, running.period(record), step, record.joint_torque
        if key not in self._robots:
            if len(self._robots) >= MAX_ROBOTS:
                self._robots.clear()
            self._robots[key] = _robot(self.model, record, overrides, step)
        return self._robots[key]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_robots": {}, "_runs": OrderedDict()}

    def __copy__(self) -> Forward:
        """Copy to which other initial states may be given: same robots, no predictions yet."""
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__, _runs=OrderedDict())
        return other

    def __call__(
        self,
        effects: Sequence[Mapping[str, Any]] = (),
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        step: float = 1.0,
    ) -> list[np.ndarray]:
        """Simulate the model.

        Args:
            effects: Effects in addition to those of the model.
            overrides: Values of the robot, over those of the model and of the records; includes
                scale errors of drives, see `nominal.parted`.
            only: Indices of records; None is all.
            step: Ratio of the physics step to the model's, e.g. 0.5 halves it; 1 or the inverse of
                a whole number.

        Returns:
            Ideal sensor readings per record, (T, C), read-only; NaN from the time at which the
            model diverges.

        Raises:
            LocoError: An effect or an override is invalid.
        """
        rows = range(len(self.records)) if only is None else only
        overrides, drives = nominal.split_drives(overrides or {})
        late = [e for e in effects if _late(e)]
        effects = nominal.built([e for e in effects if not _late(e)], drives)
        lag = self._lag(late)
        moved = self._ahead(late)
        predictions = [moved._cached(i, effects, overrides, step) for i in rows]
        for by in np.unique(lag[lag != 0.0]):
            predictions = [
                np.where(lag == by, shifted(p, by / self.records[i].dt), p)
                for i, p in zip(rows, predictions, strict=True)
            ]
        return predictions

    def _ahead(self, late: Sequence[Mapping[str, Any]]) -> Forward:
        """Copy whose fixed-base robots start in the true state, ahead of the late reading."""
        times = [
            spec[EFFECTS[spec["name"]].identity.late]
            for spec in late
            if spec.get("channel", "all") in ("all", "q")
        ]
        if not any(times):
            return self
        other, by = copy(self), sum(times)
        other._starts = [
            starts if self.on_ground(i) else [s._replace(q=s.q + by * s.dq) for s in starts]
            for i, starts in enumerate(self._starts)
        ]
        return other

    def _lag(self, late: Sequence[Mapping[str, Any]]) -> np.ndarray:
        """Delay of each channel [s], (C,)."""
        named = np.array([READ_AS.get(c.signal, c.signal) for c in self.channels])
        times = np.zeros(len(named))
        for spec in late:
            which = spec.get("channel", "all")
            times[(named == which) | (which == "all")] += spec[EFFECTS[spec["name"]].identity.late]
        return times

    def reading_times(
        self,
        effects: Sequence[Mapping[str, Any]],
        overrides: Mapping[str, Any],
        delay: float,
        delays: Sequence[float] = (),
    ) -> list[np.ndarray]:
        """Changes of predictions by the times of readings and drives, (T, C, 4) per record.

        By readings that are late by `delay` [s], or by their own `delays` of each record, by
        drives that act later by `delay`, and, unless a
        simulation of loco was recorded, by torques of an instant, before and after the command of
        their row (`running.instants`).
        """
        values, drives = nominal.split_drives(overrides)
        specs = nominal.built([e for e in effects if not _late(e)], drives)
        step = 1.0 / self.robot(0).sim.physics_rate  # delays are whole steps
        later = self([*effects, {"name": "actuation_delay", "delay": step}], overrides)
        changes = []
        for i, predicted in enumerate(self(effects, overrides)):
            record, robot = self.records[i], self._robot(i, values, 1.0)
            change = np.zeros((*predicted.shape, 4))
            late = delays[i] if delays else delay
            change[..., 0] = shifted(predicted, late / record.dt) - predicted
            change[..., 1] = (later[i] - predicted) * delay / step
            if not record.simulated:
                chain, dt = from_list([*self.model.effects, *specs]), running.period(record)
                starts = true_starts(record, robot, chain, self._starts[i])
                if running.steps_in(dt, robot.sim.physics_rate) < 2:  # none within a row
                    robot = self._robot(i, values, 0.5)
                run = robot, chain, self._commands[i], starts, dt, self.channels
                change[..., 2:] = running.instants(*run)
            changes.append(np.nan_to_num(change))
        return changes

    def recommanded(self) -> Forward:
        """The same with commands that are off by their estimated error (`Record.unsure`)."""
        other, commands = copy(self), []
        for i, record in enumerate(self.records):
            command = {k: v + record.unsure.get(k, 0.0) for k, v in record.command.items()}
            commands.append(running.sequence(replace(record, command=command), self.robot(i)))
        other._commands = commands
        return other

    def nudged(self, speed: float) -> Forward:
        """Copy whose driven joints start faster by `speed` [rad/s or m/s]."""
        other = copy(self)
        other._starts = [
            _shift_speed(record, self.robot(i), starts, speed)
            for i, (record, starts) in enumerate(zip(self.records, self._starts, strict=True))
        ]
        return other

    def doubtful(self) -> list[np.ndarray]:
        """Standard deviation of each initial state, (2n + m,).

        Joint positions, then velocities, then torques of the m integrators of drives. Of a record
        that is divided into pieces, whose states are measured, only the torques deviate. Empty for
        pieces without integrators or on the ground, and for a robot at rest without an integrator.
        """
        result = []
        for i, (record, starts) in enumerate(zip(self.records, self._starts, strict=True)):
            robot, pieces = self.robot(i), bool(self._lengths[i])
            limits = running.integral_limits(robot)
            unknown = starts and (not pieces or robot.fixed_base and limits.any())
            first = [(1 - pieces) * std for std in windows.first_doubt(record, robot)]
            result.append(np.concatenate([*first, limits[limits > 0.0]] if unknown else [[]]))
        return result

    def begun_at(self, by: Sequence[np.ndarray]) -> Forward:
        """Copy with initial states changed by `by`, as in `doubtful`; empty for no change."""
        other = copy(self)
        other._starts = [
            [_moved(s, d, self.robot(i)) for s in starts] if len(d) else starts
            for i, (starts, d) in enumerate(zip(self._starts, by, strict=True))
        ]
        return other

    @property
    def starts(self) -> list[list[Start]]:
        """Pieces of each record; empty for a whole record that starts at rest in standing."""
        return self._starts

    def legs(self, index: int) -> Legs | None:
        """Estimates of the base motion from IMU and legs in a record, with the initial robot."""
        if index not in self._said:
            record, robot = self.records[index], self.robot(index)
            needs_estimate = not record.has("base_position")
            states = windows.joint_states(record, robot)
            self._said[index] = odometry.legs(record, robot, *states) if needs_estimate else None
        return self._said[index]

    def on_ground(self, index: int) -> bool:
        """True if a record is compared in pieces because its robot stands on its feet."""
        return bool(self._lengths[index]) and not self.robot(index).fixed_base

    @property
    def grounded(self) -> bool:
        """True if any record is on the ground."""
        return any(self.on_ground(i) for i in range(len(self.records)))

    @property
    def in_pieces(self) -> bool:
        """True if any record is compared in pieces that start in the measured state."""
        return any(self._lengths)

    def drives(self) -> tuple[np.ndarray, np.ndarray]:
        """Torques of the drives and speeds of the joints in the model, (R, n) each.

        Torques are infinite where they are not those of the motor, which drives a rotor first.
        """
        robot = self.robot()
        channels = [Channel(s, j, "") for s in ("tau", "q", "dq") for j in robot.joints]
        tau, q, dq = np.split(np.concatenate(self.with_channels(channels)()), 3, axis=1)
        rotors = [getattr(robot.drives.get(j), "rotor_inertia", 0.0) for j in robot.joints]
        return np.where(np.greater(rotors, 0.0), np.inf, np.nan_to_num(tau)), np.nan_to_num(dq)

    def with_channels(self, channels: Sequence[Channel], joint_torque: bool = False) -> Forward:
        """Copy that predicts other channels, at the times of the rows.

        Torques are those of the drives alone, or of all that acts in a joint if `joint_torque`.
        """
        other = copy(self)
        other.records = tuple(replace(r, joint_torque=joint_torque) for r in self.records)
        other.channels, other._stamps = tuple(channels), [{} for _ in self.records]
        return other

    def persistence(self) -> list[np.ndarray]:
        """Persistence forecasts: each signal keeps its first value in a piece, (T, C) per record.

        NaN where nothing was measured before.
        """
        predictions = []
        for values, starts in zip(self.measured, self._starts, strict=True):
            initial = np.full(values.shape, np.nan)
            for begin, end in [(s.row, s.stop) for s in starts] or [(0, None)]:
                piece = values[begin:end]
                first = np.argmax(np.isfinite(piece), axis=0)
                initial[begin:end] = piece[first, np.arange(piece.shape[1])]
            predictions.append(initial)
        return predictions

    def begun(self) -> list[list[int]]:
        """Rows at which each record restarts from a measured state, without the first.

        Empty on the ground: errors of the base estimate are correlated within a record.
        """
        return [
            [] if self.on_ground(i) else [s.row for s in starts[1:]]
            for i, starts in enumerate(self._starts)
        ]

    def fewer(self, max_segments: int) -> Forward:
        """Copy with at most `max_segments` pieces of a record on the ground; other rows are NaN."""
        other = copy(self)
        other._starts = [
            windows.select_evenly(starts, max_segments) if self.on_ground(i) else starts
            for i, starts in enumerate(self._starts)
        ]
        other.measured = [other._weighed(i, m.copy()) for i, m in enumerate(self.measured)]
        return other

    def shaken(self, count: int) -> list[Forward]:
        """Copies of the forward model, with initial states drawn from their uncertainty."""
        state_std = [
            windows.state_std(record, self.robot(i)) if self._lengths[i] else None
            for i, record in enumerate(self.records)
        ]
        copies = []
        for seed in range(count):
            other, rng = copy(self), np.random.default_rng([seed, len(self.records)])
            other._starts = [
                windows.perturb(starts, std, rng) if std else starts
                for starts, std in zip(self._starts, state_std, strict=True)
            ]
            copies.append(other)
        return copies

    def _cached(self, index: int, effects: Any, overrides: Mapping, step: float) -> np.ndarray:
        """Result of `_run`; a search asks for many models more than once."""
        key = json.dumps((index, effects, overrides, step))
        if key in self._runs:
            self._runs.move_to_end(key)
            return self._runs[key]
        run = self._runs[key] = self._run(index, effects, overrides, step)
        run.flags.writeable = False
        while len(self._runs) > max(1, MAX_BYTES // max(1, run.nbytes)):
            self._runs.popitem(last=False)
        return run

    def _run(self, index: int, effects: Any, overrides: Mapping, step: float) -> np.ndarray:
        robot, record = self._robot(index, overrides, step), self.records[index]
        effects, dt = from_list([*self.model.effects, *effects]), running.period(record)
        starts = self._starts[index]
        if overrides:
            starts = reloaded(record, (self.robot(index), robot), self._commands[index], starts)
        starts = true_starts(record, robot, effects, starts)
        if self.on_ground(index):
            starts = windows.adjust_starts(robot, effects, starts, self.legs(index))
        commands, stamps = self._commands[index], self._stamps[index]
        if not stamps:
            return running.run(robot, effects, commands, starts, dt, self.channels)
        parts = running.steps_in(dt, step * robot.sim.physics_rate)
        fine, starts_of_steps = running.divided(commands, starts, parts)
        steps = running.run(robot, effects, fine, starts_of_steps, dt / parts, self.channels)
        predicted = steps[::parts].copy()
        if not {channel.signal for channel in self.channels} <= {*TICKS.smooth}:
            predicted = running.run(robot, effects, commands, starts, dt, self.channels)
        for column, each in stamps.items():
            predicted[each.rows, column] = each.read(steps[:, column], parts)
        return predicted

    def _stamped(self, index: int) -> dict[int, Stamps]:
        """Time stamps of the readings of channels that were moved, by column.

        Empty where runs are of the engine, start anew in pieces, or have sensors with a clock.
        """
        record, robot = self.records[index], self.robot(index)
        parts = running.steps_in(record.dt, robot.sim.physics_rate)
        if parts < 2 or self._lengths[index] or robot.sensors or needs_engine(robot):
            return {}
        stamps = {}
        for column, channel in enumerate(self.channels):
            if channel.signal in record.moved:
                joint = record.joints.index(channel.name)
                moved = record.moved[channel.signal][:, joint] / record.dt
                read = record.read_of(robot, channel.signal)[:, robot.joints.index(channel.name)]
                stamps[column] = Stamps.of(read, moved)
        return stamps

    @cached_property
    def numeric(self) -> np.ndarray:
        """Numerical error of the model: its rms change when the physics step is halved, (C,)."""
        square = np.zeros(len(self.channels))
        count = np.zeros(len(self.channels))
        for coarse, fine, target in zip(self(), self(step=0.5), self.measured, strict=True):
            error = np.where(np.isfinite(target), coarse - fine, np.nan)
            square += np.nansum(error**2, axis=0)
            count += np.sum(np.isfinite(error), axis=0)
        return np.sqrt(square / np.maximum(count, 1.0))


def _robot(model: Model, record: Record, overrides: Mapping[str, Any], step: float) -> Robot:
    robot = model.make_robot({**record.overrides, **overrides})
    if robot.sensors:
        robot = replace(robot, sensors=robot.sensors.replace(exact=True))
    sim = robot.sim
    period = running.period(record)
    rate = running.steps_in(period, sim.physics_rate) / (period * step)
    limit = sim.damping_limit * step  # so that substeps are divided as well
    sim = sim.replace(physics_rate=rate, damping_limit=limit)
    return replace(robot, sim=sim, motor_torque=not record.joint_torque)


def start(record: Record, robot: Robot) -> list[Start]:
    """Initial states of the model; empty if the robot stands at rest in its standing pose.

    Joints that were not measured have their standing position.
    """
    q, standing = record.joints_of(robot, "q"), robot.standing
    at, speed, _ = windows.first_state(record, robot)
    valid = np.isfinite(q).any(axis=0) & np.isfinite(at)
    if not valid.any():
        return []
    speeds = record.joints_of(robot, "dq")[0]  # 0 for a robot that starts to move at this sample
    is_slow = np.abs(np.where(np.isfinite(speeds), speeds, speed)) < REST_SPEED
    is_near = np.abs(bridged(q)[0] - standing) < _home(record, robot, q) + 2.0 * record.step("q")
    if np.all((is_slow & is_near) | ~valid):
        return []
    moving = np.where(valid, at, standing), np.where(valid, speed, 0.0)
    return [Start(0, len(record.t), *moving)]


def with_integrals(
    record: Record,
    robot: Robot,
    commands: running.CommandSequence,
    starts: list[Start],
    loaded: bool = True,
) -> list[Start]:
    """Initial states with integrators of drives, and friction, as the measured motion needs them.

    At the first sample integrators are as the measured torques of drives say, or else inverse
    dynamics, if `loaded`, else 0; where later pieces begin, as the drives on the measured motion
    have changed them since. Friction that springs back holds what drives and springs of a whole
    record do not give (`Start.needed`).
    """
    integrates = running.integral_limits(robot).any()
    complete = bool(starts) and (starts[0].row, starts[0].stop) == (0, len(record.t))
    if not integrates and not (complete and robot.fixed_base):
        return starts
    dt, state = running.period(record), windows.first_state(record, robot)
    needed, first = running.loads(robot, commands, dt, state)
    wound = np.full(len(first), loaded and integrates)
    is_measured = ~wound
    if wound.any():
        first, is_measured = _held(record, robot, commands, first)
    first = np.where(wound, first, 0.0)
    flags = {"wound": wound, "measured": is_measured}
    if complete or not starts:
        initial = starts[0] if complete and not integrates else Start(0, len(record.t), *state[:2])
        loaded_start = initial._replace(integral=first, needed=needed, **flags)
        return [loaded_start] if robot.fixed_base else starts
    motion = np.stack([bridged(each) for each in windows.joint_states(record, robot)])
    along, _ = running.along(robot, commands, dt, motion, first)
    return [s._replace(integral=along[s.row], **flags) for s in starts]


def reloaded(
    record: Record,
    robots: tuple[Robot, Robot],
    commands: running.CommandSequence,
    starts: list[Start],
) -> list[Start]:
    """Initial states of one robot, with the torques that another one needs to begin alike.

    A robot with another mass holds another weight, and its integrators have wound up to it.
    """
    if not any(np.isfinite(s.needed).any() or np.any(s.wound) for s in starts):
        return starts
    dt = running.period(record)
    loads = [
        running.loads(robot, commands, dt, windows.first_state(record, robot)) for robot in robots
    ]
    needed, integral = np.diff(loads, axis=0)[0]
    return [
        s._replace(
            integral=s.integral + np.where(s.wound & ~s.measured, integral, 0.0),
            needed=s.needed + needed,
        )
        for s in starts
    ]


def _held(
    record: Record, robot: Robot, commands: running.CommandSequence, first: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Torques of integrators at the first sample, (n,), and flags of those that were measured.

    Measured torques of drives are true whatever acts beside them, of which inverse dynamics knows
    nothing.

    Args:
        record: Record of the robot.
        robot: The robot.
        commands: Commands to the robot in each row.
        first: Torques by inverse dynamics, (n,), for joints whose torque was not measured.
    """
    if record.joint_torque or not record.has("tau"):
        return first, np.zeros(len(first), dtype=bool)
    limit, dt = running.integral_limits(robot), running.period(record)
    motion = np.stack([bridged(each) for each in windows.joint_states(record, robot)])
    _, torque = running.along(robot, commands, dt, motion[:, :HELD_ROWS], first)
    error = record.read_of(robot, "tau")[1 : HELD_ROWS + 1] - torque[: len(record.t) - 1]
    measured = np.isfinite(error).any(axis=0)
    rows = np.where(measured, error, 0.0)
    return np.clip(first + np.nanmedian(rows, axis=0), -limit, limit), measured


def _home(record: Record, robot: Robot, q: np.ndarray) -> np.ndarray:
    """Distance from the standing pose within which a joint is considered to be in it, (n,).

    The tolerance of a fixed-base robot is that of its sensors: a leg that has sagged a little under
    its weight is not in the pose, and a model that starts in the pose would have to sag first.
    """
    if not robot.fixed_base:
        return np.full(q.shape[1], AT_HOME)
    columns = zip(record.read_of(robot, "q").T, robot.joints, strict=True)
    read = [noise.white([column], record.step_of("q", joint)) for column, joint in columns]
    return MIN_FALL + SIGMAS * np.array(read)


def rest_length(inputs: running.CommandSequence) -> int:
    """Number of rows before the command changes.

    A fixed-base robot at rest is in equilibrium with its loads; a model to which the same loads
    are first applied at this time is not.
    """
    rows = np.hstack([inputs.q, inputs.dq, inputs.tau, inputs.stance])
    moved = np.any(rows != rows[0], axis=1)
    return int(np.argmax(moved)) - 1 if moved.any() else len(rows)


def true_starts(
    record: Record, robot: Robot, effects: Sequence[Effect], starts: list[Start]
) -> list[Start]:
    """Initial states with true joint positions, where effects of the model falsify the reading.

    A robot whose joints are mounted with a twist stands in another pose than commanded, namely in
    the one that its sensors measure.

    Args:
        record: Record of the robot.
        robot: The robot.
        effects: Effects of the model.
        starts: Measured initial states; empty for a robot that stands at rest.
    """
    wrong = [e for e in effects if isinstance(e, Measuring) and e.by_itself and _acts_on_all(e)]
    patterns = [e.joint or "*" for e in wrong if e.identity.turned]
    if patterns and not starts:
        q = record.joints_of(robot, "q")[0]
        driven = np.isin(np.arange(len(q)), robot.driven)
        named = [any(fnmatchcase(joint, p) for p in patterns) for joint in robot.joints]
        starts = _rest_start(record, np.where(np.isfinite(q) & driven & named, q, robot.standing))
    if not wrong or not starts:
        return starts
    for effect in wrong:
        effect.configure(Setting(robot, robot.sim, running.period(record)))
        effect.reset(np.random.default_rng(0))
    states = [behind(wrong, s.q, s.dq, len(robot.feet)) for s in starts]
    return [s._replace(q=q, dq=dq) for s, (q, dq) in zip(starts, states, strict=True)]


def _acts_on_all(effect: Effect) -> bool:
    """True if the effect acts from start to end."""
    return not effect.absent() and effect.start == 0.0 and np.isinf(effect.stop)


def _shift_speed(record: Record, robot: Robot, starts: list[Start], speed: float) -> list[Start]:
    change = np.zeros(len(robot.joints))
    change[robot.driven] = speed
    starts = starts or _rest_start(record, robot.standing)
    return [segment._replace(dq=segment.dq + change) for segment in starts]


def _moved(begin: Start, by: np.ndarray, robot: Robot) -> Start:
    """An initial state changed by `by`, in the order of `Forward.doubtful`."""
    q, dq, torques = np.split(by, [len(begin.q), 2 * len(begin.q)])
    integral = np.zeros(len(q))
    if len(torques):
        integral[running.integral_limits(robot) > 0.0] = torques
    return begin._replace(q=begin.q + q, dq=begin.dq + dq, integral=begin.integral + integral)


def _rest_start(record: Record, q: np.ndarray) -> list[Start]:
    """Start of a whole record at rest with joint positions `q`."""
    return [Start(0, len(record.t), q, np.zeros(len(q)))]


def _late(spec: Mapping[str, Any]) -> bool:
    """True for a constant sensor delay, which is applied by a time shift of the prediction."""
    late = EFFECTS[spec["name"]].identity.late
    return bool(late) and {*spec} <= {"name", late, "channel"}


def shifted(values: np.ndarray, samples: float) -> np.ndarray:
    """Rows evaluated `samples` earlier, by cubic interpolation; ends are held."""
    from scipy.ndimage import shift as moved

    out = moved(bridged(values), (samples, 0.0), order=3, mode="nearest")
    return np.where(np.isfinite(values), out, np.nan)
