# SPDX-License-Identifier: Apache-2.0
"""Words in names of columns and topics, and the role, unit and joint that they suggest."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

COMMANDS = frozenset(
    "cmd cmds command commands commanded target targets goal goals desired des ref reference "
    "setpoint setpoints sp action actions demand demanded".split()
)
MEASURED = frozenset("meas measured actual act state states feedback fb present observation".split())
QUANTITIES = {
    "position": "pos position positions angle angles q theta phi encoder enc",
    "velocity": "vel velocity velocities dq qd qdot speed speeds omega",
    "torque": "tau torque torques effort efforts trq force forces load",
    "current": "current currents cur amps",
}
ROLES = {"position": "q", "velocity": "dq", "torque": "tau", "current": "tau"}
UNITS = {
    "deg": "deg", "degree": "deg", "degrees": "deg", "rad": "rad", "radian": "rad", "mm": "mm",
    "rpm": "rpm", "dps": "deg/s", "nm": "N m", "mnm": "mN m", "ma": "mA", "amp": "A",
}  # fmt: skip
TIMES = {
    "t": "", "time": "", "timestamp": "", "stamp": "", "times": "", "clock": "", "s": "s",
    "sec": "s", "secs": "s", "seconds": "s", "ms": "ms", "us": "us", "ns": "ns", "nsec": "ns",
}  # fmt: skip
NOISE = frozenset("joint joints topic data value values dof motor name header robot the of".split())
_OF_WORD = {word: kind for kind, text in QUANTITIES.items() for word in text.split()}
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


def words(name: str) -> list[str]:
    """Words of a name in lower case: arm, knee, pos, deg for ``/arm/kneePos_deg``."""
    return [token.lower() for token in _SPLIT.findall(name)]


def guess(name: str, joints: Sequence[str] = ()) -> Guess:
    """Role, unit and joint that a name suggests.

    Args:
        name: Name of a column, with its topic.
        joints: Joint names of the robot; if empty, unexplained words of the name are the joint.
    """
    joint = joint_in(name, joints)
    joint_tokens = words(joint) if joint else []
    rest = _without(words(name), joint_tokens)
    commanded = next((w for w in rest if w in COMMANDS), "")
    of = next((w for w in reversed(rest) if w in _OF_WORD), "")
    unit = next((UNITS[w] for w in rest if w in UNITS), "")
    kind = _OF_WORD.get(of, "position" if commanded else "")
    if not kind:
        return Guess("", unit, joint, "")
    role = f"command_{'torque' if kind == 'current' else kind}" if commanded else ROLES[kind]
    unit = unit or ("A" if kind == "current" else "")
    if not joint and not joints:
        vocabulary = {commanded, of, *COMMANDS, *MEASURED, *UNITS, *NOISE, *_OF_WORD}
        joint = "_".join(token for token in rest if token not in vocabulary)
    return Guess(role, unit, joint, " and ".join(f"“{w}”" for w in (commanded, of) if w))


def joint_in(name: str, joints: Sequence[str]) -> str:
    """Joint whose words are all in a name, the longest of several; empty if there is none."""
    tokens = words(name)
    fitting = [j for j in joints if words(j) and _contains(tokens, words(j))]
    return max(fitting, key=lambda joint: len(words(joint)), default="")


def time_unit(name: str) -> str | None:
    """Unit of time in a name; empty if the name is a time without a unit, None if it is no time."""
    symbols = [TIMES.get(token) for token in words(name)]
    if not symbols or None in symbols[-1:]:
        return None
    return next((unit for unit in symbols if unit), "")


def _contains(whole: Sequence[str], part: Sequence[str]) -> bool:
    size = len(part)
    return any(list(whole[i : i + size]) == list(part) for i in range(len(whole) - size + 1))


def _without(whole: Iterable[str], part: Sequence[str]) -> list[str]:
    left = list(whole)
    for token in part:
        left.remove(token)
    return left
