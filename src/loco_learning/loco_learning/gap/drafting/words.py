# SPDX-License-Identifier: Apache-2.0
"""Words in names of columns and topics, and the role, unit and joint that they suggest."""

from __future__ import annotations

import functools
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
FEEDS = frozenset(("ff", "feedforward"))  # commands too; torques without another word
CONTROLS = frozenset(("ctrl",))  # as inputs, where no other word says what they are
DESIRED = frozenset("d r c".split())  # desired, of the column whose name lacks this letter
# Of a loop, a drive or a tool, and neither a command nor a motion of a joint.
SETTINGS = frozenset(
    "error errors err diff kp ki kd gain gains mode temp temperature "
    "acc accel acceleration accelerations qdd ddq qddot ddtheta qacc jerk "
    "tcp ee eef endeffector cartesian wrench flange".split()
)
MEASURED = frozenset(
    "meas measured actual act state states feedback fbk fb present observation ist istwert".split()
)
QUANTITIES = {
    "position": "pos position positions angle angles q qpos encoder enc winkel weg "
    "theta phi alpha beta gamma psi length stroke",
    "velocity": "vel velo velocity velocities dq qd qdot qvel thetadot dtheta speed speeds omega "
    "drehzahl geschwindigkeit geschw",
    "torque": "tau torque torques effort efforts trq tq force forces load moment moments kraft "
    "drehmoment",
    "current": "current currents cur amps strom iq",
}
LETTER_OF = {"p": "position", "v": "velocity"}  # in small letters, as in knee.p and knee.v_des
ROLES = {"position": "q", "velocity": "dq", "torque": "tau", "current": "tau"}
UNITS = {
    token: units.unit(token)
    for token in "deg degree degrees rad radian rads rev revs turns mm rpm rps dps degps radps nm "
    "mnm ma amp".split()
}
# Units that are of one quantity alone, also where no word says that a column is measured.
TELLING = frozenset("rpm dps degps radps rps nm mnm".split())
IN_BRACKETS = {"turn": "rev", "turn/s": "rev/s"}  # units there, and words elsewhere
TIMES = dict.fromkeys("t ts time zeit timestamp stamp times clock tick tout".split(), "") | {
    token: units.unit(token)
    for token in "s sec secs seconds ms us ns nsec msec usec millis millisec milliseconds micros "
    "microseconds".split()
}
COUNTERS = frozenset("row rows sample samples index idx i n seq count counter step frame".split())
NOISE = frozenset(
    "j joint joints topic field data value values dof motor axis achse header robot the of".split()
    + ["name", "names"]
)
OTHER_SENSORS = frozenset(  # of the base, the feet and their sensors, whose numbers are no joints
    "imu base trunk torso body quat quaternion foot feet contact gyro acc accel".split()
)
LETTERS = frozenset("a j m".split())  # of axis, joint and motor, before a number
_OF_WORD = {token: kind for kind, text in QUANTITIES.items() for token in text.split()}
VOCABULARY = frozenset(
    {*COMMANDS, *SETS, *INPUTS, *FEEDS, *CONTROLS, *MEASURED, *UNITS, *NOISE, *_OF_WORD, "s", "m"}
)
# Ends of words that are written together, such as motorpos and Blattwinkel.
_ENDS = re.compile(
    r"(.{2,})(pos|position|angle|winkel|vel|velocity|speed|drehzahl|geschwindigkeit|geschw|torque|"
    r"moment|kraft|current|strom)"
)
_ACCELERATION = re.compile(  # a unit of acceleration in a name, such as rad_s2
    r"(?:rad|deg|m)(?:[/_ .]|p(?:er)?)s(?:ec)?(?:\^|\*\*)?[2²]|/s/s", re.IGNORECASE
)
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
    """Words of a name in lower case: arm, knee, q, des, deg for ``/arm/kneeQdes_deg``."""
    return [part for token in _SPLIT.findall(name) for part in _parts(token.lower())]


