# SPDX-License-Identifier: Apache-2.0
"""What a model says where a robot was measured.

    forward = Forward(model, records)
    residual = forward.measured[0] - forward([{"name": "coulomb_friction", "torque": 0.1}])[0]

The sensors of the model neither round nor rustle: noise in a prediction would be fitted.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from loco_control.exceptions import DivergedError, ParameterError
from loco_control.params import Params, parameter
from loco_sim import effects as sim_effects
from loco_sim.joint_commands import JointCommands
from loco_sim.model import Model
from loco_sim.robot import Robot
from loco_sim.servo import TorqueDrive
from loco_sim.simulation import Simulation

from .channels import SIGNALS, Channel, Track, measured, of
from .record import Record

NOISE = ("sensor_noise",)  # effects that a prediction leaves out
STILL, NEAR = 0.3, 0.02  # a robot slower [rad/s] and nearer to its standing pose stands [rad]


@dataclass(frozen=True)
class ForwardParams(Params):
    """How a model is run along a record."""

    signals: tuple[str, ...] = parameter(SIGNALS, "signals that are compared", any_length=True)
    burn_in: float = parameter(
        0.2, "at the start of a record that does not begin at rest in the standing pose: what "
        "is not weighed", "s", low=0.0, high=100.0
    )  # fmt: skip


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
        robots = [self._robot(record, {}, 1.0) for record in self.records]
        if not robots or not all(robot.drives for robot in robots):
            raise ParameterError(
                f"robot {model.robot!r} lists no drives in its robot.yaml, or there is no record"
            )
        self._commands = [commands(r, robot) for r, robot in zip(self.records, robots, strict=True)]
        free = min(robots, key=lambda robot: robot.fixed_base)
        self.channels: tuple[Channel, ...] = of(free, self.records, self.params.signals)
        self._starts = [start(r, robot) for r, robot in zip(self.records, robots, strict=True)]
        self.measured = [
            self._weighed(index, measured(robot, self.channels, self.records[index]))
            for index, robot in enumerate(robots)
        ]

    def _weighed(self, index: int, values: np.ndarray) -> np.ndarray:
        if self._starts[index] is not None:
            values[: round(self.params.burn_in / self.records[index].dt)] = np.nan
        return values

    def _robot(self, record: Record, overrides: Mapping[str, Any], step: float) -> Robot:
        """The robot of a record, with sensors that tell what they can."""
        model = Model(self.model.robot, {**self.model.overrides, **record.overrides, **overrides})
        robot = model.make_robot()
        if robot.sensors:
            robot = replace(robot, sensors=robot.sensors.replace(exact=True))
        sim = robot.sim
        steps = max(1, round(np.ceil(record.dt * sim.physics_rate - 1e-6)))
        rate = steps / (_period(record) * step)
        limit = sim.damping_limit * step  # so that sub-stepping is divided as well
        return replace(robot, sim=sim.replace(physics_rate=rate, damping_limit=limit))

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
        found = [self._run(i, effects, overrides or {}, step) for i in rows]
        if shift:
            found = [
                shifted(p, shift / self.records[i].dt) for i, p in zip(rows, found, strict=True)
            ]
        return found

    def _run(self, index: int, effects: Any, overrides: Mapping, step: float) -> np.ndarray:
        record, begin = self.records[index], self._starts[index]
        robot = self._robot(record, overrides, step)
        listed = [e for e in (*self.model.effects, *effects) if e.get("name") not in NOISE]
        made, put = sim_effects.from_list(listed), JointCommands(robot)
        q, dq = self._commands[index]
        track, period = Track(robot, self.channels), _period(record)
        with Simulation(None, None, made, 0, period, robot) as sim:
            try:
                state = sim.reset() if begin is None else sim.place(*begin)
                for row in range(len(q)):
                    track.add(state, sim)
                    state = sim.step(*put(row, row * period, q[row], dq[row]))
            except DivergedError:
                pass
        return track.matrix(len(q))

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


def _period(record: Record) -> float:
    """Time between samples [s]; stamps are rounded, rates are not."""
    return 1.0 / round(1.0 / record.dt, 3)


def commands(record: Record, robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """Positions (torques of torque drives) and velocities for `JointCommands`, each (T, m).

    Raises:
        ParameterError: The record lacks the kind of command that the drives need.
    """
    drives = [robot.drives[robot.joints[i]] for i in robot.driven]
    torque = np.array([isinstance(drive, TorqueDrive) for drive in drives], dtype=bool)
    wanted, speed = np.zeros((len(record.t), len(drives))), np.zeros((len(record.t), len(drives)))
    for kind, mine in (("torque", torque), ("position", ~torque)):
        if mine.any():
            wanted[:, mine] = record.command_of(robot, kind)[:, mine]
    if "velocity" in record.command:
        speed[:, ~torque] = record.command_of(robot, "velocity")[:, ~torque]
    if not np.all(np.isfinite(wanted)) or not np.all(np.isfinite(speed)):
        raise ParameterError(f"{record.name}: a command is not finite")
    return wanted, speed


def start(record: Record, robot: Robot) -> tuple[np.ndarray, np.ndarray] | None:
    """Joint positions [rad] and velocities [rad/s] at the start; None if the robot stands still.

    Joints that were not measured have those of standing.
    """
    q, standing = record.joints_of(robot, "q")[:5], robot.standing
    known = np.all(np.isfinite(q), axis=0)
    if len(q) < 5 or not known.any():
        return None
    speed, at = np.polynomial.polynomial.polyfit(record.t[:5], np.where(known, q, 0.0), 1)[::-1]
    speed = np.where(known, speed, 0.0)
    said = record.joints_of(robot, "dq")[0]  # zero of a robot that starts to move right now
    slow = np.abs(np.where(np.isfinite(said), said, speed)) < STILL
    near = np.abs(q[0] - standing) < NEAR + 2.0 * record.resolution.get("q", 0.0)
    if np.all((slow & near) | ~known):
        return None
    return np.where(known, at, standing), speed


def shifted(values: np.ndarray, samples: float) -> np.ndarray:
    """Rows read `samples` earlier, between two of them by cubic interpolation; ends are held."""
    from scipy.ndimage import shift as moved

    finite = np.isfinite(values)
    out = moved(np.where(finite, values, 0.0), (samples, 0.0), order=3, mode="nearest")
    return np.where(finite, out, np.nan)
