# SPDX-License-Identifier: Apache-2.0
"""Draft of ``mapping.yaml`` with the reason for each line, for the user to correct."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
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
AMBIGUOUS = words.INPUTS | words.CONTROLS | {"qd"}  # words with two meanings
EVEN = 0.01  # largest difference between steps of a clock, over the step (taste)
FOLLOWING = 0.5  # deviation of a command from the position, over that of the position (taste)
UNEXPLAINED = 0.3  # unexplained share of a torque, below which it is that of a controller (taste)
MOTION_COMMANDS = ("command_position", "command_velocity")
JOINT = "joint"  # key of the place of most columns
ANGLES, UNREAD = ("q", "command_position"), ("dq", "tau")


@dataclass(frozen=True)
class Line:
    """A column of the draft.

    Attributes:
        column: Name of the column, or path of a field.
        role: Role of the values.
        joint: Joint of the values, or what else `key` says.
        why: Reason in words.
        unit: Unit; empty is the SI unit.
        topic: Topic in a bag.
        scale: Scale that the user has to fill in; empty where none is needed.
        offset: Offset in the SI unit; empty where none is needed.
        missing: Texts in the column that are no reading.
        is_named: Whether the column says the name or number of the joint.
        key: Key of the place, such as "joint" or "axis".
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
    key: str = JOINT

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
            f"{self.key}: {_quoted(self.joint)}{unit}{scale}{missing}}}  # {self.why}"
        )


def of_table(
    table: tables.Table,
    joints: Sequence[str],
    follows: Collection[str] = (),
    passive: Collection[str] = (),
) -> str:
    """Text of a mapping for the columns of a table.

    Args:
        table: Columns of a file.
        joints: Joint names of the robot; empty if the robot is not known.
        follows: Joints whose drives are known to follow positions or velocities.
        passive: Joints that are known to have no drive, and need no command.

    Raises:
        ParameterError: No column name contains a known role, or none a joint of the robot.
    """
    time, head = _time(table)
    value_columns = {name: values for name, values in table.columns.items() if name != time}
    for name, values_of in table.labels.items():
        if len(values_of) > 1 and set(values_of) <= set(joints):  # that do not take turns
            raise ParameterError(
                f"{table.path.name}: {name} names the joint of each row ({', '.join(values_of)}); "
                "write one row for each time, with columns for each joint such as "
                f"position.{values_of[0]}"
            )
    spelled = words.spelled_out(value_columns)
    guesses = _guesses(spelled, joints)
    unread = [x for x, guess in guesses.items()
              if guess.role in UNREAD and not np.nan_to_num(value_columns[x]).any()]  # fmt: skip
    speed = any(guess.role == "dq" for x, guess in guesses.items() if x not in unread)
    turn = _counts([x for name, x in value_columns.items() if guesses[name].role in ANGLES])
    by_number = _by_number(table, guesses, spelled, joints)
    joints_of = _candidates(guesses, joints, tuple(follows), passive)
    columns = {
        name: _column(table, name, guesses[name], joints_of[name],
                      by_number.get(name, ""), speed, turn)
        for name in value_columns if name not in unread
    }  # fmt: skip
    lines = [line for drafted in columns.values() for line in drafted]
    positions = {line.joint: table.columns[line.column] for line in reversed(lines)
                 if line.role == "q"}  # fmt: skip
    lines = [_by_values(line, table.columns[line.column], positions) for line in lines]
    lines, left_out = _one_command(lines, table.columns, follows)
    head += dict.fromkeys(left_out.values())
    candidates = {
        joint: [name for name, x in value_columns.items()
                if not columns.get(name) and not guesses[name].role and _follows(x, q)]
        for joint, q in positions.items()
    }  # fmt: skip
    strangers = [x for x, drafted in columns.items() if not drafted and guesses[x].role]
    names = [x for x in [*value_columns, *table.texts] if x != time and x not in left_out]
    return written(lines, names, joints, table.path.name, head, strangers, candidates, passive)


