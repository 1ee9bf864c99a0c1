# SPDX-License-Identifier: Apache-2.0
"""Draft of ``mapping.yaml`` with the reason for each line, for the user to correct."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from loco_control.exceptions import ParameterError

from ..importing import tables
from ..recordings import units
from . import words

RATES = (5.0, 5e3)  # plausible rates of logs [Hz]; other units of time are rejected (taste)
ALSO = "# Also"  # start of a line on a column that another one replaces
MOVED = "; nothing else is a command, so this is taken as what moved the joint"
TURNING = 7.0  # [rad], just above one turn; larger angles are taken as degrees (taste)
DEGREES = 360.0  # whole numbers beyond it are taken as counts of an encoder (taste)
ANGLES, UNREAD = ("q", "command_position"), ("dq", "tau")


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
        offset: Offset in the SI unit; empty where none is needed.
        missing: Texts in the column that are no reading.
        is_named: Whether the column says the name or number of the joint.
    """

    column: str
    role: str
    joint: str
    why: str
    unit: str = ""
    topic: str = ""
    scale: str = ""
    offset: str = ""
    missing: tuple[str, ...] = ()
    is_named: bool = True

    def also(self, why: str) -> Line:
        """The line with one more reason."""
        return replace(self, why=f"{self.why}; {why}")

    @property
    def text(self) -> str:
        """Line of the file."""
        topic = f"topic: {_quoted(self.topic)}, " if self.topic else ""
        unit = f", unit: {self.unit}" if self.unit else ""
        scale = f", scale: {self.scale}" if self.scale else ""
        scale += f", offset: {self.offset}" if self.offset else ""
        missing = f", missing: [{', '.join(map(_text, self.missing))}]" if self.missing else ""
        return (
            f"  - {{{topic}column: {_quoted(self.column)}, role: {self.role}, "
            f"joint: {_quoted(self.joint)}{unit}{scale}{missing}}}  # {self.why}"
        )


def of_table(table: tables.Table, joints: Sequence[str]) -> str:
    """Text of a mapping for the columns of a table.

    Args:
        table: Columns of a file.
        joints: Joint names of the robot; empty if the robot is not known.

    Raises:
        ParameterError: No column name contains a known role, or none a joint of the robot.
    """
    time, head = _time(table)
    value_columns = {name: values for name, values in table.columns.items() if name != time}
    for name, values_of in table.labels.items():
        if len(values_of) > 1 and set(values_of) <= set(joints):
            raise ParameterError(
                f"{table.path.name}: {name} names the joint of each row ({', '.join(values_of)}); "
                "write one row for each time, with columns for each joint such as "
                f"position.{values_of[0]}"
            )
    guesses = {name: words.guess(name, joints) for name in value_columns}
    measured = {guess.joint for guess in guesses.values() if guess.role == "q"}
    guesses |= {name: words.position(name, guess.joint) for name, guess in guesses.items()
                if not guess.role and guess.joint not in measured
                and words.is_joint_name(name, guess.joint)}  # fmt: skip
    guesses |= _in_order(guesses, joints)
    unread = [x for x, guess in guesses.items()
              if guess.role in UNREAD and not value_columns[x].any()]  # fmt: skip
    speed = any(guess.role == "dq" for x, guess in guesses.items() if x not in unread)
    turn = _counts([x for name, x in value_columns.items() if guesses[name].role in ANGLES])
    named = {number: values_of[0] for name, values_of in table.labels.items() if len(values_of) == 1
             if (number := words.number_of_name(name)) is not None}  # fmt: skip
    numbered = named or words.numbered(list(value_columns), joints)
    columns = {name: _column(table, name, guesses[name], joints, numbered, speed, turn)
               for name in value_columns if name not in unread}  # fmt: skip
    lines = [line for drafted in columns.values() for line in drafted]
    strangers = [x for x, drafted in columns.items() if not drafted and guesses[x].role]
    names = [*value_columns, *(name for name in table.texts if name != time)]
    return written(lines, names, joints, table.path.name, head, strangers)


