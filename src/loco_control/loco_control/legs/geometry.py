# SPDX-License-Identifier: Apache-2.0
"""Geometry of a quadruped's legs as an array: a row per leg (lf rf lh rh), columns by name.

`kinematics` defines the columns. `loco_sim.robot.legs` reads them from a URDF.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..params import Params, parameter

FRONT = np.array([1.0, 1.0, -1.0, -1.0])  # +1 in front, -1 behind, per leg
LEFT = np.array([1.0, -1.0, 1.0, -1.0])  # +1 left, -1 right, per leg
COLUMNS = (
    *("hip_x", "hip_y", "hip_z"),  # position of the HAA axis, y outwards [m]
    *("side", "down", "thigh", "shank"),  # from the HAA axis to thigh and shank, l0, l1, l2 [m]
    *("knee", "bent", "straight"),  # sign of the canonical KFE; cosines of its range
    *("haa_sign", "hfe_sign", "kfe_sign"),  # +1 or -1
    *("haa_zero", "hfe_zero", "kfe_zero"),  # URDF angle at which the canonical one is 0 [rad]
)
HIP_X, HIP_Y, HIP_Z, SIDE, DOWN, THIGH, SHANK, KNEE, FLEXED, EXTENDED = range(10)
SIGN, ZERO = 10, 13  # first of three columns for the sign and for the zero angle


@dataclass(frozen=True)
class LegGeometry(Params):
    """Lengths of a four-legged robot with HyQ's leg, mirrored front to back and left to right.

    Source: hyq-description.
    """

    hip_x: float = parameter(0.3735, "hip (HAA) ahead of or behind the trunk centre", "m", low=0.0)
    hip_y: float = parameter(0.207, "hip (HAA) beside the trunk centre", "m", low=0.0)
    hip_length: float = parameter(0.08, "from HAA down to HFE", "m", low=0.0)
    thigh_length: float = parameter(0.35, "from HFE to KFE", "m", low=0.01)
    shank_length: float = parameter(0.341, "from KFE to the foot centre", "m", low=0.01)
    foot_radius: float = parameter(0.02175, "radius of the foot sphere", "m", low=0.0)
    haa_range: tuple[float, float] = parameter(
        (math.radians(-70.0), math.radians(25.0)), "range of HAA", "rad"
    )
    hfe_range: tuple[float, float] = parameter(
        (math.radians(-50.0), math.radians(70.0)), "range of HFE in front, mirrored behind", "rad"
    )
    kfe_range: tuple[float, float] = parameter(
        (math.radians(-140.0), math.radians(-20.0)), "range of KFE in front, mirrored behind", "rad"
    )

    def rows(self) -> np.ndarray:
        """Leg geometry as an array for the kernels, (4, 16), columns named by `COLUMNS`."""
        legs = np.zeros((4, len(COLUMNS)))
        legs[:, HIP_X], legs[:, HIP_Y] = self.hip_x * FRONT, self.hip_y
        legs[:, DOWN : SHANK + 1] = self.hip_length, self.thigh_length, self.shank_length
        legs[:, KNEE], legs[:, SIGN : SIGN + 3] = -FRONT, 1.0
        legs[:, FLEXED], legs[:, EXTENDED] = (math.cos(angle) for angle in self.kfe_range)
        return legs


HYQ = LegGeometry().rows()
