# SPDX-License-Identifier: Apache-2.0
"""Joint torque correction learned from data, for residuals without a physical explanation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from loco_control.params import parameter

from .. import rows
from ..chain import TorqueEffect
from ..identity import Identity, LookAlike, Prior


@dataclass
class LearnedResidual(TorqueEffect, name="learned_residual"):
    """A learned correction of a joint's torque, for a gap that no known effect explains.

    It is valid in the range of the training data: outside it fades to zero, and it is limited to
    the torque limit of the joint. `loco gap --residual` fits it.
    """

    weights: tuple[float, ...] = parameter(
        (0.0,) * rows.FEATURES, "weight of each feature", "N·m", -1e4, 1e4
    )
    middle: float = parameter(0.0, "middle of the training positions", "rad", -1e3, 1e3)
    travel: float = parameter(1.0, "half of the range around the middle", "rad", 1e-6, 1e3)
    speed: float = parameter(1.0, "largest training speed", "rad/s", 1e-6, 1e4)
    load: float = parameter(
        0.0, "middle of the training torques of drive and spring", "N·m", -1e4, 1e4
    )
    load_range: float = parameter(1.0, "half of the range around the middle", "N·m", 1e-6, 1e4)
    time: float = parameter(0.02, "time constant of the filtered torque change", "s", 1e-3, 1.0)
    law, among = rows.LEARNED, "driven"

    identity = Identity(
        site="actuator",
        equation="tau <- tau + sum of weights times features of position, speed, torque of drive "
        "and spring, and its change; 0 outside of the training range",
        priors={"weights": Prior(-1.0, 0.0, 1.0)},
        source="thesis chapter 9: a simulator joined to a network; ridge regression, Hoerl and "
        "Kennard 1970, Technometrics 12(1)",
        look_alikes=(
            LookAlike("stribeck_friction", "an effect that passes is preferred to a correction"),
            LookAlike("cubic_stiffness", "beyond the recorded angles: a correction is zero"),
        ),
        touches=("torque",),
        passive=False,
        untried="it explains nothing; --residual fits it where nothing else explains a gap",
    )

    def constants(self, world: Any, joints: Any) -> Sequence[Any]:
        limit = world.robot.effort[joints]
        keep = math.exp(-world.dt / self.time)
        scales = self.middle, self.travel, self.speed, self.load, self.load_range
        return *scales, limit, keep, *self.weights