def _guesses(spelled: Mapping[str, str], joints: Sequence[str]) -> dict[str, words.Guess]:
    """Guess for each name, also by the other names.

    Args:
        spelled: Names, each with the text to read (`words.spelled_out`).
        joints: Joint names of the robot; empty if the robot is not known.
    """
    guesses = {name: words.guess(text, joints) for name, text in spelled.items()}
    commands = {words.stem(spelled[name]): guess.role for name, guess in guesses.items()
                if guess.role.startswith("command_")}  # fmt: skip
    read = {guess.joint for guess in guesses.values() if guess.role == "q"} - {""}
    guesses |= {name: words.measured(name, guess, commands[words.stem(name)])
                for name, guess in guesses.items() if not guess.role and _is_measured(name)
                and guess.joint not in read and words.stem(name) in commands}  # fmt: skip
    read = {guess.joint for guess in guesses.values() if guess.role == "q"}
    guesses |= {name: words.position(name, guess.joint) for name, guess in guesses.items()
                if not guess.role and guess.joint not in read
                and words.is_joint_name(name, guess.joint)}  # fmt: skip
    return guesses | _in_order(guesses, joints) | _rates(guesses, spelled)


def _rates(
    guesses: Mapping[str, words.Guess], spelled: Mapping[str, str]
) -> dict[str, words.Guess]:
    """Guesses for goals that say no quantity, of joints of which only velocities were measured."""
    rates = {words.subject(spelled[name]): guess for name, guess in guesses.items()
             if guess.role == "dq"}  # fmt: skip
    of_angles = {
        words.subject(spelled[name]) for name, guess in guesses.items() if guess.role == "q"
    }
    return {
        name: replace(guess, role="command_velocity", unit=rates[subject].unit,
                      why=f"{guess.why} beside a velocity")
        for name, guess in guesses.items()
        if guess.role == "command_position" and not words.says_quantity(spelled[name])
        and (subject := words.subject(spelled[name])) in rates.keys() - of_angles
    }  # fmt: skip