def _in_order(guesses: Mapping[str, words.Guess], joints: Sequence[str]) -> dict[str, words.Guess]:
    """Guesses for names of which none names a joint: their subjects in the order of the joints.

    An example is a table with cart_pos and pole_angle of a robot with the joints rail and hinge.
    Empty unless there are as many subjects as joints, each with a position.
    """
    telling = {name: guess for name, guess in guesses.items() if guess.role}
    if any(guess.joint or any(map(str.isdigit, words.split_name(name)))
           for name, guess in telling.items()):  # fmt: skip
        return {}
    subjects = list(dict.fromkeys(words.subject(name) for name in telling))
    positions = {words.subject(name) for name, guess in telling.items() if guess.role == "q"}
    if len(joints) < 2 or len(subjects) != len(joints) or positions != set(subjects):
        return {}
    names = dict(zip(subjects, joints, strict=True))
    return {
        name: replace(guess, joint=names[words.subject(name)],
                      why=f"{guess.why}, by the order of the joints: in this order?")
        for name, guess in telling.items()
    }  # fmt: skip


def written(
    lines: Sequence[Line],
    names: Sequence[str],
    joints: Sequence[str],
    file: str,
    head: Sequence[str] = (),
    strangers: Sequence[str] = (),
) -> str:
    """Text of a mapping with one line for each role of a joint.

    Of several columns for a role the first is used, or the first that says its joint, that it is
    measured, or that needs no scale. If no line is a command, and each joint has but one position,
    measured torques are taken as the commands.

    Args:
        lines: Columns in the order of the file.
        names: All columns or topics of the file.
        joints: Joint names of the robot; empty if the robot is not known.
        file: Name of the file, for messages.
        head: Lines before the columns.
        strangers: Names that say a role, but no joint of the robot.

    Raises:
        ParameterError: There is no line.
    """
    first: dict[tuple[str, str], Line] = {}
    positions = _positions(lines)
    commanded = any(line.role.startswith("command_") for line in lines)
    if not commanded and len(positions) == len(set(positions)):
        lines = [replace(x, role="command_torque", why=x.why + MOVED) if x.role == "tau" else x
                 for x in lines]  # fmt: skip
    order = sorted(lines, key=lambda x: (not x.is_named, not _is_measured(x), bool(x.scale)))
    for line in order:
        first.setdefault((line.role, line.joint), line)
    used = [line for line in lines if first[line.role, line.joint] is line]
    robot = f" of the robot ({', '.join(joints)})" * bool(joints)
    unmatched = f"no joint{robot} is named in: {', '.join(strangers)}"
    if not first:
        note = unmatched if strangers else _unsaid(names)
        raise ParameterError(
            f"{file}: {note}. Write a mapping by hand (docs/gap_import.md), pass it by --mapping"
        )
    rest = [line for line in lines if line not in used]
    assigned = {line.column for line in lines} | {line.topic for line in lines}
    text = [f"# Drafted from {file}: look at each line, above all at joints, units and signs.",
            *head, "columns:", *(line.text for line in used)]  # fmt: skip
    text += [f"{ALSO} {line.role} of {line.joint}, left out; or a command? {line.text.strip(' -')}"
             for line in rest]  # fmt: skip
    left = [name for name in names if name not in assigned]
    text += [f"# Not used: {', '.join(left)}"] if left else []
    text += [f"# {unmatched[0].upper()}{unmatched[1:]}"] if strangers else []
    return "\n".join([*text, *(f"# Missing: {what}" for what in missing(first, joints))]) + "\n"


def _positions(lines: Sequence[Line]) -> list[str]:
    """Joint of each position; where a column says its joint, the others are not of that joint."""
    positions = [line for line in lines if line.role == "q"]
    named = {line.joint for line in positions if line.is_named}
    return [line.joint for line in positions if line.is_named or line.joint not in named]


def _unsaid(names: Sequence[str]) -> str:
    """Reason why nothing is known of columns that say no role."""
    if names and all(map(str.isdigit, names)):
        return (
            f"it has no line of names above its {len(names)} columns; add one, or name them by "
            "their numbers, as in {column: 2, role: q, joint: knee}"
        )
    return f"no name says what is measured or commanded; it has {', '.join(names) or 'nothing'}"


def _is_measured(line: Line) -> bool:
    """True if the name of a column says that it is measured."""
    return not words.MEASURED.isdisjoint(words.split_name(line.column))


def missing(lines: Mapping[tuple[str, str], Line], joints: Sequence[str]) -> list[str]:
    """Roles that a search needs and no line provides, in words."""
    required = joints or sorted({joint for _, joint in lines})
    absent = [f"q of {joint}" for joint in required if ("q", joint) not in lines]
    commanded = {joint for role, joint in lines if role.startswith("command_")}
    return absent + [f"a command of {joint}" for joint in required if joint not in commanded]