@functools.cache
def _parts(token: str) -> tuple[str, ...]:
    """The two words of which a word consists, as ist and position, or knee and pos; else the word.

    Both are known, or the second is a quantity.
    """
    for i in range(1, len(token) - 1):
        if (
            token not in VOCABULARY
            and {token[:i], token[i:]} <= VOCABULARY
            and token[:i] not in "sm"
        ):
            return token[:i], token[i:]
    match = None if token in VOCABULARY else _ENDS.fullmatch(token)
    return match.groups() if match else (token,)


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
    of = next(filter(_OF_WORD.__contains__, reversed(rest)), "")
    if not of and (joint or joints):
        of = _letter(name, unknown)
        unknown = _without(unknown, [of] * bool(of))
    amperes = _amperes(name, rest, unknown) * bool(joints) * (not of)
    unknown = _without(unknown, amperes)
    is_explained = of or not (joint or joints) or all(map(str.isdigit, unknown))
    commanded = next(filter(_commands(of, is_explained).__contains__, rest), "")
    marker = commanded or next(filter(_markers(is_explained).__contains__, rest), "")
    kinds = {**LETTER_OF, **_OF_WORD, "": "current" * bool(amperes)}
    kind = kinds.get(of) or _kind_of_unit(name, marker)
    if not kind or not SETTINGS.isdisjoint(rest) or _ACCELERATION.search(name):
        return Guess("", "", joint, "")
    role = f"command_{'torque' if kind == 'current' else kind}" if commanded else ROLES[kind]
    unit = _unit(name, role) or ("A" if kind == "current" else "")
    if not joint and not joints:
        joint = "_".join(unknown)
    why = " and ".join(f"“{w}”" for w in (commanded, of, *amperes) if w)
    return Guess(role, unit, joint, why or f"“{marker}”")


def _letter(name: str, unknown: Sequence[str]) -> str:
    """Letter of a quantity in a name of which all other words are known; empty if there is none."""
    letters = [w for w in unknown if not w.isdigit()]
    is_one = len(letters) == 1 and letters[0] in LETTER_OF and letters[0] in _SPLIT.findall(name)
    return letters[0] if is_one else ""


def _amperes(name: str, rest: Sequence[str], unknown: Sequence[str]) -> list[str]:
    """Letters that say a current: i of a command, and A at the end, as in ``yaw_i_cmd_A``."""
    unit = ["a"] if "a" in unknown and re.search(r"[_. \[(]A[\])]?$", name) else []
    letter = ["i"] if "i" in unknown and (unit or not COMMANDS.isdisjoint(rest)) else []
    return letter + unit


def _markers(is_explained: bool) -> frozenset[str]:
    """Words beside which a unit tells the quantity of a column that is no command."""
    return MEASURED | (TELLING if is_explained else frozenset())


def _commands(of: str, is_explained: bool) -> frozenset[str]:
    """Words that say a command in a name with a word of a quantity, or with no unknown words."""
    return (
        COMMANDS
        | FEEDS
        | (frozenset() if of else CONTROLS)
        | (SETS | INPUTS if is_explained else set())
    )


def spelled_out(names: Iterable[str]) -> dict[str, str]:
    """Names with ``des`` for the letter of desired values: q_des for q_d.

    Beside a column q, or of the letter d if all other words are known, as of ``tau_J_d``.
    """
    names = list(names)
    tokens, result = {tuple(split_name(name)) for name in names}, {}
    for name in names:
        result[name] = name
        for match in _SPLIT.finditer(name):
            before, after = name[: match.start()], name[match.end() :]
            rest = (*split_name(before), *split_name(after))
            is_quantity = not _OF_WORD.keys().isdisjoint(rest) and VOCABULARY.issuperset(
                w for w in rest if not w.isdigit()
            )
            if match[0] in DESIRED and (rest in tokens or is_quantity and match[0] == "d"):
                result[name] = f"{before}des{after}"
    return result


