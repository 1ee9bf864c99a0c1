# SPDX-License-Identifier: Apache-2.0
"""Joint springs with dampers: linear springs, and Tigrillo's knee spring.

The knee spring is a tension spring between an anchor on the femur, `femur` above
the knee, and the top of the tibia, `tibia` beyond it, so that at a knee angle a
(0 is a straight leg)

    l(a)² = femur² + tibia² - 2 femur tibia cos a,      tau = -k (l - length) dl/da.

The author's Gazebo model has its linear equivalent instead,

    k_t = k tibia sin(gamma) length / a0,               tau = -k_t (a - a0),

with the rest angle a0 of the spring and gamma the angle of the triangle
between spring and tibia. Source: gurbain/tigrillo2, exp/model.py:776.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter

SPRING_TYPES = ("linear", "pretension", "torsion")
LINEAR, PRETENSION = 1.0, 2.0  # kind of spring, first column of a row
COLUMNS = 7


@dataclass(frozen=True)
class SpringParams(Params):
    """Spring and damper of one joint."""

    kind: str = parameter(
        "linear",
        "linear: -stiffness (q - rest); pretension: the exact knee spring; torsion: its linear "
        "equivalent",
        choices=SPRING_TYPES,
    )
    stiffness: float = parameter(
        0.0,
        "stiffness: of the tension spring [N/m] for pretension and torsion, else of the joint",
        "N/m, or N·m/rad (linear, turning joint)",
        low=0.0,
        high=1e6,
    )
    damping: float = parameter(
        0.0, "viscous damping of the joint", "N·m·s/rad or N·s/m", low=0.0, high=1e4
    )
    rest: float = parameter(0.0, "joint position of no torque, linear kind", "rad or m")
    stop: float = parameter(
        -math.inf, "smallest joint position: a hard stop instead of the URDF's limit", "rad or m"
    )
    length: float = parameter(0.025, "tension spring without load", "m", low=1e-4)
    femur: float = parameter(0.045, "knee to the spring's anchor on the femur", "m", low=1e-4)
    tibia: float = parameter(0.035, "knee to the spring's anchor on the tibia", "m", low=1e-4)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(self.femur - self.tibia) < self.length < self.femur + self.tibia:
            raise ParameterError(
                f"a spring of {self.length:g} m fits no triangle with femur {self.femur:g} m "
                f"and tibia {self.tibia:g} m"
            )

    @property
    def slack(self) -> float:
        """Joint position at which the spring torque is zero [rad or m]."""
        if self.kind == "linear":
            return self.rest
        return _corner(self.femur, self.tibia, self.length)

    @property
    def rate(self) -> float:
        """Stiffness of the linear kinds in the joint [N·m/rad, or N/m if prismatic]."""
        if self.kind == "linear":
            return self.stiffness
        gamma = _corner(self.length, self.tibia, self.femur)
        return self.stiffness * self.tibia * math.sin(gamma) * self.length / self.slack

    def row(self) -> tuple[float, ...]:
        """Parameter row for the kernels, (COLUMNS,)."""
        if self.kind == "pretension":
            exact = self.length, self.femur, self.tibia
            return (PRETENSION, self.stiffness, self.damping, 0.0, *exact)
        return (LINEAR, self.rate, self.damping, self.slack, 0.0, 0.0, 0.0)


def _corner(a: float, b: float, opposite: float) -> float:
    """Angle between sides a and b of a triangle [rad]."""
    return math.acos((a * a + b * b - opposite * opposite) / (2.0 * a * b))
