# SPDX-License-Identifier: Apache-2.0
"""Quantisation of joint sensors that robot.yaml does not declare, from the readings.

Quantisation is part of the noise floor, so a model without it has no gap, and it is not compared
with any effect. It is a note for the user, never part of a verdict or of the model.
"""

from __future__ import annotations

from collections.abc import Sequence

from loco_sim.robot.robot import Robot

from ..recordings.record import Record
from ..statistics import noise

# Ratio to the step in robot.yaml. Taste: a declared step is often a rounded figure itself.
COARSER = 1.5
# Ratio to the deviation of white noise on the readings. Theory: noise as large as the step hides
# it, and quantisation then adds less than a twentieth to the deviation (Widrow and Kollar 2008).
VISIBLE = 1.0


def notes(records: Sequence[Record], robot: Robot) -> list[str]:
    """A sentence for each joint whose readings are more coarsely quantised than declared."""
    return [
        f"all readings of {joint} are multiples of {step:.3g}, the robot's sensor is said to know "
        f"{declared(robot, joint):.3g}: this rounding is in the noise floor and in no verdict; "
        "sensors.encoder.resolution in robot.yaml, or the effect quantisation, puts it in the model"
        for joint, step in steps(records, robot).items()
    ]


def steps(records: Sequence[Record], robot: Robot) -> dict[str, float]:
    """Quantisation steps [rad or m] of readings that the robot does not declare, by joint.

    A step that is small compared to the noise is left out: it has no influence, and whether it is
    detected depends on the digits of a file.
    """
    result = {}
    for j, joint in enumerate(robot.joints):
        values = [r.resolution.get(("q", joint), 0.0) for r in records if joint in r.joints]
        step = min(values, default=0.0)  # the record with the finest readings has the sensor's step
        if joint in robot.hall or not step > COARSER * declared(robot, joint):
            continue
        if step > VISIBLE * noise.white([r.read_of(robot, "q")[:, j] for r in records], step):
            result[joint] = step
    return result


def declared(robot: Robot, joint: str) -> float:
    """Quantisation step of a joint's sensor in robot.yaml [rad or m]; 0 without one."""
    encoder = robot.sensors.encoder.resolution if robot.sensors else 0.0
    return max(encoder, getattr(robot.drives.get(joint), "resolution", 0.0))
