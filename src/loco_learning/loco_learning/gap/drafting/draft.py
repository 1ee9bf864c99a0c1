# SPDX-License-Identifier: Apache-2.0
"""Draft of ``mapping.yaml`` for the columns of a table, with the reason for each line."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from loco_control.exceptions import ParameterError

from ..importing import tables
from . import values, words
from .clock import time_column
from .joints import Joints
from .lines import Line
from .names import by_number, guesses
from .text import written

UNREAD = ("dq", "tau")  # columns of zeros with these roles were not read


def of_table(table: tables.Table, joints: Joints) -> str:
    """Text of a mapping for the columns of a table.

    Raises:
        ParameterError: No column name contains a known role, or none a joint of the robot.
    """
    time, dt, head = time_column(table)
    value_columns = {name: x for name, x in table.columns.items() if name != time}
    for name, values_of in table.labels.items():
        if len(values_of) > 1 and set(values_of) <= set(joints.names):  # that do not take turns
            raise ParameterError(
                f"{table.path.name}: {name} names the joint of each row ({', '.join(values_of)}); "
                "write one row for each time, with columns for each joint such as "
                f"position.{values_of[0]}"
            )
    spelled = words.spelled_out(value_columns)
    guess_of = guesses(spelled, joints.names)
    number_of = by_number(guess_of, spelled, table.labels, joints.names)
    joints_of = _candidates(guess_of, joints)
    read = {name: x for name, x in value_columns.items()
            if guess_of[name].role not in UNREAD or np.nan_to_num(x).any()}  # fmt: skip
    angles = [x for name, x in read.items() if guess_of[name].role in values.ANGLES]
    speed = any(guess_of[name].role == "dq" for name in read)
    sizes = values.Sizes(speed, values.counts_a_turn(angles), joints.endless, dt)
    columns = {
        name: _column(table, name, guess_of[name], joints_of[name], number_of.get(name, ""), sizes)
        for name in read
    }
    lines = [line for line in columns.values() if line]
    positions = {line.joint: table.columns[line.column] for line in reversed(lines)
                 if line.role == "q"}  # fmt: skip
    lines = [values.by_values(line, table.columns[line.column], positions) for line in lines]
    lines, left_out = values.one_command(lines, table.columns, joints.follows)
    head += dict.fromkeys(left_out.values())
    candidates = {
        joint: [name for name, x in value_columns.items()
                if not columns.get(name) and not guess_of[name].role and values.is_close(x, q)]
        for joint, q in positions.items()
    }  # fmt: skip
    strangers = [name for name, line in columns.items() if not line and guess_of[name].role]
    names = [x for x in [*value_columns, *table.texts] if x != time and x not in left_out]
    return written(lines, names, joints, table.path.name, head, strangers, candidates)


def _candidates(guess_of: Mapping[str, words.Guess], joints: Joints) -> dict[str, Sequence[str]]:
    """Joints that each column may be of: of commands and torques only those that have a drive.

    Of a single commanded motion it is the only joint that follows one.
    """
    motions = [name for name, guess in guess_of.items() if guess.role in values.MOTION_COMMANDS]
    driven = [joint for joint in joints.names if joint not in joints.passive] or joints.names
    follower = joints.follows if len(motions) == len(joints.follows) == 1 else driven
    return {
        name: follower if guess.role in values.MOTION_COMMANDS
        else driven if _is_of_drive(guess.role) else joints.names
        for name, guess in guess_of.items()
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
    sizes: values.Sizes,
) -> Line | None:
    """Line of a column; None if it has no role, or is of none of the joints.

    Args:
        table: Columns of a file.
        name: Name of the column.
        guess: Meaning of this name.
        joints: Joints that it may be of; empty if the robot is not known.
        by_number: Joint that has the number in the name; empty without one.
        sizes: Properties that tell its unit.
    """
    joint, comment = guess.joint, guess.why
    if by_number and not joint:
        joint = by_number
        order = "named in its row" if (joint,) in table.labels.values() else "in this order?"
        comment += f", by its number among the joints: {order}"
        if joints and joint not in joints:
            return None
    is_named = bool(joint)
    if not joint and len(joints) == 1:
        that = " that is driven" * _is_of_drive(guess.role)
        joint, comment = joints[0], f"{comment}, the only joint{that}"
    if not guess.role or not joint:
        return None
    line = Line(name, guess.role, joint, comment, guess.unit, is_named=is_named)
    line = sizes.with_unit(line, table.columns[name])
    absent = table.text_rows(name)
    for text, rows in absent.items():
        line = line.also(f"“{' '.join(text.split())}” in {len(rows)} rows: no reading?")
    return replace(line, missing=tuple(absent))