def _by_number(
    table: tables.Table,
    guesses: Mapping[str, words.Guess],
    spelled: Mapping[str, str],
    joints: Sequence[str],
) -> dict[str, str]:
    """Joint of each name that has the number of one, by name; arguments as for `_guesses`."""
    numbers = words.numbers(spelled.values(), joints)
    labels = {i: values[0] for name, values in table.labels.items()
              if len(values) == 1 and (i := words.number_of_name(name)) is not None}  # fmt: skip
    counted = [(guess.role, numbers[spelled[name]]) for name, guess in guesses.items()
               if guess.role and numbers[spelled[name]] is not None]  # fmt: skip
    angles = [i for role, i in counted if role == "q"] or [i for _, i in counted]
    of_number = labels or words.numbered(angles, joints)
    groups: dict[tuple[str, ...], list[str]] = {}  # names that differ in their number alone
    for name, text in spelled.items():
        template = tuple(w for w in words.split_name(text) if not w.isdigit())
        groups.setdefault(template, []).append(name)
    result = dict.fromkeys(spelled, "")
    for names in groups.values():  # counted from 0 beside joints that are named from 1
        indices = {numbers[spelled[name]] for name in names} - {None}
        joint_of = words.numbered(indices, joints) if indices - of_number.keys() else of_number
        joint_of = of_number if labels else joint_of
        result |= {name: joint_of.get(numbers[spelled[name]], "") for name in names}
    return result


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
    candidates: Mapping[str, Sequence[str]] | None = None,
    passive: Collection[str] = (),
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
        candidates: Names of columns that follow the position of a joint, by joint.
        passive: Joints that are known to have no drive, and need no command.

    Raises:
        ParameterError: There is no line.
    """
    first: dict[tuple[str, str], Line] = {}
    positions = _positions(lines)
    commanded = any(line.role.startswith("command_") for line in lines)
    if not commanded and len(positions) == len(set(positions)):
        lines = [replace(x, role="command_torque", why=x.why + MOVED) if x.role == "tau" else x
                 for x in lines]  # fmt: skip
    order = sorted(lines, key=lambda x: (not x.is_named, not _is_measured(x.column), bool(x.scale)))
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
    text += [_missing(role, joint, candidates or {}) for role, joint in
             missing(first, joints, passive)]  # fmt: skip
    return "\n".join(text) + "\n"


def _missing(role: str, joint: str, candidates: Mapping[str, Sequence[str]]) -> str:
    """Line on a role of a joint that no column has."""
    columns = ", ".join(candidates.get(joint, ()))
    hint = f"; if nothing drove it: undriven: [{joint}]"
    hint = f"; {columns} follows its position: is it one?" if columns else hint
    return f"# Missing: {role} of {joint}{hint * (role != 'q')}"


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


def _is_measured(name: str) -> bool:
    """True if the name of a column says that it is measured."""
    return not words.MEASURED.isdisjoint(words.split_name(name))


def _by_values(line: Line, values: np.ndarray, positions: Mapping[str, np.ndarray]) -> Line:
    """The line with the other role of an ambiguous name if its values follow the joint's position.

    An input may be a torque or the position that a drive is to reach, and ``qd`` a velocity or the
    desired position.
    """
    if line.role not in ("dq", "command_torque") or line.joint not in positions:
        return line
    if AMBIGUOUS.isdisjoint(words.split_name(line.column)) or not _follows(
        values, positions[line.joint]
    ):
        return line
    return replace(line, role="command_position").also("follows the position")


def _one_command(
    lines: Sequence[Line], columns: Mapping[str, np.ndarray], follows: Collection[str]
) -> tuple[list[Line], dict[str, str]]:
    """Lines without a second command of a joint, and a comment on each column that is left out.

    A log may have both the desired motion and the torque that a controller made of it. This is no
    torque beside that of a drive: either the drive is told it, or it is what the drive gave.
    """
    by_role = {(line.role, line.joint): columns[line.column] for line in reversed(lines)}
    result, notes = list(lines), dict[str, str]()
    votes: dict[tuple[str, ...], list[bool]] = {}  # joints whose columns are alike are told alike
    for line in lines:
        if line.role == "command_torque":
            votes.setdefault(_template(line), []).append(_is_total(line.joint, by_role))
    for line in lines:
        motion = [x for x in lines if x.joint == line.joint and x.role in MOTION_COMMANDS]
        if (
            line.role != "command_torque"
            or not motion
            or not 2 * sum(votes[_template(line)]) > len(votes[_template(line)])
        ):
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
    return (
        q is not None
        and desired is not None
        and _explained(torque, [desired - q, np.gradient(q), np.gradient(desired)])
    )


def _explained(values: np.ndarray, regressors: Sequence[np.ndarray]) -> bool:
    """True if values that change are a sum of multiples of others, and a constant."""
    columns = np.stack([*regressors, np.ones(len(values))], axis=1)
    rows = np.isfinite(columns).all(axis=1) & np.isfinite(values)
    deviation = np.std(values[rows]) if rows.any() else 0.0
    if not deviation:
        return False
    fit = columns[rows] @ np.linalg.lstsq(columns[rows], values[rows])[0]
    return bool(np.std(values[rows] - fit) < UNEXPLAINED * deviation)


def _follows(values: np.ndarray, q: np.ndarray) -> bool:
    """True if values are close to a position that moves, as those of a commanded position are."""
    both = np.isfinite(values) & np.isfinite(q)
    return bool(both.any() and np.std(values[both] - q[both]) < FOLLOWING * np.std(q[both]))


def missing(
    lines: Mapping[tuple[str, str], Line], joints: Sequence[str], passive: Collection[str] = ()
) -> list[tuple[str, str]]:
    """Roles that a search needs and no line provides, in words, each with its joint."""
    required = joints or sorted({line.joint for line in lines.values() if line.key == JOINT})
    commanded = {*passive, *(joint for role, joint in lines if role.startswith("command_"))}
    absent = [("q", joint) for joint in required if ("q", joint) not in lines]
    return absent + [("a command", joint) for joint in required if joint not in commanded]


def _candidates(
    guesses: Mapping[str, words.Guess],
    joints: Sequence[str],
    follows: Sequence[str],
    passive: Collection[str],
) -> dict[str, Sequence[str]]:
    """Joints that each column may be of: of commands and torques only those that have a drive.

    Of a single commanded motion it is the only joint that follows one.
    """
    motions = [name for name, guess in guesses.items() if guess.role in MOTION_COMMANDS]
    driven = [joint for joint in joints if joint not in passive] or joints
    follower = follows if len(motions) == len(follows) == 1 else driven
    return {
        name: follower if guess.role in MOTION_COMMANDS
        else driven if _is_of_drive(guess.role) else joints
        for name, guess in guesses.items()
    }  # fmt: skip


def _is_of_drive(role: str) -> bool:
    """True if only a joint with a drive has this role."""
    return role == "tau" or role.startswith("command_")


def _column(
    table: tables.Table,
    name: str,
    guess: words.Guess,
    joints: Sequence[str],
    by_number: str,
    speed: bool,
    turn: int,
) -> list[Line]:
    joint, comment = guess.joint, guess.why
    if by_number and not joint:
        joint = by_number
        order = "named in its row" if (joint,) in table.labels.values() else "in this order?"
        comment += f", by its number among the joints: {order}"
        if joints and joint not in joints:
            return []
    is_named = bool(joint)
    if not joint and len(joints) == 1:
        that = " that is driven" * _is_of_drive(guess.role)
        joint, comment = joints[0], f"{comment}, the only joint{that}"
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
    preferred. If no name is a time, a column that rises evenly, and does not count rows, is taken.
    """
    candidates: list[tuple[bool, bool, bool, str, list[str]]] = []
    for name, values in table.columns.items():
        is_clock = name in table.clocks
        unit, finite = "s" if is_clock else words.time_unit(name), values[np.isfinite(values)]
        is_named = unit is not None
        if len(finite) < 3 or np.mean(np.diff(finite) >= 0.0) < 0.9:
            continue
        if not is_named and (words.counts(name) or not _rises_evenly(finite)):
            continue
        step = float(np.median(np.diff(finite)))
        fits = [
            u for u in ("s", "ms", "us", "ns")
            if step > 0.0 and RATES[0] <= 1.0 / (step * units.factor(u)) <= RATES[1]
        ]  # fmt: skip
        if not is_named and not fits:
            continue
        symbol = unit or (fits or ["s"])[0]
        rate = 1.0 / (step * units.factor(symbol)) if step > 0.0 else 0.0
        comment = f"rises by {step:.6g}, {rate:.4g} Hz" if rate else "does not rise in most rows"
        counts = not unit and np.all(np.diff(finite) == 1.0)
        comment += "; or a count of rows? Then say the rate: time: {rate: }" * bool(counts)
        comment += "" if is_named else ", and no name is a time: this?"
        line = f"time: {{column: {_quoted(name)}, unit: {symbol}}}  # {comment}"
        candidates.append((is_named, step > 0.0, is_clock, name, [line]))
    if candidates:
        *_, name, lines = max(candidates, key=lambda entry: entry[:3])
        return name, lines
    msg = next((msg for name, msg in table.texts.items() if words.time_unit(name) is not None), "")
    msg = " ".join((msg or "no column of times").split())
    return "", [f"# time: {{rate: }}  # {msg}: add this line with the rate of the log in Hz"]


def _rises_evenly(values: np.ndarray) -> bool:
    """True if values rise by the same step from row to row, but not by 1 as a counter does."""
    steps = np.diff(values)
    return steps.min() > 0.0 and np.ptp(steps) < EVEN * steps.max() and abs(steps[0] - 1.0) > EVEN


def _quoted(text: str) -> str:
    """Text in quotation marks where YAML would otherwise read it as another type."""
    simple = text.replace("_", "a").isalnum() and not text[:1].isdigit()
    reserved = text.lower() in ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
    return text if simple and not reserved else _text(text)


def _text(text: str) -> str:
    """Text in quotation marks for YAML."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
