# SPDX-License-Identifier: Apache-2.0
"""Nominal values of a robot that are not known well and are refitted with every candidate."""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

SECTIONS = ("drives", "springs", "masses")


def values(robot: Robot, names: Sequence[str]) -> dict[str, float]:
    """Nominal values before any fit.

    Args:
        robot: The robot as it came.
        names: Names of overrides of ``robot.yaml``: ``masses.<link>``,
            ``drives.<joint>.<parameter>`` or ``springs.<joint>.<parameter>``; a pattern gives
            all that it matches one value.

    Raises:
        NameUnknownError: There is no such value.
        ParameterError: A value is not above 0, so that its logarithm cannot be fitted.
    """
    found = {}
    for name in filter(None, names):
        value = _value(robot, name)
        if not value > 0.0:
            raise ParameterError(f"free value {name!r} must be above 0, the robot has {value:g}")
        found[name] = float(value)
    return found


def _value(robot: Robot, name: str) -> float:
    section, _, rest = name.partition(".")
    if section == "masses":
        text = Description(robot.urdf)
        link = _first(text.links(), rest, name)
        return sum(text.mass_of(below) for below in text.below(link))
    if section not in SECTIONS or "." not in rest:
        raise NameUnknownError("section of a free value", section, SECTIONS)
    pattern, _, parameter = rest.rpartition(".")
    parts = getattr(robot, section)
    part = parts[_first(list(parts), pattern, name)]
    value = getattr(part, parameter, None)
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        numbers = [k for k, v in vars(part).items() if isinstance(v, float)]
        raise NameUnknownError(f"number of {section}", parameter, numbers)
    return float(value)


def _first(names: Sequence[str], pattern: str, whole: str) -> str:
    for name in names:
        if fnmatchcase(name, pattern):
            return name
    raise NameUnknownError(f"place of the free value {whole!r}", pattern, names)
