# SPDX-License-Identifier: Apache-2.0
"""Channels: the signals of a robot that are compared, measured in a record or simulated.

All of them form one matrix (T, C). Poses of the base are relative to the position and heading of
the first sample of the record, where the model starts as well.
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
ORIENTATIONS = ("orientation", "base_orientation")


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
    """Channels that are measured in at least one record, in a fixed order.

    Args:
        robots: One per record, equal except for how the base is fixed.
        records: Measured records.
        signals: Names from `SIGNALS` to use.
    """
    from loco_sim.robot.description import Description

    sliding = {
        j for j, kind in Description(robots[0].urdf).joint_types().items() if kind == "prismatic"
    }
    channels = []
    for signal in SIGNALS:
        if signal not in signals:
            continue
        names = _names(robots[0], signal)
        valid = np.zeros(len(names), dtype=bool)
        for robot, record in zip(robots, records, strict=True):
            valid |= np.any(np.isfinite(_columns(robot, record, signal)), axis=0)
        for name in np.array(names)[valid].tolist():
            unit = SLIDING.get(signal) if name in sliding else UNITS[signal]
            channels.append(Channel(signal, name, unit or UNITS[signal]))
    return tuple(channels)


def slides(channels: Sequence[Channel]) -> set[str]:
    """Names of the prismatic joints."""
    return {c.name for c in channels if c.unit == SLIDING.get(c.signal)}


def _names(robot: Robot, signal: str) -> tuple[str, ...]:
    if signal in JOINT_SIGNALS:
        return robot.joints
    return robot.feet if signal == FEET_SIGNAL else AXES[signal]


def _columns(robot: Robot, record: Record, signal: str) -> np.ndarray:
    """A signal of a record as numbers that can be subtracted, (T, k); NaN where not measured.

    Signals of the base are NaN as well if the base is fixed.
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
    if signal in ORIENTATIONS:
        return _angles(values, heading(values))
    if signal == "base_position":
        return at_home(values, record)
    return values


def heading(orientation: np.ndarray) -> float:
    """Yaw of the first measured sample [rad]; 0 if there is none."""
    valid = np.flatnonzero(np.all(np.isfinite(orientation), axis=1))
    return roll_pitch_yaw(orientation[valid[0]])[2] if len(valid) else 0.0


def _angles(orientation: np.ndarray, yaw: float = 0.0) -> np.ndarray:
    """Roll, pitch and yaw [rad], (T, 3); yaw is unwrapped and relative to `yaw`."""
    angles = all_roll_pitch_yaw(orientation)
    valid = np.isfinite(angles[:, 2])
    angles[valid, 2] = np.unwrap(angles[valid, 2]) - yaw
    return angles


def at_home(position: np.ndarray, record: Record) -> np.ndarray:
    """Positions relative to the first measured one, x along the first heading [m], (T, 3)."""
    valid = np.flatnonzero(np.all(np.isfinite(position), axis=1))
    orientation = record.signals.get("base_orientation", record.signals.get("orientation"))
    yaw = 0.0 if orientation is None else heading(orientation)
    c, s = np.cos(yaw), np.sin(yaw)
    moved = position.copy()
    if len(valid):
        moved[:, :2] -= position[valid[0], :2]
    moved[:, :2] = moved[:, :2] @ np.array([[c, -s], [s, c]])
    return moved


def measured(robot: Robot, channels: Sequence[Channel], record: Record) -> np.ndarray:
    """Values of a record, (T, C); NaN where not measured."""
    out = np.full((len(record.t), len(channels)), np.nan)
    for signal, columns, indices in _groups(robot, channels):
        out[:, columns] = _columns(robot, record, signal)[:, indices]
    return out


class Track:
    """Sensor readings of a simulation, collected row by row.

    Args:
        robot: The simulated robot.
        channels: Columns of the result.
    """

    def __init__(self, robot: Robot, channels: Sequence[Channel]):
        self._robot, self._channels = robot, tuple(channels)
        self._said: dict[str, list[Any]] = {c.signal: [] for c in channels}
        self._true_base = any(s.startswith("base_") for s in self._said)

    def add(self, state: Any, sim: Any) -> None:
        """Append the sensor readings and, if it is compared, the true pose of the base."""
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
        """All rows, (rows, C); NaN for those that were not added."""
        signals = {signal: np.array(values) for signal, values in self._said.items() if values}
        return assembled(self._robot, self._channels, signals, rows)


def assembled(
    robot: Robot, channels: Sequence[Channel], signals: Mapping[str, np.ndarray], rows: int
) -> np.ndarray:
    """Matrix of channels from simulated signals, (rows, C); NaN where there is none.

    Args:
        robot: The simulated robot.
        channels: Columns of the result.
        signals: Signals from the first row on, each (up to rows, k); orientations as x y z w.
        rows: Rows of the result.
    """
    out = np.full((rows, len(channels)), np.nan)
    for signal, columns, indices in _groups(robot, channels):
        if signal in signals:
            values = _angles(signals[signal]) if signal in ORIENTATIONS else signals[signal]
            out[: len(values), columns] = values[:, indices]
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
    """Per signal: its columns in the matrix, and the corresponding columns of its own array."""
    groups = []
    for signal in SIGNALS:
        names = _names(robot, signal)
        columns = [i for i, channel in enumerate(channels) if channel.signal == signal]
        if columns:
            groups.append((signal, columns, [names.index(channels[i].name) for i in columns]))
    return groups
