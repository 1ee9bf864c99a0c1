# SPDX-License-Identifier: Apache-2.0
"""Track: one measured column in SI units with its own time stamps, the input of alignment."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot, joint_index
from loco_sim.robot.servo import TorqueDrive

from . import units
from .mapping import ROLES, UNUSED, Column, Mapping, Mend, Rule
from .record import JOINT_SIGNALS, Doubt
from .units import periodic

JOINT, NAMED = "{joint}", ("column", "topic", "file")
COUPLED = ("q", "command_position", "dq", "command_velocity")  # roles that followers have too
INPUTS = ("supply", "enable", "stance")  # inputs of the robot other than commands

FINEST = 1e-5  # share of a signal's range below which steps are rounding
UNFIT_DRIVES = {  # of joints without columns, by the key of the mapping that lists them
    "locked": "for torques, which cannot hold it; if it never moves, lock it in robot.yaml "
    "instead: locked: {{{0}: {1:g}}}",
    "undriven": "that holds positions; say in robot.yaml: drives: {{{0}: {{kind: torque}}}}",
}
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
        place: Joint, foot or axis; empty for a signal of the whole robot.
        t: Time stamps [s], (K,), not yet sorted.
        x: Values in the SI unit of the role, (K,).
        source: Column or topic, for messages.
        between: `hold` or `line` (linear) for a command between samples; empty if not stated.
        empty: Number of cells of a table without a reading of it.
    """

    role: str
    place: str
    t: np.ndarray
    x: np.ndarray
    source: str
    between: str = ""
    empty: int = 0

    @property
    def label(self) -> str:
        """Signal and place in words, e.g. ``q of knee``."""
        return f"{self.role} of {self.place}" if self.place else self.role


class Source(Protocol):
    """A file or bag with columns."""

    name: str
    header: dict
    notes: list[str]

    def series(self, column: Column) -> tuple[np.ndarray, np.ndarray]:
        """Time stamps [s] and raw values of a column, each (K,)."""


def unscaled(column: Column) -> bool:
    """Whether a column is a measured current without its torque constant."""
    current = column.role == "tau" and units.dimension(column.unit or "rad") == "current"
    return current and abs(column.gain) == units.factor(column.unit)


def from_source(source: Source, mapping: Mapping, rule: Rule, robot: Robot) -> list[Track]:
    """Tracks of all mapped columns within the rows and times of a rule.

    Raises:
        ParameterError: A unit does not fit the joint, or a column does not hold the numbers
            that its entry declares.
        LocoError: The source lacks a column.
    """
    types = Description(robot.urdf).joint_types()
    tracks = []
    for column in of_joints(mapping, robot):
        _check_place(column, types)
        t, raw = source.series(column)
        missing = np.full(len(raw), False) if column.missing is None else raw == column.missing
        raw = np.where(missing, np.nan, raw)
        x = values(column, raw, mapping.trust_units)
        if not column.file and not column.topic:
            t, x, missing = (part[slice(*rule.rows)] for part in (t, x, missing))
        empty = np.isnan(x) & (missing | (not column.topic))
        label = f"{column.role} of {column.place}".removesuffix(" of ")
        if unscaled(column):
            source.notes.append(Doubt(f"{label} is a current at 1 N·m per A, as its scale is "
                                      "1; its data sheet has the torque constant"))  # fmt: skip
        if missing.any():
            source.notes.append(_omission_note(label, missing, column.missing))
        if not empty.all():  # otherwise the column was not measured
            t, x = t[~empty], x[~empty]
        inside = (t >= rule.start) & (t <= rule.end) | ~np.isfinite(t)
        if column.role != UNUSED:
            label = f"column {column.column!r}"
            lost = int((empty & ~missing).sum()) % max(len(empty), 1)
            values_of = t[inside], x[inside], label, column.between, lost
            tracks.append(Track(column.role, column.place, *values_of))
    return tracks


