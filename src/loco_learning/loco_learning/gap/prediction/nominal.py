# SPDX-License-Identifier: Apache-2.0
"""Nominal values of a robot that are uncertain and refitted with every candidate.

If masses, inertias and drives are slightly wrong, so is every fitted parameter, in all records
alike, and a model without this uncertainty would attribute the error to an effect.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

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
# inertia from CAD, a torque constant or gain from a data sheet (engineering judgement).
MASS, INERTIA, DRIVE = 0.02, 0.04, 0.02
# Ratio of actual to commanded torque, beyond the drive's limit too; not in robot.yaml.
CONSTANT = TorqueConstantError.name
# Relative error of the scale of a measured torque, for currents whose torque constant was told from
# the data; not in robot.yaml. Its deviation: inverse dynamics of a wrong model is within a third.
READING, READING_ERROR = "torque_reading", 0.5
SCALES = {
    TorqueDrive: ("gain",),
    ServoParams: ("stall_torque",),
    ImpedanceDrive: ("kp", "kd", "swing_kp", "swing_kd"),
}


def values(robot: Robot, names: Sequence[str]) -> dict[str, float]:
    """Nominal values before any fit.

    Args:
        robot: The initial robot.
        names: Names of overrides of ``robot.yaml``: ``masses.<link>``,
            ``drives.<joint>.<parameter>`` or ``springs.<joint>.<parameter>``; all names that
            match a pattern share one value.

    Raises:
        NameUnknownError: There is no such value.
        ParameterError: A value is not above 0, so that its logarithm cannot be fitted.
    """
    result = {}
    for name in filter(None, names):
        value = _value(robot, name)
        if not value > 0.0:
            raise ParameterError(f"free value {name!r} must be above 0, the robot has {value:g}")
        result[name] = float(value)
    return result


def nominal_value(robot: Robot, name: str) -> float:
    """Value of a dotted name in the robot."""
    section = name.partition(".")[0]
    if section in (CONSTANT, READING):
        return 0.0
    if section == "masses":
        return _value(robot, name)
    return float(getattr(*_part(robot, name)))


def legal(robot: Robot, name: str, min_ratio: float = 0.0) -> tuple[float, float]:
    """Smallest and largest value of a dotted name in a refit.

    Args:
        robot: Robot from its file.
        name: Dotted name of the value.
        min_ratio: Smallest ratio to the nominal value, for values that cannot be negative.
    """
    section = name.partition(".")[0]
    if section in (CONSTANT, READING):
        return min_ratio - 1.0, math.inf
    if section == "masses":
        return min_ratio * nominal_value(robot, name), math.inf
    part, parameter = _part(robot, name)
    low, high = limits(type(part), parameter)
    return (max(low, min_ratio * nominal_value(robot, name)) if low >= 0.0 else low), high


def _part(robot: Robot, name: str) -> tuple[Any, str]:
    """Part of the robot with a value of `bodies`, `drives` or `springs`, and the parameter name."""
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


def _first(names: Sequence[str], pattern: str, full_name: str) -> str:
    for name in names:
        if fnmatchcase(name, pattern):
            return name
    raise NameUnknownError(f"place of the free value {full_name!r}", pattern, names)


def torques(robot: Robot, factor: float) -> dict[str, float]:
    """Values of robot.yaml with which all drives give a torque larger by a factor."""
    return {
        f"drives.{joint}.{name}": factor * getattr(drive, name)
        for joint, drive in robot.drives.items()
        for name in SCALES.get(type(drive), ())
        if getattr(drive, name) >= 0.0  # swing_kp: -1 means kp
    }


def priors(robot: Robot, excluded: Collection[str] = ()) -> list[dict[str, float]]:
    """Prior standard deviations by dotted name, of every moving link and every drive.

    Args:
        robot: Robot from its file.
        excluded: Names or patterns of values that are left out.

    Returns:
        One mapping for each group of values that change together.
    """
    text = Description(robot.urdf)
    moved = dict.fromkeys(text.child(joint) for joint in robot.joints)
    if not robot.fixed_base:
        moved[text.root_link()] = None
    links = [m for m in moved if any(text.mass_of(part) > 0.0 for part in text.fixed_to(m))]
    groups = [{f"bodies.{link}.mass": MASS} for link in links]
    groups += [{f"bodies.{link}.inertia": INERTIA} for link in links]
    drives: dict[str, dict[str, float]] = {}
    for name, value in torques(robot, DRIVE).items():
        if value > 0.0 and not any(fnmatchcase(name, k) for k in excluded):
            joint = name.split(".")[1]
            servo = isinstance(robot.drives[joint], ServoParams)
            drives[joint] = {name: value} if servo else {f"{CONSTANT}.{joint}": DRIVE}
    speeds = [
        {f"drives.{joint}.no_load_speed": DRIVE * drive.no_load_speed}
        for joint, drive in robot.drives.items()
        if isinstance(drive, ServoParams)
    ]
    groups += [*drives.values(), *speeds]
    return [one for one in groups if not any(fnmatchcase(n, k) for n in one for k in excluded)]


def split_drives(values: Mapping[str, Any]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Values of a robot divided into those of ``robot.yaml`` and effects for scale errors.

    Scales of readings are neither, see `reading_scales`.
    """
    drives = [name for name in values if name.startswith(f"{CONSTANT}.")]
    effects = [
        {"name": CONSTANT, "joint": name.partition(".")[2], "error": values[name]}
        for name in drives
    ]
    scales = tuple(f"{s}." for s in (CONSTANT, READING))
    return {k: v for k, v in values.items() if not k.startswith(scales)}, effects


def reading_scales(errors: Mapping[str, float], channels: Sequence[Any]) -> np.ndarray:
    """Share by which each scale error of readings changes those of each channel, (N, C).

    Args:
        errors: Values of a robot by dotted name, of which others scale nothing, N of them.
        channels: Channels of the residual, (C,).
    """
    scales = np.zeros((len(errors), len(channels)))
    for row, (name, size) in zip(scales, errors.items(), strict=True):
        section, _, joint = name.partition(".")
        if section == READING:
            row[[c.signal == "tau" and c.name == joint for c in channels]] = size
    return scales


def built(specs: Sequence[Mapping[str, Any]], drives: Sequence[Mapping[str, Any]]) -> list:
    """Effects of a model with scale errors of drives, in the order in which they act.

    Effects that limit a motor come first, since the scale error applies to the limit as well.

    Args:
        specs: Effects as in the list of an experiment.
        drives: Effects from `split_drives`.
    """
    motors = [i for i, s in enumerate(specs) if issubclass(EFFECTS[s["name"]], MotorEffect)]
    after = max(motors, default=-1) + 1
    return [*specs[:after], *drives, *specs[after:]]


def written(robot: Robot, values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of a robot for a file, with scale errors of drives as changed gains.

    Within the drive's torque limit both are equivalent.

    Args:
        robot: Robot from its file.
        values: Values as for `split_drives`.
    """
    overrides, drives = split_drives(values)
    for drive in drives:
        gains = torques(robot, 1.0 + drive["error"])
        drive_gains = {k: v for k, v in gains.items() if k.split(".")[1] == drive["joint"]}
        overrides |= {k: v for k, v in drive_gains.items() if k not in overrides}
    return overrides
