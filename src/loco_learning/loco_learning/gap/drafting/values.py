# SPDX-License-Identifier: Apache-2.0
"""Units, encoder counts and commands of columns, from their values."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..recordings import units
from . import words
from .lines import Line

TURNING = 7.0  # [rad], just above one turn; larger angles are taken as degrees (taste)
DEGREES = 360.0  # whole numbers beyond it are taken as counts of an encoder (taste)
AMBIGUOUS = words.INPUTS | words.CONTROLS | {"qd"}  # words with two meanings
FOLLOWING = 0.5  # deviation of a command from the position, over that of the position (taste)
UNEXPLAINED = 0.3  # unexplained share of a torque, below which it is that of a controller (taste)
MOTION_COMMANDS = ("command_position", "command_velocity")
ANGLES = ("q", "command_position")


class Sizes(NamedTuple):
    """Properties of a table that tell the units of its columns.

    Attributes:
        speed: Whether velocities were measured.
        turn: Counts a turn of columns of whole numbers; 0 if these may be degrees.
        endless: Velocity limits of joints that turn without end [rad/s].
        dt: Step of the time [s]; 0 if unknown.
    """

    speed: bool
    turn: int
    endless: Mapping[str, float]
    dt: float

    def with_unit(self, line: Line, values: np.ndarray) -> Line:
        """Line with the unit of a column, the scale that it needs, and the reason for it.

        Where velocities were measured, or tell that a wheel turns, large angles may be turns: the
        velocities tell the unit when the recording is read. Whole numbers may be counts.
        """
        if line.unit:
            line = line.also(f"{line.unit} by its name")
            if units.dimension(line.unit) != "current":
                return line
            return replace(line, scale="1.0").also("scale: N·m per A, from the data sheet")
        finite = values[np.isfinite(values)]
        peak = float(np.max(np.abs(finite), initial=0.0))
        if line.role in ANGLES and self.turn and not np.any(finite % 1.0):
            middle = 0.0 <= np.min(finite, initial=self.turn) < self.turn / 2 < peak
            offset = "-pi" if middle else ""
            line = replace(line, unit="count", scale=f"2pi/{self.turn}", offset=offset)
            line = line.also(f"whole numbers up to {peak:.4g}: counts? See how many are a turn")
            return line.also("zero in the middle?") if middle else line
        is_angle = self.speed or self._is_possible(finite, line.joint)
        if line.role in ANGLES and peak > TURNING and not is_angle:
            return replace(line, unit="deg").also(f"deg, as it reaches {peak:.4g}: rev, counts?")
        return line

    def _is_possible(self, finite: np.ndarray, joint: str) -> bool:
        """Whether a joint that turns without end can be as fast as values in rad tell."""
        steps = np.abs(np.diff(finite))
        limit = self.endless.get(joint, 0.0) * self.dt
        return len(steps) > 0 and 0.0 < np.percentile(steps, 99.0) <= limit


def counts_a_turn(columns: Sequence[np.ndarray]) -> int:
    """Counts a turn of columns of angles, a power of two; 0 if their numbers may be degrees."""
    finite = (values[np.isfinite(values)] for values in columns)
    peaks = [np.max(np.abs(x), initial=0.0) for x in finite if not np.any(x % 1.0)]
    peak = max(peaks, default=0.0)
    return 1 << int(peak).bit_length() if peak > DEGREES else 0


def by_values(line: Line, values: np.ndarray, positions: Mapping[str, np.ndarray]) -> Line:
    """The line with the other role of an ambiguous name if its values follow the joint's position.

    An input may be a torque or the position that a drive is to reach, and ``qd`` a velocity or the
    desired position.
    """
    q = positions.get(line.joint) if line.role in ("dq", "command_torque") else None
    if q is None or AMBIGUOUS.isdisjoint(words.split_name(line.column)) or not is_close(values, q):
        return line
    return replace(line, role="command_position").also("follows the position")


def one_command(
    lines: Sequence[Line], columns: Mapping[str, np.ndarray], follows: Collection[str]
) -> tuple[list[Line], dict[str, str]]:
    """Lines without a second command of a joint, and a comment on each column that is left out.

    A log may have both the desired motion and the torque that a controller made of it. This is no
    torque beside that of a drive: either the drive is told it, or it is what the drive gave.
    """
    by_role = {(line.role, line.joint): columns[line.column] for line in reversed(lines)}
    result, notes = list(lines), dict[str, str]()
    votes: dict[tuple[str, ...], list[bool]] = {}  # joints whose columns are alike are told alike
    torques = [line for line in lines if line.role == "command_torque"]
    for line in torques:
        votes.setdefault(_template(line), []).append(_is_total(line.joint, by_role))
    for line in torques:
        motion = [x for x in lines if x.joint == line.joint and x.role in MOTION_COMMANDS]
        if not motion or np.mean(votes[_template(line)]) <= 0.5:
            continue
        if line.joint in follows:
            other = replace(line, role="tau").also("of the drive, which is told positions")
            result[result.index(line)] = other
        else:
            result = [x for x in result if x not in motion]
            left = [x.column for x in motion]
            text = f"# Left out: {', '.join(left)}; {line.column} is all that the motor is told?"
            notes |= dict.fromkeys(left, text)
    return result, notes


def _template(line: Line) -> tuple[str, ...]:
    """Words of the name of a column that do not say its joint."""
    of_joint = words.split_name(line.joint)
    return tuple(w for w in words.split_name(line.column) if not w.isdigit() and w not in of_joint)


def _is_total(joint: str, columns: Mapping[tuple[str, str], np.ndarray]) -> bool:
    """True if a commanded torque is that which was measured, or follows the error of position."""
    torque, q = columns["command_torque", joint], columns.get(("q", joint))
    measured, desired = columns.get(("tau", joint)), columns.get(("command_position", joint))
    if measured is not None and _explained(torque, [measured]):
        return True
    if q is None or desired is None:
        return False
    return _explained(torque, [desired - q, np.gradient(q), np.gradient(desired)])


def _explained(values: np.ndarray, regressors: Sequence[np.ndarray]) -> bool:
    """True if values that change are a sum of multiples of others, and a constant."""
    columns = np.stack([*regressors, np.ones(len(values))], axis=1)
    rows = np.isfinite(columns).all(axis=1) & np.isfinite(values)
    deviation = np.std(values[rows]) if rows.any() else 0.0
    if not deviation:
        return False
    fit = columns[rows] @ np.linalg.lstsq(columns[rows], values[rows])[0]
    return bool(np.std(values[rows] - fit) < UNEXPLAINED * deviation)


def is_close(values: np.ndarray, q: np.ndarray) -> bool:
    """True if values are close to a position that moves, as those of a commanded position are."""
    both = np.isfinite(values) & np.isfinite(q)
    return bool(both.any() and np.std(values[both] - q[both]) < FOLLOWING * np.std(q[both]))
