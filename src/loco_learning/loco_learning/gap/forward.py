# SPDX-License-Identifier: Apache-2.0
"""What a model says where a robot was measured.

    forward = Forward(model, records)
    residual = forward.measured[0] - forward([{"name": "coulomb_friction", "torque": 0.1}])[0]

The sensors of the model neither round nor rustle: noise in a prediction would be fitted.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from functools import cached_property
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter
from loco_sim.model import Model
from loco_sim.robot import Robot

from . import running, windows
from .channels import SENSORS, SIGNALS, Channel, measured, of
from .record import Record
from .running import Start

KEPT = 256  # robots that are remembered
STILL, NEAR = 0.3, 0.02  # a robot slower [rad/s] and nearer to its standing pose stands [rad]


@dataclass(frozen=True)
class ForwardParams(Params):
    """How a model is run along a record."""

    signals: tuple[str, ...] = parameter(SIGNALS, "signals that are compared", any_length=True)
    burn_in: float = parameter(
        0.2, "at the start of a record: what is not weighed, unless the robot stands and is told "
        "to move before that", "s", low=0.0, high=100.0
    )  # fmt: skip
    window: float = parameter(
        0.0, "length of pieces that each begin in the measured state; 0 runs whole records", "s",
        low=0.0, high=100.0,
    )  # fmt: skip
    settling: float = parameter(
        0.02, "at the start of each such piece: what is not weighed", "s", low=0.0, high=10.0
    )


class Forward:
    """Runs a model with the commands of records, as the robot was run.

    Attributes:
        channels: What is compared, in a fixed order.
        measured: Per record what was measured, (T, C); NaN where it was not or does not count.
        records: The records.
        model: The model.
    """

    def __init__(
        self, model: Model, records: Sequence[Record], params: ForwardParams | None = None
    ):
        """Look at the records; nothing is run.

        Args:
            model: Robot, overrides and effects; effects of a call come after them.
            records: What was measured.
            params: How the model is run.

        Raises:
            ParameterError: The robot has no drives in its robot.yaml, or a record lacks a
                command.
        """
        self.model, self.records = model, tuple(records)
        self.params = params or ForwardParams()
        self._robots: dict[Any, Robot] = {}
        robots = [self._robot(index, {}, 1.0) for index in range(len(self.records))]
        if not robots or not all(robot.drives for robot in robots):
            raise ParameterError(
                f"robot {model.robot!r} lists no drives in its robot.yaml, or there is no record"
            )
        both = list(zip(self.records, robots, strict=True))
        self._told = [running.orders(record, robot) for record, robot in both]
        self.channels: tuple[Channel, ...] = of(robots, self.records, self.params.signals)
        length = self.params.window
        self._starts = [
            windows.pieces(record, robot, length) if length else start(record, robot)
            for record, robot in both
        ]
        self.measured = [
            self._weighed(index, measured(robot, self.channels, self.records[index]))
            for index, robot in enumerate(robots)
        ]

    def _weighed(self, index: int, values: np.ndarray) -> np.ndarray:
        params, dt = self.params, self.records[index].dt
        first = round(params.burn_in / dt) if not params.window else round(params.settling / dt)
        for piece in self._starts[index]:
            values[piece.row : piece.row + max(1, first)] = np.nan
        if not self._starts[index] and self.robot(index).fixed_base:
            values[: min(first, idle(self._told[index]))] = np.nan
        return values

    def robot(self, index: int = 0) -> Robot:
        """The robot of a record, as the model has it."""
        return self._robot(index, {}, 1.0)

    def _robot(self, index: int, overrides: Mapping[str, Any], step: float) -> Robot:
        """The robot of a record, with sensors that tell what they can."""
        key = index, json.dumps(overrides, sort_keys=True), step
        if key not in self._robots:
            if len(self._robots) >= KEPT:
                self._robots.clear()
            self._robots[key] = _robot(self.model, self.records[index], overrides, step)
        return self._robots[key]

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_robots": {}}

    def __call__(
        self,
        effects: Sequence[Mapping[str, Any]] = (),
        overrides: Mapping[str, Any] | None = None,
        only: Sequence[int] | None = None,
        step: float = 1.0,
        shift: float = 0.0,
    ) -> list[np.ndarray]:
        """Run the model.

        Args:
            effects: Added to those of the model.
            overrides: Values of robot.yaml, over those of the model and of the records.
            only: Indices of records; None is all.
            step: Physics step over the model's, 0.5 halves it; its inverse is a whole number
                or it is one itself.
            shift: By how much the clock of the measurements is ahead of that of the
                commands: the prediction is read that much earlier [s].

        Returns:
            Per record what the sensors would have said, (T, C); NaN from where the model
            diverges.

        Raises:
            LocoError: An effect or an override is not possible.
        """
        rows = range(len(self.records)) if only is None else only
        late = [e for e in effects if _late(e)]
        effects = [e for e in effects if not _late(e)]
        found = [self._run(i, effects, overrides or {}, step) for i in rows]
        behind = self._behind(late, shift)
        for by in np.unique(behind[behind != 0.0]):
            found = [
                np.where(behind == by, shifted(p, by / self.records[i].dt), p)
                for i, p in zip(rows, found, strict=True)
            ]
        return found

    def _behind(self, late: Sequence[Mapping[str, Any]], shift: float) -> np.ndarray:
        """How late each channel is [s], (C,)."""
        named = np.array([SENSORS.get(c.signal, c.signal) for c in self.channels])
        times = np.full(len(named), shift)
        for spec in late:
            which = spec.get("channel", "all")
            times[(named == which) | (which == "all")] += spec["delay"]
        return times

    def nudged(self, speed: float) -> Forward:
        """The same, with driven joints that begin faster by so much [rad/s or m/s]."""
        other = copy(self)
        other._starts = [
            _nudged(record, self.robot(i), starts, speed)
            for i, (record, starts) in enumerate(zip(self.records, self._starts, strict=True))
        ]
        return other

    def _run(self, index: int, effects: Any, overrides: Mapping, step: float) -> np.ndarray:
        robot, specs = self._robot(index, overrides, step), (*self.model.effects, *effects)
        starts, dt = self._starts[index], running.period(self.records[index])
        starts = turned(self.records[index], robot, specs, starts)
        return running.run(robot, specs, self._told[index], starts, dt, self.channels)

    @cached_property
    def numeric(self) -> np.ndarray:
        """Numerical error of the model itself: its change when the physics step is halved, (C,)."""
        square = np.zeros(len(self.channels))
        count = np.zeros(len(self.channels))
        for coarse, fine, wanted in zip(self(), self(step=0.5), self.measured, strict=True):
            error = np.where(np.isfinite(wanted), coarse - fine, np.nan)
            square += np.nansum(error**2, axis=0)
            count += np.sum(np.isfinite(error), axis=0)
        return np.sqrt(square / np.maximum(count, 1.0))


def _robot(model: Model, record: Record, overrides: Mapping[str, Any], step: float) -> Robot:
    robot = Model(model.robot, {**model.overrides, **record.overrides, **overrides}).make_robot()
    if robot.sensors:
        robot = replace(robot, sensors=robot.sensors.replace(exact=True))
    sim = robot.sim
    rate = running.steps_in(record.dt, sim.physics_rate) / (running.period(record) * step)
    limit = sim.damping_limit * step  # so that sub-stepping is divided as well
    return replace(robot, sim=sim.replace(physics_rate=rate, damping_limit=limit))


def start(record: Record, robot: Robot) -> list[Start]:
    """Where the model starts; empty if the robot stands still in its standing pose.

    Joints that were not measured have the position of standing.
    """
    q, standing = record.joints_of(robot, "q"), robot.standing
    at, speed = (values[0] for values in windows.joint_states(record, robot))
    known = np.isfinite(q[0]) & np.isfinite(at)
    if not known.any():
        return []
    said = record.joints_of(robot, "dq")[0]  # zero of a robot that starts to move right now
    slow = np.abs(np.where(np.isfinite(said), said, speed)) < STILL
    near = np.abs(q[0] - standing) < NEAR + 2.0 * record.step("q")
    if np.all((slow & near) | ~known):
        return []
    moving = np.where(known, at, standing), np.where(known, speed, 0.0)
    return [Start(0, len(record.t), *moving)]


def idle(told: running.Orders) -> int:
    """Rows before a robot is told anything new.

    A bolted one that stands there has come to rest under what pulls at it; a model that gets
    the same pull at this moment has not.
    """
    rows = np.hstack([told.q, told.dq, told.tau])
    moved = np.any(rows != rows[0], axis=1)
    return int(np.argmax(moved)) - 1 if moved.any() else len(rows)


def turned(
    record: Record, robot: Robot, specs: Sequence[Mapping[str, Any]], starts: list[Start]
) -> list[Start]:
    """Starts where joints that are bolted on with a turn really are: their sensors say less."""
    offsets = np.zeros(len(robot.joints))
    for spec in specs:
        if spec.get("name") == "joint_offset" and not spec.get("start"):
            named = [fnmatchcase(joint, spec.get("joint") or "*") for joint in robot.joints]
            driven = np.isin(np.arange(len(robot.joints)), robot.driven)
            offsets[np.array(named) & driven] += spec.get("offset", 0.0)
    if not offsets.any():
        return starts
    if not starts:
        q = record.joints_of(robot, "q")[0]
        at = np.where(np.isfinite(q) & (offsets != 0.0), q, robot.standing)
        starts = _still(record, at)
    return [piece._replace(q=piece.q + offsets) for piece in starts]


def _nudged(record: Record, robot: Robot, starts: list[Start], speed: float) -> list[Start]:
    change = np.zeros(len(robot.joints))
    change[robot.driven] = speed
    starts = starts or _still(record, robot.standing)
    return [piece._replace(dq=piece.dq + change) for piece in starts]


def _still(record: Record, q: np.ndarray) -> list[Start]:
    """A whole record from rest."""
    return [Start(0, len(record.t), q, np.zeros(len(q)))]


def _late(spec: Mapping[str, Any]) -> bool:
    """Sensors are late by the same time, all the time: an effect on no more than the clock."""
    return spec["name"] == "sensor_latency" and {*spec} <= {"name", "delay", "channel"}


def shifted(values: np.ndarray, samples: float) -> np.ndarray:
    """Rows read `samples` earlier, between two of them by cubic interpolation; ends are held."""
    from scipy.ndimage import shift as moved

    finite, rows = np.isfinite(values), np.arange(len(values))
    filled = np.zeros(values.shape)
    for column in np.flatnonzero(finite.any(axis=0)):
        known = finite[:, column]
        filled[:, column] = np.interp(rows, rows[known], values[known, column])
    out = moved(filled, (samples, 0.0), order=3, mode="nearest")
    return np.where(finite, out, np.nan)