def _column(
    table: tables.Table,
    name: str,
    guess: words.Guess,
    joints: Sequence[str],
    numbered: Mapping[int, str],
    speed: bool,
    turn: int,
) -> list[Line]:
    joint, comment = guess.joint, guess.why
    number = words.number(name, joints)
    if number in numbered and not joint:
        joint = numbered[number]
        order = "named in its row" if (joint,) in table.labels.values() else "in this order?"
        comment += f", number {number} of the joints: {order}"
        if joints and joint not in joints:
            return []
    is_named = bool(joint)
    if not joint and len(joints) == 1:
        joint, comment = joints[0], f"{comment}, the only joint"
    if not guess.role or not joint:
        return []
    line = Line(name, guess.role, joint, comment, guess.unit, is_named=is_named)
    line = _with_unit(line, table.columns[name], speed, turn)
    absent = table.text_rows(name)
    for text, rows in absent.items():
        line = line.also(f"“{' '.join(text.split())}” in {len(rows)} rows: no reading?")
    return [replace(line, missing=tuple(absent))]


def _with_unit(line: Line, values: np.ndarray, speed: bool, turn: int) -> Line:
    """Line with the unit of a column, the scale that it needs, and the reason for it.

    Where velocities (`speed`) were measured, large angles may be turns: the velocities tell the
    unit when the recording is read. Whole numbers may be counts, `turn` of them a turn.
    """
    if line.unit:
        line = line.also(f"{line.unit} by its name")
        if units.dimension(line.unit) != "current":
            return line
        return replace(line, scale="1.0").also("scale: N·m per A, from the data sheet")
    finite = values[np.isfinite(values)]
    peak = float(np.max(np.abs(finite), initial=0.0))
    if line.role in ANGLES and turn and not np.any(finite % 1.0):
        middle = 0.0 <= np.min(finite, initial=turn) < turn / 2 < peak
        offset = "-pi" if middle else ""
        line = replace(line, unit="count", scale=f"2pi/{turn}", offset=offset)
        line = line.also(f"whole numbers up to {peak:.4g}: counts? See how many are a turn")
        return line.also("zero in the middle?") if middle else line
    if line.role in ANGLES and peak > TURNING and not speed:
        return replace(line, unit="deg").also(f"deg, as it reaches {peak:.4g}: rev, counts?")
    return line


def _counts(columns: Sequence[np.ndarray]) -> int:
    """Counts a turn of columns of angles, a power of two; 0 if their numbers may be degrees."""
    finite = (values[np.isfinite(values)] for values in columns)
    peaks = [np.max(np.abs(x), initial=0.0) for x in finite if not np.any(x % 1.0)]
    peak = max(peaks, default=0.0)
    return 1 << int(peak).bit_length() if peak > DEGREES else 0


def _time(table: tables.Table) -> tuple[str, list[str]]:
    """Name of the time column, empty if there is none, and its lines of the mapping.

    Of several columns, those that rise from row to row and that are times by their content are
    preferred.
    """
    candidates: list[tuple[bool, bool, str, list[str]]] = []
    for name, values in table.columns.items():
        is_clock = name in table.clocks
        unit, finite = "s" if is_clock else words.time_unit(name), values[np.isfinite(values)]
        if unit is None or len(finite) < 3 or np.mean(np.diff(finite) >= 0.0) < 0.9:
            continue
        step = float(np.median(np.diff(finite)))
        fits = [u for u in ("s", "ms", "us", "ns")
                if step > 0.0 and RATES[0] <= 1.0 / (step * units.factor(u)) <= RATES[1]]  # fmt: skip
        symbol = unit or (fits or ["s"])[0]
        rate = 1.0 / (step * units.factor(symbol)) if step > 0.0 else 0.0
        comment = f"rises by {step:.6g}, {rate:.4g} Hz" if rate else "does not rise in most rows"
        line = f"time: {{column: {_quoted(name)}, unit: {symbol}}}  # {comment}"
        candidates.append((step > 0.0, is_clock, name, [line]))
    if candidates:
        *_, name, lines = max(candidates, key=lambda entry: entry[:2])
        return name, lines
    msg = next((msg for name, msg in table.texts.items() if words.time_unit(name) is not None), "")
    msg = " ".join((msg or "no column of times").split())
    return "", [f"# time: {{rate: }}  # {msg}: add this line with the rate of the log in Hz"]


def _quoted(text: str) -> str:
    """Text in quotation marks where YAML would otherwise read it as another type."""
    simple = text.replace("_", "a").isalnum() and not text[:1].isdigit()
    reserved = text.lower() in ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
    return text if simple and not reserved else _text(text)


def _text(text: str) -> str:
    """Text in quotation marks for YAML."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
