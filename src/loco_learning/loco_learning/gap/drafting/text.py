# SPDX-License-Identifier: Apache-2.0
"""Text of a draft of ``mapping.yaml``, with what is left out and what is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from loco_control.exceptions import ParameterError

from .joints import Joints
from .lines import JOINT, Line
from .names import is_measured

ALSO = "# Also"  # start of a line on a column that another one replaces
MOVED = "; nothing else is a command, so this is taken as what moved the joint"


def written(
    lines: Sequence[Line],
    names: Sequence[str],
    joints: Joints,
    file: str,
    head: Sequence[str] = (),
    strangers: Sequence[str] = (),
    candidates: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> str:
    """Text of a mapping with one line for each role of a joint.

    Of several columns for a role the first is used, or the first that says its joint, that it is
    measured, or that needs no scale. If no line is a command, and each joint has but one position,
    measured torques are taken as the commands.

    Args:
        lines: Columns in the order of the file.
        names: All columns or topics of the file.
        joints: Joints of the robot.
        file: Name of the file, for messages.
        head: Lines before the columns.
        strangers: Names that say a role, but no joint of the robot.
        candidates: Names of columns that follow the position of a joint, by joint.

    Raises:
        ParameterError: There is no line.
    """
    first: dict[tuple[str, str], Line] = {}
    lines = _with_command(lines)
    order = sorted(lines, key=lambda x: (not x.is_named, not is_measured(x.column), bool(x.scale)))
    for line in order:
        first.setdefault((line.role, line.joint), line)
    used = [line for line in lines if first[line.role, line.joint] is line]
    robot = f" of the robot ({', '.join(joints.names)})" * bool(joints.names)
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
    needed = joints.names or sorted({x.joint for x in lines if x.key == JOINT})
    text += [f"# Missing: q of {j}" for j in needed if ("q", j) not in first]
    commanded = {joint for role, joint in first if role.startswith("command_")}
    text += _uncommanded([j for j in needed if j not in {*commanded, *joints.passive}], candidates)
    return "\n".join(text) + "\n"


def _uncommanded(joints: Sequence[str], candidates: Mapping[str, Sequence[str]]) -> list[str]:
    """Lines on joints without a command."""
    hint = {joint: f"if nothing drove it: undriven: [{joint}]" for joint in joints}
    hint |= {joint: f"{', '.join(candidates[joint])} follows its position: is it one?"
             for joint in joints if candidates.get(joint)}  # fmt: skip
    return [f"# Missing: a command of {joint}; {hint[joint]}" for joint in joints]


def _with_command(lines: Sequence[Line]) -> Sequence[Line]:
    """Lines with torques as commands if there is no other and each joint has but one position.

    Where a column says its joint, the others are not of that joint.
    """
    positions = [line for line in lines if line.role == "q"]
    named = {line.joint for line in positions if line.is_named}
    joints = [line.joint for line in positions if line.is_named or line.joint not in named]
    if len(joints) > len(set(joints)) or any(x.role.startswith("command_") for x in lines):
        return lines
    return [replace(x, role="command_torque", why=x.why + MOVED) if x.role == "tau" else x
            for x in lines]  # fmt: skip


def _unsaid(names: Sequence[str]) -> str:
    """Reason why nothing is known of columns that say no role."""
    if names and all(map(str.isdigit, names)):
        return (
            f"it has no line of names above its {len(names)} columns; add one, or name them by "
            "their numbers, as in {column: 2, role: q, joint: knee}"
        )
    return f"no name says what is measured or commanded; it has {', '.join(names) or 'nothing'}"
