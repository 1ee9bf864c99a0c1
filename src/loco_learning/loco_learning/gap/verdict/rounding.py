# SPDX-License-Identifier: Apache-2.0
"""Rounding of joint sensors, which no residual shows: readings say it themselves.

Rounding belongs to the noise floor, so a model that lacks it leaves no gap, and nothing weighs
it against anything else. It is a note for the user, never part of a verdict or of the model.
"""

from __future__ import annotations

from collections.abc import Sequence

from loco_sim.robot.robot import Robot

from ..recordings.record import Record
from ..statistics import noise

# Over the step that robot.yaml declares. Taste: a declared step is often a rounded figure itself.
COARSER = 1.5
# Over the deviation of white noise on the readings. Theory: noise as large as the step blurs it,
# and rounding then adds less than a twentieth to the deviation (Widrow and Kollar 2008).
VISIBLE = 1.0


def notes(records: Sequence[Record], robot: Robot) -> list[str]:
    """A sentence for each joint whose readings are rounded more coarsely than the robot says."""
    return [
        f"all readings of {joint} are multiples of {step:.3g}, the robot's sensor is said to know "
        f"{declared(robot, joint):.3g}: this rounding is in the noise floor and in no verdict; "
        "sensors.encoder.resolution in robot.yaml, or the effect quantisation, puts it in the model"
        for joint, step in steps(records, robot).items()
    ]


def steps(records: Sequence[Record], robot: Robot) -> dict[str, float]:
    """Steps [rad or m] that show in readings and that the robot does not declare, by joint.

    A step that is small beside the noise is left out: it changes nothing, and whether it can be
    seen at all hangs on the digits of a file.
    """
    found = {}
    for j, joint in enumerate(robot.joints):
        known = [r.resolution.get(("q", joint), 0.0) for r in records if joint in r.joints]
        step = min(known, default=0.0)  # one record with finer readings tells the sensor's step
        if joint in robot.hall or not step > COARSER * declared(robot, joint):
            continue
        if step > VISIBLE * noise.white([r.read_of(robot, "q")[:, j] for r in records], step):
            found[joint] = step
    return found


def declared(robot: Robot, joint: str) -> float:
    """Step of a joint's sensor as robot.yaml has it [rad or m], 0 without one."""
    encoder = robot.sensors.encoder.resolution if robot.sensors else 0.0
    return max(encoder, getattr(robot.drives.get(joint), "resolution", 0.0))
