# SPDX-License-Identifier: Apache-2.0
"""Knowledge about an effect before any data: where it sits, how large it tends to be.

One `Identity` per effect, beside its class, in plain numbers and texts: gap finding
reads priors, bounds and look-alikes from here, and the page about effects is printed
from it. Unit and bounds of a parameter are in its field (`loco_control.params.parameter`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

SITES = ("actuator", "friction", "compliance", "body", "contact", "sensor", "outside")

# What `SENSOR_SIGNALS` are called in a recording, where that differs.
READ_AS = {"gyro": "angular_velocity", "acceleration": "linear_acceleration"}

# Where an effect enters the plant: "command" is what the drives get, "drive" what they
# give, "torque" and "brake" are the joints', "force" acts from outside, "model" is mass, contact
# or gravity. All of
# these change the motion. The others are what the sensors say, fields of `RobotState`.
PLANT_SIGNALS = ("command", "drive", "torque", "brake", "force", "model")
SENSOR_SIGNALS = (
    *("q", "dq", "tau", "grf", "orientation", "angular_velocity", "linear_acceleration"),
)


class Prior(NamedTuple):
    """Usual size of a parameter on real robots, if the effect is there at all.

    `low` and `high` hold nine of ten robots, `typical` is the middle. A prior with
    `low` > 0 is log-normal, one that reaches to both sides of zero is normal.
    """

    low: float
    typical: float
    high: float


class LookAlike(NamedTuple):
    """An effect that explains the same data, and the experiment that tells them apart."""

    name: str
    experiment: str


@dataclass(frozen=True)
class Identity:
    """Knowledge about an effect before any data.

    Attributes:
        site: Part of the robot where it sits, one of `SITES`.
        equation: Law in one line, symbols as the parameters are named.
        priors: Prior of every parameter that data may tell.
        source: Source of the law.
        look_alikes: Effects that may be mistaken for it.
        touches: Signals where it enters, of `PLANT_SIGNALS` and `SENSOR_SIGNALS`.
        passive: It can never add energy to a robot that is not driven.
        smooth: The motion depends on its parameters without kinks and jumps, so that
            gradients may be used.
        strengths: Parameters that are all zero when the effect is absent; by default the
            first of `priors`.
        kind: Name of the family of laws, such as friction; data may tell the kind but not the law.
        twins: Effects that no recording tells from it: it is tried for them, and all are said.
        untried: Why gap finding never tries it; empty if it does.
        noise: It averages to nothing, so that a prediction leaves it out.
        whole_steps: Parameter that the plant rounds to whole physics steps.
        late: Parameter by which all readings of a channel are late, and nothing else changes.
        turned: Parameter by which joints are turned against what their sensors say.
    """

    site: str
    equation: str
    priors: Mapping[str, Prior]
    source: str
    look_alikes: tuple[LookAlike, ...]
    touches: tuple[str, ...]
    passive: bool = True
    smooth: bool = True
    strengths: tuple[str, ...] = ()
    kind: str = ""
    twins: tuple[str, ...] = ()
    untried: str = ""
    noise: bool = False
    whole_steps: str = ""
    late: str = ""
    turned: str = ""

    def __post_init__(self) -> None:
        if not self.strengths:
            object.__setattr__(self, "strengths", tuple(self.priors)[:1])
