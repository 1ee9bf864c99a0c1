# SPDX-License-Identifier: Apache-2.0
"""Nominal values of a robot that are not known well and are refitted with every candidate.

If masses, inertias and drives are a little off, so is every size that is found with them, in all
records alike, and a model that knows of it only by an effect gives that a false name.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import limits
from loco_sim.effects import EFFECTS
from loco_sim.effects.catalogue.actuator import TorqueConstantError
from loco_sim.effects.chain import MotorEffect
from loco_sim.robot.description import Description
from loco_sim.robot.equipment import BodyParams
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ImpedanceDrive, ServoParams, TorqueDrive

SECTIONS = ("drives", "springs", "masses")
# Standard deviations over the value: a link on a kitchen scale with its cables and screws, an
# inertia from CAD, a torque constant or gain as its maker gives it (engineering judgement).
MASS, INERTIA, DRIVE = 0.02, 0.04, 0.02
# Torque per torque asked for, beyond the drive's limit as well: no value of robot.yaml has it.
CONSTANT = TorqueConstantError.name
SCALES = {
    TorqueDrive: ("gain",),
    ServoParams: ("stall_torque",),
    ImpedanceDrive: ("kp", "kd", "swing_kp", "swing_kd"),
}


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


def nominal_value(robot: Robot, name: str) -> float:
    """Value of a dotted name as the robot has it."""
    section = name.partition(".")[0]
    if section == CONSTANT:
        return 0.0
    if section == "masses":
        return _value(robot, name)
    return float(getattr(*_part(robot, name)))


def legal(robot: Robot, name: str, least: float = 0.0) -> tuple[float, float]:
    """Smallest and largest value of a dotted name that a refit may give.

    Args:
        robot: Robot as its file has it.
        name: Value of it.
        least: Share of a value that cannot be below 0, such as an inertia, that must be left.
    """
    section = name.partition(".")[0]
    if section == CONSTANT:
        return least - 1.0, math.inf
    if section == "masses":
        return least * nominal_value(robot, name), math.inf
    part, parameter = _part(robot, name)
    low, high = limits(type(part), parameter)
    return (max(low, least * nominal_value(robot, name)) if low >= 0.0 else low), high


def _part(robot: Robot, name: str) -> tuple[Any, str]:
    """Part of the robot that has a value of `bodies`, `drives` or `springs`, and its parameter."""
    section, _, rest = name.partition(".")
    place, _, parameter = rest.rpartition(".")
    return (BodyParams() if section == "bodies" else getattr(robot, section)[place]), parameter


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


def torques(robot: Robot, factor: float) -> dict[str, float]:
    """Values of robot.yaml with which all drives pull harder by a factor."""
    return {
        f"drives.{joint}.{name}": factor * getattr(drive, name)
        for joint, drive in robot.drives.items()
        for name in SCALES.get(type(drive), ())
        if getattr(drive, name) >= 0.0  # swing_kp: -1 stands for kp
    }


def priors(robot: Robot, known: Collection[str] = ()) -> list[dict[str, float]]:
    """Standard deviations by dotted name: of every link that moves and every drive.

    Args:
        robot: Robot as its file has it.
        known: Names or patterns of values that are left out.

    Returns:
        One mapping for all that changes together.
    """
    text = Description(robot.urdf)
    moved = dict.fromkeys(text.child(joint) for joint in robot.joints)
    if not robot.fixed_base:
        moved[text.root_link()] = None
    links = [m for m in moved if any(text.mass_of(part) > 0.0 for part in text.fixed_to(m))]
    found = [{f"bodies.{link}.mass": MASS} for link in links]
    found += [{f"bodies.{link}.inertia": INERTIA} for link in links]
    drives: dict[str, dict[str, float]] = {}
    for name, value in torques(robot, DRIVE).items():
        if value > 0.0 and not any(fnmatchcase(name, k) for k in known):
            joint = name.split(".")[1]
            servo = isinstance(robot.drives[joint], ServoParams)
            drives[joint] = {name: value} if servo else {f"{CONSTANT}.{joint}": DRIVE}
    speeds = [
        {f"drives.{joint}.no_load_speed": DRIVE * drive.no_load_speed}
        for joint, drive in robot.drives.items()
        if isinstance(drive, ServoParams)
    ]
    found += [*drives.values(), *speeds]
    return [one for one in found if not any(fnmatchcase(n, k) for n in one for k in known)]


def parted(values: Mapping[str, Any]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Values of a robot as those that ``robot.yaml`` has, and the rest as a list of effects."""
    drives = [name for name in values if name.startswith(f"{CONSTANT}.")]
    effects = [
        {"name": CONSTANT, "joint": name.partition(".")[2], "error": values[name]}
        for name in drives
    ]
    return {k: v for k, v in values.items() if k not in drives}, effects


def built(specs: Sequence[Mapping[str, Any]], drives: Sequence[Mapping[str, Any]]) -> list:
    """Effects of a model with drives that are off: these give less of what motors were asked for.

    What limits a motor comes before, since its limit is off as well.

    Args:
        specs: Effects as in an experiment's list.
        drives: Effects of `parted`.
    """
    motors = [i for i, s in enumerate(specs) if issubclass(EFFECTS[s["name"]], MotorEffect)]
    after = max(motors, default=-1) + 1
    return [*specs[:after], *drives, *specs[after:]]


def written(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a robot for a file, drives that are off as gains that are.

    Within the drive's limit that is the same.

    Args:
        robot: Robot as its file has it.
        values: Values as of `parted`.
    """
    found, drives = parted(values)
    for drive in drives:
        gains = torques(robot, 1.0 + drive["error"])
        mine = {k: v for k, v in gains.items() if k.split(".")[1] == drive["joint"]}
        found |= {k: v for k, v in mine.items() if k not in found}
    return found
