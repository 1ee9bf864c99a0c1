# SPDX-License-Identifier: Apache-2.0
"""Signals that are compared: the channels of a robot, of a record, and of a run of the model.

Everything stands in one matrix (T, C). Poses of the base are told in the place and heading
of the record's first sample, where the model starts as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.orientation import roll_pitch_yaw
from loco_sim.robot.robot import Robot

from ...metrics.signals import roll_pitch_yaw as all_roll_pitch_yaw
from ..recordings.record import FEET_SIGNAL, JOINT_SIGNALS, Record

AXES = {
    "gyro": ("x", "y", "z"),
    "acceleration": ("x", "y", "z"),
    "orientation": ("roll", "pitch", "yaw"),
    "base_position": ("x", "y", "z"),
    "base_orientation": ("roll", "pitch", "yaw"),
}
SIGNALS = (*JOINT_SIGNALS, *AXES, FEET_SIGNAL)
UNITS = {
    "q": "rad",
    "dq": "rad/s",
    "tau": "N·m",
    "gyro": "rad/s",
    "acceleration": "m/s²",
    "orientation": "rad",
    "base_position": "m",
    "base_orientation": "rad",
    "grf": "N",
}
SLIDING = {"q": "m", "dq": "m/s", "tau": "N"}
ON_SLIDES = {
    "rad": "m", "rad/s": "m/s", "N·m": "N", "N·m·s/rad": "N·s/m", "N·m/rad": "N/m",
    "N·m/rad³": "N/m³", "kg·m²": "kg", "rad/(N·m)": "m/N", "s/rad": "s/m", "1/rad": "1/m",
    "1/rad²": "1/m²",
}  # fmt: skip
TURNED = ("orientation", "base_orientation")


@dataclass(frozen=True)
class Channel:
    """One number that is measured at each time.

    Attributes:
        signal: One of `SIGNALS`.
        name: Joint, foot or axis.
        unit: Unit.
    """

    signal: str
    name: str
    unit: str

    def __str__(self) -> str:
        return f"{self.signal} {self.name}"


def of(
    robots: Sequence[Robot], records: Sequence[Record], signals: Sequence[str]
) -> tuple[Channel, ...]:
    """Channels that any of the records measured, in a fixed order.

    Args:
        robots: One per record, the same but for how it is held.
        records: Measured records.
        signals: Signals of `SIGNALS` that count.
    """
    from loco_sim.robot.description import Description

    sliding = {
        j for j, kind in Description(robots[0].urdf).joint_types().items() if kind == "prismatic"
    }
    found = []
    for signal in SIGNALS:
        if signal not in signals:
            continue
        names = _names(robots[0], signal)
        seen = np.zeros(len(names), dtype=bool)
        for robot, record in zip(robots, records, strict=True):
            seen |= np.any(np.isfinite(_columns(robot, record, signal)), axis=0)
        for name in np.array(names)[seen].tolist():
            unit = SLIDING.get(signal) if name in sliding else UNITS[signal]
            found.append(Channel(signal, name, unit or UNITS[signal]))
    return tuple(found)


def slides(channels: Sequence[Channel]) -> set[str]:
    """Joints that slide."""
    return {c.name for c in channels if c.unit == SLIDING.get(c.signal)}


def _names(robot: Robot, signal: str) -> tuple[str, ...]:
    if signal in JOINT_SIGNALS:
        return robot.joints
    return robot.feet if signal == FEET_SIGNAL else AXES[signal]


def _columns(robot: Robot, record: Record, signal: str) -> np.ndarray:
    """A signal of a record as numbers that can be subtracted, (T, k); NaN where not measured.

    What a base measures that is bolted to the world says nothing: NaN as well.
    """
    if signal in JOINT_SIGNALS:
        return record.read_of(robot, signal)
    if robot.fixed_base:
        return np.full((len(record.t), len(_names(robot, signal))), np.nan)
    if signal == FEET_SIGNAL:
        return record.feet_of(robot.feet)
    values = record.signals.get(signal)
    if values is None:
        return np.full((len(record.t), 3), np.nan)
    if signal in TURNED:
        return _angles(values, heading(values))
    if signal == "base_position":
        return at_home(values, record)
    return values


def heading(orientation: np.ndarray) -> float:
    """Yaw of the first sample that was measured [rad]; 0 if none was."""
    known = np.flatnonzero(np.all(np.isfinite(orientation), axis=1))
    return roll_pitch_yaw(orientation[known[0]])[2] if len(known) else 0.0


def _angles(orientation: np.ndarray, yaw: float = 0.0) -> np.ndarray:
    """Roll, pitch and yaw [rad], (T, 3), the last without jumps and from `yaw` on."""
    angles = all_roll_pitch_yaw(orientation)
    known = np.isfinite(angles[:, 2])
    angles[known, 2] = np.unwrap(angles[known, 2]) - yaw
    return angles


def at_home(position: np.ndarray, record: Record) -> np.ndarray:
    """Positions from the first measured one on, along and across the first heading [m]."""
    known = np.flatnonzero(np.all(np.isfinite(position), axis=1))
    turned = record.signals.get("base_orientation", record.signals.get("orientation"))
    yaw = 0.0 if turned is None else heading(turned)
    c, s = np.cos(yaw), np.sin(yaw)
    moved = position.copy()
    if len(known):
        moved[:, :2] -= position[known[0], :2]
    moved[:, :2] = moved[:, :2] @ np.array([[c, -s], [s, c]])
    return moved


def measured(robot: Robot, channels: Sequence[Channel], record: Record) -> np.ndarray:
    """Values of a record, (T, C); NaN where not measured."""
    out = np.full((len(record.t), len(channels)), np.nan)
    for signal, columns, mine in _groups(robot, channels):
        out[:, columns] = _columns(robot, record, signal)[:, mine]
    return out


class Track:
    """Readings of a model, row by row.

    Args:
        robot: The robot simulated.
        channels: Columns of the result.
    """

    def __init__(self, robot: Robot, channels: Sequence[Channel]):
        self._robot, self._channels = robot, tuple(channels)
        self._said: dict[str, list[Any]] = {c.signal: [] for c in channels}
        self._true_base = any(s.startswith("base_") for s in self._said)

    def add(self, state: Any, sim: Any) -> None:
        """Take what the sensors say and, if it is compared, the pose of the base."""
        for signal, values in self._said.items():
            if not signal.startswith("base_"):
                values.append(READ[signal](state))
        if self._true_base:
            truth = sim.ground_truth()
            for signal, value in (
                ("base_position", truth.position),
                ("base_orientation", truth.orientation),
            ):
                if signal in self._said:
                    self._said[signal].append(value)

    def matrix(self, rows: int) -> np.ndarray:
        """All rows, (rows, C); NaN for those that never came."""
        said = {signal: np.array(values) for signal, values in self._said.items() if values}
        return assembled(self._robot, self._channels, said, rows)


def assembled(
    robot: Robot, channels: Sequence[Channel], said: Mapping[str, np.ndarray], rows: int
) -> np.ndarray:
    """Channels of signals of a model, (rows, C); NaN where there is none.

    Args:
        robot: The robot simulated.
        channels: Columns of the result.
        said: Signals from the first row on, each (up to rows, k); attitudes as x y z w.
        rows: Rows of the result.
    """
    out = np.full((rows, len(channels)), np.nan)
    for signal, columns, mine in _groups(robot, channels):
        if signal in said:
            values = _angles(said[signal]) if signal in TURNED else said[signal]
            out[: len(values), columns] = values[:, mine]
    return out


READ = {
    "q": lambda state: state.q,
    "dq": lambda state: state.dq,
    "tau": lambda state: state.tau,
    "gyro": lambda state: state.angular_velocity,
    "acceleration": lambda state: state.linear_acceleration,
    "orientation": lambda state: state.orientation,
    "grf": lambda state: state.grf[:, 2],
}


def _groups(robot: Robot, channels: Sequence[Channel]) -> list[tuple[str, list[int], list[int]]]:
    """Per signal: its columns in the matrix and those in its own array."""
    made = []
    for signal in SIGNALS:
        names = _names(robot, signal)
        columns = [i for i, channel in enumerate(channels) if channel.signal == signal]
        if columns:
            made.append((signal, columns, [names.index(channels[i].name) for i in columns]))
    return made