def _omission_note(label: str, omitted: np.ndarray, value: float | None) -> Doubt:
    count = f"{int(omitted.sum()):,} of {len(omitted):,} readings"
    return Doubt(f"{label}: {count} are {value:g}, which the mapping calls missing: left out")


def without(tracks: list[Track], value: float | None, notes: list[str]) -> list[Track]:
    """Tracks without readings whose position has the value that means no reading.

    Velocities and torques of the same joint and time stamp are removed as well, since they come
    from the same publisher.

    Args:
        tracks: Tracks of a bag.
        value: Position that means no reading; None keeps all.
        notes: List to which a sentence is appended for each joint.
    """
    dropped = {k.place: k.t[k.x == value] for k in tracks if k.role == "q" and value is not None}
    result = []
    for track in tracks:
        rows = np.isin(track.t, dropped.get(track.place, ())) & (track.role in JOINT_SIGNALS)
        if rows.any() and track.role == "q":
            notes.append(_omission_note(track.label, rows, value))
        result.append(replace(track, t=track.t[~rows], x=track.x[~rows]) if rows.any() else track)
    return result


def of_joints(mapping: Mapping, robot: Robot) -> list[Column]:
    """Columns of a mapping, with ``{joint}`` in a name expanded to all matching joints.

    Raises:
        NameUnknownError: A pattern matches no joint.
    """
    columns = []
    for column in mapping.columns:
        if JOINT not in column.column + column.topic + column.file:
            columns.append(column)
            continue
        for index in joint_index(robot.joints, column.place):
            joint = robot.joints[index]
            named = {key: getattr(column, key).replace(JOINT, joint) for key in NAMED}
            columns.append(replace(column, place=joint, **named))
    return columns


def without_columns(tracks: Sequence[Track], mapping: Mapping, robot: Robot) -> list[Track]:
    """Constant tracks of joints without columns, at the times of the first position.

    Joints that nothing drove are commanded torques of 0; locked joints have a constant position,
    which is commanded where they have a drive.

    Raises:
        ParameterError: The robot has no such joint, its drive does not fit, or the joint has
            columns of its own.
    """
    constants = [("undriven", joint, 0.0) for joint in mapping.undriven]
    constants += [("locked", joint, at) for joint, at in mapping.locked.items()]
    clock = next((track.t for track in tracks if track.role == "q"), None)
    result = []
    for kind, joint, value in constants:
        is_locked, drive = kind == "locked", robot.drives.get(joint)
        if joint not in robot.joints:
            raise NameUnknownError(f"joint for {kind}", joint, robot.joints)
        if any(k.place == joint and (is_locked or k.role.startswith("command_")) for k in tracks):
            columns = "columns of its own" if is_locked else "a command"
            raise ParameterError(f"{kind}: {joint} has {columns}; leave one of them out")
        if drive and is_locked == isinstance(drive, TorqueDrive):
            raise ParameterError(
                f"{kind}: {joint} has a drive {UNFIT_DRIVES[kind].format(joint, value)}"
            )
        command = ["command_position" if is_locked else "command_torque"] * bool(drive)
        for role in ["q"] * is_locked + command if clock is not None else ():
            result.append(Track(role, joint, clock, np.full(len(clock), value), kind))
    return result


def correct(tracks: Sequence[Track], mends: Sequence[Mend]) -> list[Track]:
    """Tracks after the corrections of a mapping, in their order; consecutive `is` act at once.

    Raises:
        ParameterError: There is no signal that a correction names.
    """
    result, renamed = list(tracks), dict[int, str]()
    for mend in mends:
        if not mend.other:
            result, renamed = _renamed(result, renamed), {}
        rows = [i for i, k in enumerate(result) if k.role == mend.role
                and mend.place in ("", k.place)]  # fmt: skip
        if not rows:
            raise ParameterError(
                f"mend: there is no {mend.role} of {mend.place or 'any place'}; there are "
                f"{', '.join(dict.fromkeys(k.label for k in result)) or 'no signals'}"
            )
        for i in rows:
            x = result[i].x
            x = periodic(x, mend.period) if mend.period else x
            result[i] = replace(result[i], x=mend.gain * x + mend.offset)
            if mend.other:
                renamed[i] = mend.other
    return _renamed(result, renamed)


