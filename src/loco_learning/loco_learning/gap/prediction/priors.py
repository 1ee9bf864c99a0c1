# SPDX-License-Identifier: Apache-2.0
"""Values of a robot that nobody knows exactly: no mass is known to a percent.

If masses, inertias and drives are a little off, so is every size that is found with them, in all
records alike, and a model that knows of it only by an effect gives that a false name.
"""

from __future__ import annotations

from collections.abc import Collection
from fnmatch import fnmatchcase

from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ImpedanceDrive, ServoParams, TorqueDrive

# Standard deviations over the value: a link on a kitchen scale with its cables and screws, an
# inertia from CAD, a torque constant or gain as its maker gives it (engineering judgement).
MASS, INERTIA, DRIVE = 0.02, 0.04, 0.02
SCALES = {
    TorqueDrive: ("gain",),
    ServoParams: ("stall_torque",),
    ImpedanceDrive: ("kp", "kd", "swing_kp", "swing_kd"),
}


def torques(robot: Robot, factor: float) -> dict[str, float]:
    """Values of robot.yaml with which all drives pull harder by a factor."""
    return {
        f"drives.{joint}.{name}": factor * getattr(drive, name)
        for joint, drive in robot.drives.items()
        for name in SCALES.get(type(drive), ())
        if getattr(drive, name) >= 0.0  # swing_kp: -1 stands for kp
    }


def values(robot: Robot, known: Collection[str] = ()) -> list[dict[str, float]]:
    """Standard deviations by dotted name: of every moved link and every drive.

    Args:
        robot: Robot as its file has it.
        known: Names or patterns of values that are left out.

    Returns:
        One mapping for all that changes together.
    """
    text = Description(robot.urdf)
    moved = dict.fromkeys(text.child(joint) for joint in robot.joints)
    links = [m for m in moved if any(text.mass_of(part) > 0.0 for part in text.fixed_to(m))]
    found = [{f"bodies.{link}.mass": MASS} for link in links]
    found += [{f"bodies.{link}.inertia": INERTIA} for link in links]
    drives: dict[str, dict[str, float]] = {}
    for name, value in torques(robot, DRIVE).items():
        if value > 0.0:
            drives.setdefault(name.split(".")[1], {})[name] = value
    speeds = [
        {f"drives.{joint}.no_load_speed": DRIVE * drive.no_load_speed}
        for joint, drive in robot.drives.items()
        if isinstance(drive, ServoParams)
    ]
    found += [*drives.values(), *speeds]
    return [one for one in found if not any(fnmatchcase(n, k) for n in one for k in known)]
