# SPDX-License-Identifier: Apache-2.0
"""Words in names of columns and topics, and the role, unit and joint that they suggest."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from loco_control.exceptions import NameUnknownError

from ..recordings import mapping, units

COMMANDS = frozenset(
    "cmd cmds command commands commanded target targets goal goals desired des ref reference "
    "setpoint setpoints sp action actions demand demanded soll sollwert".split()
)
# Commands only if the other words of a name are known; the second are torques without another word.
SETS, INPUTS = frozenset(("set",)), frozenset(("u", "input", "inputs"))
MEASURED = frozenset(
    "meas measured actual act state states feedback fbk fb present observation ist istwert".split()
)
QUANTITIES = {
    "position": "pos position positions angle angles q qpos encoder enc winkel weg "
    "theta phi alpha beta gamma psi",
    "velocity": "vel velocity velocities dq qd qdot qvel speed speeds omega drehzahl",
    "torque": "tau torque torques effort efforts trq force forces load moment moments kraft",
    "current": "current currents cur amps strom iq",
}
ROLES = {"position": "q", "velocity": "dq", "torque": "tau", "current": "tau"}
UNITS = {
    "deg": "deg", "degree": "deg", "degrees": "deg", "rad": "rad", "radian": "rad", "mm": "mm",
    "rpm": "rpm", "dps": "deg/s", "nm": "N m", "mnm": "mN m", "ma": "mA", "amp": "A", "rads": "rad",
}  # fmt: skip
TIMES = {
    "t": "", "ts": "", "time": "", "zeit": "", "timestamp": "", "stamp": "", "times": "", "clock": "",
    "s": "s", "sec": "s", "secs": "s", "seconds": "s",
    "ms": "ms", "us": "us", "ns": "ns", "nsec": "ns", "msec": "ms", "usec": "us",
    "millis": "ms", "millisec": "ms", "milliseconds": "ms", "micros": "us", "microseconds": "us",
}  # fmt: skip
NOISE = frozenset(
    "joint joints topic field data value values dof motor axis achse header robot the of".split()
    + ["name", "names"]
)
LETTERS = frozenset("a j m".split())  # of axis, joint and motor, before a number
_OF_WORD = {token: kind for kind, text in QUANTITIES.items() for token in text.split()}
VOCABULARY = frozenset({*COMMANDS, *SETS, *INPUTS, *MEASURED, *UNITS, *NOISE, *_OF_WORD, "s", "m"})
_SPLIT = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")


@dataclass(frozen=True)
class Guess:
    """Meaning of a column name.

    Attributes:
        role: Role in a mapping; empty if the name suggests none.
        unit: Unit in the name; empty if there is none.
        joint: Joint whose name it contains, else the unexplained words of the name.
        why: Words of the name that led to the role.
    """

    role: str
    unit: str
    joint: str
    why: str


def split_name(name: str) -> list[str]:
    """Words of a name in lower case: arm, knee, pos, deg for ``/arm/kneePos_deg``."""
    return [token.lower() for token in _SPLIT.findall(name)]


def guess(name: str, joints: Sequence[str] = ()) -> Guess:
    """Role, unit and joint that a name suggests.

    Args:
        name: Name of a column, with its topic.
        joints: Joint names of the robot; if empty, unexplained words of the name are the joint.
    """
    joint = joint_in(name, joints)
    joint_tokens = [w for w in split_name(joint) if w in split_name(name)]
    rest = _without(split_name(name), joint_tokens) or split_name(name)
    unknown = [token for token in rest if token not in VOCABULARY]
    of = next((w for w in reversed(rest) if w in _OF_WORD), "")
    legal = COMMANDS
    if of or not [token for token in unknown if not token.isdigit()] or not (joint or joints):
        legal = legal | SETS | INPUTS
    commanded = next((w for w in rest if w in legal), "")
    marker = commanded or next(filter(MEASURED.__contains__, rest), "")
    kind = _OF_WORD.get(of) or _kind_of_unit(name, marker)
    if not kind:
        return Guess("", "", joint, "")
    role = f"command_{'torque' if kind == 'current' else kind}" if commanded else ROLES[kind]
    unit = _unit(name, role) or ("A" if kind == "current" else "")
    if not joint and not joints:
        joint = "_".join(unknown)
    why = " and ".join(f"“{w}”" for w in (commanded, of) if w)
    return Guess(role, unit, joint, why or f"“{marker}”")


def position(name: str, joint: str) -> Guess:
    """Guess for a column that says a joint and no quantity."""
    return Guess("q", _unit(name, "q"), joint, "the name of a joint alone: its position?")


def _kind_of_unit(name: str, marker: str) -> str:
    """Quantity that the unit in a name tells, such as position for ``actual [mm]``; "" if none.

    Args:
        name: Name without a word of a quantity.
        marker: Word of the name for a command or a measurement; "" if it has none, and then its unit
            tells nothing. A command without a unit is a position, or a torque if it is an input.
    """
    for text in _units_in(name) if marker else ():
        try:
            dimension = units.dimension(text)
        except NameUnknownError:
            continue
        names = [kind for kind, role in ROLES.items() if dimension in mapping.ROLES[role][0]]
        if names or dimension == "current":
            return next(iter(names), "current")
    if not marker or marker in MEASURED:
        return ""
    return "torque" if marker in INPUTS else "position"


def _unit(name: str, role: str) -> str:
    """Unit in a name that fits a role: in brackets, at its end, or as a word; empty if none."""
    legal = (*mapping.ROLES[role][0], *(["current"] if "torque" in mapping.ROLES[role][0] else []))
    for text in _units_in(name):
        for spelled in (text, f"{text}/s"):
            try:
                if units.dimension(spelled) in legal:
                    return units.unit(spelled)
            except NameUnknownError:
                continue
    return ""


def _units_in(name: str) -> list[str]:
    """Texts in a name that may be a unit: in brackets, at its end, or as a word."""
    suffix = re.split(r"[\s_.]", name)[-1]
    candidates = re.findall(r"[\[(]([^\])]*[^\d\])][^\])]*)[\])]", name)
    candidates += [suffix] if len(suffix) > 1 else []
    return candidates + [UNITS[token] for token in split_name(name) if token in UNITS]


def joint_in(name: str, joints: Sequence[str]) -> str:
    """Joint whose words are all in a name, the longest of several.

    Otherwise the only joint that has a word of the name that no other joint has: hip_flexion for
    hip_pos, x_axis for x_enc. Empty if there is none.
    """
    tokens = split_name(name)
    fitting = [j for j in joints if split_name(j) and _contains(tokens, split_name(j))]
    if fitting:
        return max(fitting, key=lambda joint: len(split_name(joint)))
    vocabularies = [{w for w in split_name(j) if not w.isdigit()} - VOCABULARY for j in joints]
    common = {w for a, b in itertools.combinations(vocabularies, 2) for w in a & b}
    pairs = zip(joints, vocabularies, strict=True)
    candidates = [j for j, tokens_of in pairs if (tokens_of - common) & set(tokens)]
    return candidates[0] if len(candidates) == 1 else ""


def is_joint_name(name: str, joint: str) -> bool:
    """True if a name has no other words than those of its joint, a unit, and "measured"."""
    explained = {*MEASURED, *UNITS, *NOISE, *split_name(joint)}
    return bool(joint) and explained.issuperset(split_name(name))


def subject(name: str) -> tuple[str, ...]:
    """Words of a name that say neither a role nor a unit: pole for pole_angle_deg."""
    return tuple(w for w in split_name(name) if w not in VOCABULARY)


def number(name: str, joints: Sequence[str] = ()) -> int | None:
    """Number of a joint in a name such as q1, dq_2 or effort[3]; None if it has another word."""
    tokens = split_name(name)
    digits = [token for token in tokens if token.isdigit()]
    explained = {*COMMANDS, *SETS, *INPUTS, *MEASURED, *UNITS, *NOISE, *_OF_WORD, *digits, "s"}
    explained |= {token for joint in joints for token in split_name(joint)}
    explained |= {a for a, b in itertools.pairwise(tokens) if a in LETTERS and b.isdigit()}
    return int(digits[0]) if len(digits) == 1 and explained.issuperset(tokens) else None


def number_of_name(name: str) -> int | None:
    """Number in the name of a column of names, such as name0 or joint_names[3]; None of others."""
    is_name = not {"name", "names"}.isdisjoint(split_name(name))
    return number(name) if is_name else None


def numbered(names: Sequence[str], joints: Sequence[str]) -> dict[int, str]:
    """Joint of each number in the names of columns.

    It is the joint with this number in its name if there is one for each number; of several groups
    such as arm and fingers, the largest is meant. Else the joints are counted in their order, from
    0 or from 1. Without joints, they are named by the numbers.

    Args:
        names: Names of all columns.
        joints: Joint names of the robot; empty if the robot is not known.
    """
    numbers = {i for name in names if guess(name, joints).role
             if (i := number(name, joints)) is not None}  # fmt: skip
    if not joints:
        return {i: f"joint_{i}" for i in numbers}
    groups: dict[tuple[str, ...], dict[int, str]] = {}  # by the words before the number
    for joint in joints:
        *prefix, last = split_name(joint) or [""]
        if last.isdigit():
            groups.setdefault(tuple(prefix), {})[int(last)] = joint
    if groups and numbers <= set(largest := max(groups.values(), key=len)):
        return largest
    first = min(numbers, default=0)
    return dict(enumerate(joints, first)) if first in (0, 1) else {}


def time_unit(name: str) -> str | None:
    """Unit of time in a name; empty if the name is a time without a unit, None if it is no time."""
    symbols = [TIMES.get(token) for token in split_name(name)]
    if not symbols or None in symbols[-1:]:
        return None
    return next((unit for unit in symbols if unit), "")


def _contains(sequence: Sequence[str], part: Sequence[str]) -> bool:
    size = len(part)
    return any(list(sequence[i : i + size]) == list(part) for i in range(len(sequence) - size + 1))


def _without(sequence: Iterable[str], part: Sequence[str]) -> list[str]:
    left = list(sequence)
    for token in part:
        left.remove(token)
    return left