def joint_names(recorded: Collection[str], joints: Sequence[str]) -> dict[str, str]:
    """Joints of a robot by their names in a recording, which differ by one prefix and suffix.

    Either side may have them. Empty if the recording lacks a joint, or has several such groups.
    """
    first = joints[0] if joints else ""
    longer = {tuple(name.split(first, 1)) for name in recorded if first and first in name}
    shorter = {tuple(first.split(name, 1)) for name in recorded if name and name in first}
    options = [{f"{a}{joint}{b}": joint for joint in joints} for a, b in longer]
    options += [{joint.removeprefix(a).removesuffix(b): joint for joint in joints}
                for a, b in shorter]  # fmt: skip
    options = [names for names in options if names.keys() <= set(recorded)]
    return options[0] if len(options) == 1 else {}


def _renamed(tracks: Sequence[Track], names: dict[int, str]) -> list[Track]:
    """Tracks of which some, by their index, are of other joints."""
    return [replace(k, place=names.get(i, k.place)) for i, k in enumerate(tracks)]


def followed(found: Sequence[Track], robot: Robot, notes: list[str]) -> list[Track]:
    """Tracks with those of unrecorded joints that are coupled to another joint.

    Args:
        found: Tracks of the file.
        robot: Robot that was measured.
        notes: List to which a sentence is appended for each such joint.
    """
    result = list(found)
    for joint, (leader, factor, offset) in robot.followers.items():
        roles = {track.role for track in found if track.place == joint}
        lead = [t for t in found if t.place == leader and t.role in COUPLED and t.role not in roles]
        for track in lead:
            shift = offset if track.role in COUPLED[:2] else 0.0
            result.append(replace(track, place=joint, x=factor * track.x + shift))
        if "q" in {track.role for track in lead}:
            notes.append(f"{joint} was not recorded: made from {leader}, which it follows")
    return result


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
    """Values of a column in SI units, (K,); with `trust` without the check for lost signs.

    Raises:
        ParameterError: The values contradict the entry of the column, or probably do.
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
        x = periodic(x, units.TURN)
    return x + column.offset


def _signed(column: Column, raw: np.ndarray) -> np.ndarray:
    """Signed numbers from unsigned ones (two's complement)."""
    span = 2.0 ** BITS[column.wrap]
    finite = raw[np.isfinite(raw)]
    if np.any((finite < 0) | (finite >= span) | (finite != np.round(finite))):
        raise ParameterError(
            f"column {column.column!r} has wrap {column.wrap} and must hold whole numbers from "
            f"0 to {span - 1:.0f}; it has {finite.min():g} to {finite.max():g}"
        )
    return np.where(raw >= span / 2.0, raw - span, raw)


def _looks_unsigned(raw: np.ndarray) -> bool:
    """True for whole numbers near 0 and near 2^16, with none between them."""
    finite = raw[np.isfinite(raw)]
    if not len(finite) or finite.min() < 0.0 or not 6e4 < finite.max() < 65536.0:
        return False
    low, high = np.mean(finite < 2e4), np.mean(finite > 45e3)
    return bool(low > 0.0 and high > 0.0 and low + high > 0.999 and np.all(finite % 1.0 == 0.0))


def quantum(track: Track) -> float | None:
    """Quantisation step: the common divisor of all differences of values; 0 if there is none.

    None if the values hardly change, so that it cannot be determined.
    """
    values = np.unique(track.x)
    if len(values) < 3:
        return None
    between = np.diff(values)
    finest = FINEST * (values[-1] - values[0])
    between = between[between > 0.01 * finest]
    if len(between) < 2:
        return None
    for parts in (1, 2, 3):
        step = float(np.min(between)) / parts
        step = float(np.sum(between) / np.sum(np.round(between / step)))
        remainder = np.abs(between / step - np.round(between / step))
        if step > finest and np.mean(remainder < 0.1) > 0.97:
            return step
    return 0.0
