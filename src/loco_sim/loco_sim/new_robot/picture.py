# SPDX-License-Identifier: Apache-2.0
"""A picture of a robot in its standing posture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..robot.robot import Robot
from ..world.figure import Figure
from ..world.stage import Stage

SIZE = 480, 360  # [pixel]
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
FULL = 0.9  # longest side of a robot that fills the picture at scale 1 [m]


def picture(robot: Robot, path: Path) -> bool:
    """Draw a robot in its standing posture on the ground and write a PNG.

    Args:
        robot: The robot.
        path: File to write.

    Returns:
        Whether there was anything to draw.
    """
    figure = Figure(robot)
    corners = figure.corners(0.0)
    if not len(corners):
        return False
    figure.pose((0.0, 0.0, -corners[:, 2].min()), UPRIGHT, robot.standing)
    corners = figure.corners(0.0)
    scale = float(np.ptp(corners, axis=0).max()) / FULL
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    stage = Stage(SIZE, height=float(middle[2]) / scale, scale=scale)
    stage.draw(figure, middle).save(path)
    return True