def stem(name: str) -> tuple[str, ...]:
    """Words of a name without those that say whether it is commanded or measured."""
    return tuple(w for w in split_name(name) if w not in COMMANDS | SETS | MEASURED)


def says_quantity(name: str) -> bool:
    """True if a name has a word or a unit of a quantity."""
    return not (_OF_WORD.keys() | UNITS.keys()).isdisjoint(split_name(name))


def measured(name: str, guess: Guess, command: str) -> Guess:
    """Guess for the measured value of a command: A1_act beside A1_cmd.

    Args:
        name: Name of the column.
        guess: Guess for this column, without a role.
        command: Role of the command with the same `stem`.
    """
    role = ROLES[command.removeprefix("command_")]
    marker = next(filter(MEASURED.__contains__, split_name(name)))
    return Guess(role, _unit(name, role), guess.joint, f"“{marker}” beside its command")


def position(name: str, joint: str) -> Guess:
    """Guess for a column that says a joint and no quantity."""
    return Guess("q", _unit(name, "q"), joint, "the name of a joint alone: its position?")


def _kind_of_unit(name: str, marker: str) -> str:
    """Quantity that the unit in a name tells, such as position for ``actual [mm]``; "" if none.

    Args:
        name: Name without a word of a quantity.
        marker: Word of the name for a command or a measurement; "" if it has none, and then its
            unit tells nothing. A command without a unit is a position, or a torque if it is an
            input or is fed forward.
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
    return "torque" if marker in INPUTS | CONTROLS | FEEDS else "position"


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
    suffix = next((x for x in re.split(r"[\s_.\[\]]+", name)[::-1] if x.strip("0123456789")), "")
    candidates = re.findall(r"[\[(]([^\])]*[^\d\])][^\])]*)[\])]", name)
    candidates = [IN_BRACKETS.get(text, text) for text in candidates]
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
    explained = {*VOCABULARY, *digits, *(token for joint in joints for token in split_name(joint))}
    explained |= {a for a, b in itertools.pairwise(tokens) if a in LETTERS and b.isdigit()}
    return int(digits[0]) if len(digits) == 1 and explained.issuperset(tokens) else None


def numbers(names: Iterable[str], joints: Sequence[str]) -> dict[str, int | None]:
    """Number of a joint in each name; None without one.

    Names that differ in one number alone, as many as the robot has joints, number these whatever
    else they say: axis0.encoder.pos_estimate and axis1.encoder.pos_estimate of two joints.
    """
    result = {name: number(name, joints) for name in names}
    groups: dict[tuple, dict[str, int]] = {}
    for name in result:
        tokens = split_name(name)
        digits = [token for token in tokens if token.isdigit()]
        if len(digits) == 1 and OTHER_SENSORS.isdisjoint(tokens):
            template = tuple(None if token.isdigit() else token for token in tokens)
            groups.setdefault(template, {})[name] = int(digits[0])
    for group in groups.values():
        if len(set(group.values())) >= max(len(joints), 2) and joints:
            result |= {name: i for name, i in group.items() if result[name] is None}
    return result


def number_of_name(name: str) -> int | None:
    """Number in the name of a column of names, such as name0 or joint_names[3]; None of others."""
    is_name = not {"name", "names"}.isdisjoint(split_name(name))
    return number(name) if is_name else None


def numbered(numbers: Iterable[int], joints: Sequence[str]) -> dict[int, str]:
    """Joint of each number in the names of columns.

    It is the joint with this number in its name if there is one for each number; of several groups
    such as arm and fingers, the largest is meant. Else the joints are counted in their order, from
    0 or from 1. Without joints, they are named by the numbers.

    Args:
        numbers: Numbers in the names of columns.
        joints: Joint names of the robot; empty if the robot is not known.
    """
    numbers = set(numbers)
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


def counts(name: str) -> bool:
    """True if a name is a number, or says that the column counts rows."""
    return name.isdigit() or not COUNTERS.isdisjoint(split_name(name))


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
