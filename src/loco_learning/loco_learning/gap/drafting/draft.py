# SPDX-License-Identifier: Apache-2.0
"""Draft of ``mapping.yaml`` with the reason for each line, for the user to correct."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from loco_control.exceptions import ParameterError

from ..recordings import units
from . import words

RATES = (5.0, 5e3)  # plausible rates of logs [Hz]; other units of time are rejected (taste)
MOVED = "; nothing else is a command, so this is taken as what moved the joint"
TURNING = 7.0  # [rad], just above one turn; larger angles are taken as degrees (taste)


@dataclass(frozen=True)
class Line:
    """A column of the draft.

    Attributes:
        column: Name of the column, or path of a field.
        role: Role of the values.
        joint: Joint of the values.
        why: Reason in words.
        unit: Unit; empty is the SI unit.
        topic: Topic in a bag.
        scale: Scale that the user has to fill in; empty where none is needed.
    """

    column: str
    role: str
    joint: str
    why: str
    unit: str = ""
    topic: str = ""
    scale: str = ""

    @property
    def text(self) -> str:
        """Line of the file."""
        topic = f"topic: {_quoted(self.topic)}, " if self.topic else ""
        unit = f", unit: {self.unit}" if self.unit else ""
        scale = f", scale: {self.scale}" if self.scale else ""
        return (
            f"  - {{{topic}column: {_quoted(self.column)}, role: {self.role}, "
            f"joint: {_quoted(self.joint)}{unit}{scale}}}  # {self.why}"
        )


def of_table(
    columns: Mapping[str, np.ndarray], joints: Sequence[str], file: str = "recording"
) -> str:
    """Text of a mapping for the columns of a table.

    Args:
        columns: Values by name.
        joints: Joint names of the robot; empty if the robot is not known.
        file: Name of the file, for messages.

    Raises:
        ParameterError: No column name contains a known role.
    """
    time, head = _time(columns)
    others = {name: values for name, values in columns.items() if name != time}
    speed = any(words.guess(name, joints).role == "dq" for name in others)
    numbered = words.numbered(list(others), joints)
    lines = [x for name, y in others.items() for x in _column(name, y, joints, numbered, speed)]
    return written(lines, list(others), joints, file, head)


def written(
    lines: Sequence[Line],
    names: Sequence[str],
    joints: Sequence[str],
    file: str,
    head: Sequence[str] = (),
) -> str:
    """Text of a mapping; of several lines for one role of a joint only the first is used.

    If no line is a command, measured torques are taken as the commands.

    Args:
        lines: Columns in the order of the file.
        names: All columns or topics of the file.
        joints: Joint names of the robot; empty if the robot is not known.
        file: Name of the file, for messages.
        head: Lines before the columns.

    Raises:
        ParameterError: There is no line.
    """
    first: dict[tuple[str, str], Line] = {}
    if not any(line.role.startswith("command_") for line in lines):
        lines = [replace(x, role="command_torque", why=x.why + MOVED) if x.role == "tau" else x
                 for x in lines]  # fmt: skip
    for line in lines:
        first.setdefault((line.role, line.joint), line)
    if not first:
        raise ParameterError(
            f"{file}: no name says what is measured or commanded; it has "
            f"{', '.join(names) or 'nothing'}. Write a mapping by hand (docs/gap_import.md)"
        )
    rest = [line for line in lines if line not in first.values()]
    used = {line.column for line in lines} | {line.topic for line in lines}
    text = [f"# Drafted from {file}: look at each line, above all at joints, units and signs.",
            *head, "columns:", *(line.text for line in first.values())]  # fmt: skip
    text += [f"# The same again, left out: {line.text.strip(' -')}" for line in rest]
    left = [name for name in names if name not in used]
    text += [f"# Not used: {', '.join(left)}"] if left else []
    return "\n".join([*text, *(f"# Missing: {what}" for what in missing(first, joints))]) + "\n"


def missing(found: Mapping[tuple[str, str], Line], joints: Sequence[str]) -> list[str]:
    """Roles that a search needs and no line provides, in words."""
    required = joints or sorted({joint for _, joint in found})
    absent = [f"q of {joint}" for joint in required if ("q", joint) not in found]
    commanded = {joint for role, joint in found if role.startswith("command_")}
    return absent + [f"a command of {joint}" for joint in required if joint not in commanded]


def _column(
    name: str,
    values: np.ndarray,
    joints: Sequence[str],
    numbered: Mapping[int, str],
    speed: bool,
) -> list[Line]:
    guess = words.guess(name, joints)
    joint, comment = guess.joint, guess.why
    number = words.number(name, joints)
    if not joint and number is not None:
        joint = numbered.get(number, "")
        comment += f", number {number} of the joints: in this order?"
    if not joint and len(joints) == 1:
        joint, comment = joints[0], f"{comment}, the only joint"
    if not guess.role or not joint:
        return []
    unit, reason = _unit(guess.role, guess.unit, values, speed)
    scaled = units.dimension(unit) in ("current", "counts") if unit else False
    reason += "; scale: N·m per A, from the data sheet" if scaled else ""
    return [Line(name, guess.role, joint, comment + reason, unit, scale="1.0" if scaled else "")]


def _unit(role: str, unit: str, values: np.ndarray, speed: bool) -> tuple[str, str]:
    """Unit of a column, and the reason for it in words.

    Where velocities (`speed`) were measured, large angles may be turns: the velocities tell the
    unit when the recording is read.
    """
    if unit:
        return unit, f"; {unit} by its name"
    peak = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
    if role in ("q", "command_position") and peak > TURNING and not speed:
        return "deg", f"; deg, as it reaches {peak:.4g}: rev, counts?"
    return "", ""


def _time(columns: Mapping[str, np.ndarray]) -> tuple[str, list[str]]:
    """Name of the time column, empty if there is none, and its lines of the mapping."""
    for name, values in columns.items():
        unit, finite = words.time_unit(name), values[np.isfinite(values)]
        if unit is None or len(finite) < 3 or np.mean(np.diff(finite) >= 0.0) < 0.9:
            continue
        step = float(np.median(np.diff(finite)))
        fits = [u for u in ("s", "ms", "us", "ns")
                if step > 0.0 and RATES[0] <= 1.0 / (step * units.factor(u)) <= RATES[1]]  # fmt: skip
        symbol = unit or (fits or ["s"])[0]
        rate = 1.0 / (step * units.factor(symbol)) if step > 0.0 else 0.0
        comment = f"rises by {step:.6g}, {rate:.4g} Hz"
        return name, [f"time: {{column: {_quoted(name)}, unit: {symbol}}}  # {comment}"]
    return "", ["time: {rate: 100}  # no column of times: say the rate of the log in Hz"]


def _quoted(text: str) -> str:
    """Text in quotation marks where YAML would otherwise read it as another type."""
    simple = text.replace("_", "a").isalnum() and not text[:1].isdigit()
    reserved = text.lower() in ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return text if simple and not reserved else f'"{escaped}"'
