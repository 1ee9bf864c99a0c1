# SPDX-License-Identifier: Apache-2.0
"""One measured column in SI units with its own time stamps: what aligning begins with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot, joint_index
from loco_sim.robot.servo import TorqueDrive

from . import units
from .mapping import ROLES, UNUSED, Column, Mapping, Rule

JOINT, NAMED = "{joint}", ("column", "topic", "file")

BITS = {"unsigned8": 8, "unsigned16": 16, "unsigned32": 32}
AXES = {
    "gyro": "xyz",
    "acceleration": "xyz",
    "base_position": "xyz",
    "orientation": "xyzw",
    "base_orientation": "xyzw",
}


@dataclass(frozen=True, eq=False)
class Track:
    """A signal of one joint, foot or axis.

    Attributes:
        role: Role of the signal, one of `mapping.ROLES`.
        place: Joint, foot or axis; empty for what the whole robot has.
        t: Stamps [s], (K,), in no certain order yet.
        x: Values in the SI unit of the role, (K,).
        source: Column or topic, for messages.
        line: A command that runs straight from sample to sample.
    """

    role: str
    place: str
    t: np.ndarray
    x: np.ndarray
    source: str
    line: bool = False

    @property
    def label(self) -> str:
        """Signal and place in words, e.g. ``q of knee``."""
        return f"{self.role} of {self.place}" if self.place else self.role


class Source(Protocol):
    """A file or bag that columns are read from."""

    name: str
    header: dict

    def series(self, column: Column) -> tuple[np.ndarray, np.ndarray]:
        """Stamps [s] and raw values of a column, each (K,)."""


def from_source(source: Source, mapping: Mapping, rule: Rule, robot: Robot) -> list[Track]:
    """Tracks of all mapped columns within the rows and times of a rule.

    Raises:
        ParameterError: A unit does not fit the joint, or a column has not the numbers that
            its entry says.
        LocoError: The source lacks a column.
    """
    types = Description(robot.urdf).joint_types()
    found = []
    for column in of_joints(mapping, robot):
        _check_place(column, types)
        t, raw = source.series(column)
        x = values(column, raw, mapping.trust_units)
        if not column.file and not column.topic:
            t, x = t[slice(*rule.rows)], x[slice(*rule.rows)]
        inside = (t >= rule.start) & (t <= rule.end)
        if column.role != UNUSED:
            label = f"column {column.column!r}"
            line = column.between == "line"
            found.append(Track(column.role, column.place, t[inside], x[inside], label, line))
    return found


def of_joints(mapping: Mapping, robot: Robot) -> list[Column]:
    """Columns with one for each joint where ``{joint}`` stands in the name of one.

    Raises:
        NameUnknownError: A pattern is of no joint.
    """
    found = []
    for column in mapping.columns:
        if JOINT not in column.column + column.topic + column.file:
            found.append(column)
            continue
        for index in joint_index(robot.joints, column.place):
            joint = robot.joints[index]
            named = {key: getattr(column, key).replace(JOINT, joint) for key in NAMED}
            found.append(replace(column, place=joint, **named))
    return found


def locked(found: list[Track], held: dict[str, float], robot: Robot) -> list[Track]:
    """Tracks with those of joints that were held: where they were told to be and stayed.

    Raises:
        ParameterError: The robot has no such joint, its drive follows torques, or there is a
            column of it.
    """
    made, clock = list(found), next((track for track in found if track.role == "q"), None)
    for joint, at in held.items():
        if joint not in robot.joints:
            raise NameUnknownError("joint for locked", joint, robot.joints)
        if isinstance(robot.drives.get(joint), TorqueDrive):
            raise ParameterError(
                f"locked: {joint} has a drive for torques, which cannot hold it; give it an "
                "impedance drive in robot.yaml"
            )
        if any(track.place == joint for track in found):
            raise ParameterError(f"locked: {joint} has columns of its own; leave one of them out")
        roles = ["q"] + ["command_position"] * (joint in robot.drives)
        still = [] if clock is None else [(clock.t, np.full(len(clock.t), at))]
        made += [Track(role, joint, t, x, "locked") for role in roles for t, x in still]
    return made


def _check_place(column: Column, types: dict[str, str]) -> None:
    kind = ROLES[column.role][1]
    if kind == "axis" and column.place not in AXES[column.role]:
        raise ParameterError(
            f"column {column.column!r}: axis of {column.role} must be one of "
            f"{', '.join(AXES[column.role])}, got {column.place!r}"
        )
    if kind != "joint" or not column.unit or column.place not in types:
        return
    slides = types[column.place] == "prismatic"
    dimension, legal = units.dimension(column.unit), ROLES[column.role][0]
    if dimension in legal and dimension != legal[slides]:
        raise ParameterError(
            f"column {column.column!r} is in {column.unit}, but {column.place} is a "
            f"{'sliding' if slides else 'turning'} joint: give {column.role} in a unit of "
            f"{legal[slides]}"
        )


def values(column: Column, raw: np.ndarray, trust: bool) -> np.ndarray:
    """Values of a column in SI units, (K,); `trust` them to be signed.

    Raises:
        ParameterError: They cannot be, or probably are not, what the column says.
    """
    if column.wrap in BITS:
        raw = _signed(column, raw)
    elif not trust and _looks_unsigned(raw):
        raise ParameterError(
            f"column {column.column!r} ({column.role}) jumps between 0 and {np.nanmax(raw):.0f}: "
            "signed numbers stored as unsigned ones? If so say wrap: unsigned16"
        )
    x = raw * column.gain
    if column.wrap == "2pi":
        known = np.isfinite(x)
        x = x.copy()
        x[known] = np.unwrap(x[known])
    return x + column.offset


def _signed(column: Column, raw: np.ndarray) -> np.ndarray:
    """Two's complement of numbers that were stored without a sign."""
    span = 2.0 ** BITS[column.wrap]
    known = raw[np.isfinite(raw)]
    if np.any((known < 0) | (known >= span) | (known != np.round(known))):
        raise ParameterError(
            f"column {column.column!r} has wrap {column.wrap} and must hold whole numbers from "
            f"0 to {span - 1:.0f}; it has {known.min():g} to {known.max():g}"
        )
    return np.where(raw >= span / 2.0, raw - span, raw)


def _looks_unsigned(raw: np.ndarray) -> bool:
    """Whole numbers near 0 and near 2^16, and nothing between them."""
    known = raw[np.isfinite(raw)]
    if not len(known) or known.min() < 0.0 or not 6e4 < known.max() < 65536.0:
        return False
    low, high = np.mean(known < 2e4), np.mean(known > 45e3)
    return bool(low > 0.0 and high > 0.0 and low + high > 0.999 and np.all(known % 1.0 == 0.0))
