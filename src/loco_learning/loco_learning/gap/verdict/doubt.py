# SPDX-License-Identifier: Apache-2.0
"""Values of a robot that nobody knows exactly: no mass is known to a percent.

A size is found with all masses, inertias and drives as they are written. If these are a little
off, so is the size, in all records alike: no resampling of the data shows it. Each of them
therefore takes part in the intervals with a prior, unless robot.yaml calls it uncertain itself
(it is refitted to every model then) or it is a free value.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ServoParams

from ..fitting.fit import Fitted
from ..prediction.case import Case
from ..statistics import identify
from . import scale

# Standard deviations over the value: a link on a kitchen scale with its cables and screws, an
# inertia from CAD, a torque constant or gain as its maker gives it (engineering judgement).
MASS, INERTIA, DRIVE = 0.02, 0.04, 0.02


def values(robot: Robot) -> list[dict[str, float]]:
    """Changes of robot.yaml by one deviation each: of every moved link and every drive.

    Args:
        robot: Robot as its file has it.
    """
    text = Description(robot.urdf)
    moved = dict.fromkeys(text.child(joint) for joint in robot.joints)
    links = [m for m in moved if any(text.mass_of(part) > 0.0 for part in text.fixed_to(m))]
    found = [{f"bodies.{link}.mass": 1.0 + MASS} for link in links]
    found += [{f"bodies.{link}.inertia": 1.0 + INERTIA} for link in links]
    drives: dict[str, dict[str, float]] = {}
    for name, value in scale.torques(robot, 1.0 + DRIVE).items():
        drives.setdefault(name.split(".")[1], {})[name] = value
    speeds = [
        {f"drives.{joint}.no_load_speed": (1.0 + DRIVE) * drive.no_load_speed}
        for joint, drive in robot.drives.items()
        if isinstance(drive, ServoParams)
    ]
    return [*found, *drives.values(), *speeds]


def columns(case: Case, model: Fitted) -> np.ndarray:
    """Change of all residuals by one deviation of each value nobody knows exactly, (N, K).

    Args:
        case: Model and data.
        model: Fitted to it.
    """
    known = {*model.overrides, *(case.loose.names if case.loose else ())}
    here = case.whitened(model.specs, model.overrides, coarse=True)
    moved = [
        _change(case, model, change, here)
        for change in values(case.forward.given())
        if not known & set(change)
    ]
    return np.stack(moved, axis=1) if moved else np.zeros((identify.flat(here).size, 0))


def _change(
    case: Case, model: Fitted, change: Mapping[str, Any], here: list[np.ndarray]
) -> np.ndarray:
    there = case.whitened(model.specs, {**model.overrides, **change}, coarse=True)
    change = identify.flat([a - b for a, b in zip(there, here, strict=True)])
    return np.clip(np.nan_to_num(change), -case.cap, case.cap)
