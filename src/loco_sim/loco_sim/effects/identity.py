# SPDX-License-Identifier: Apache-2.0
"""Prior knowledge about an effect: location, equation, typical parameter values.

One `Identity` per effect, defined with its class: gap finding reads priors, bounds and
look-alikes from it, and the documentation of effects is generated from it. Unit and bounds of
a parameter are in its field (`loco_control.params.parameter`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

SITES = ("actuator", "friction", "compliance", "body", "contact", "sensor", "outside")

# Signal names of recordings that differ from `SENSOR_SIGNALS`.
READ_AS = {"gyro": "angular_velocity", "acceleration": "linear_acceleration"}

# Signals at which an effect enters the plant: "command" is the input of the drives, "drive" their
# torque, "torque" and "brake" act on the joints, "force" is external, "model" is mass, contact
# or gravity. All of these change the motion. The others are sensor readings, fields of
# `RobotState`.
PLANT_SIGNALS = ("command", "drive", "torque", "brake", "force", "model")
SENSOR_SIGNALS = (
    *("q", "dq", "tau", "grf", "orientation", "angular_velocity", "linear_acceleration"),
)


class Prior(NamedTuple):
    """Prior distribution of a parameter on real robots that have the effect.

    90 % of robots lie between `low` and `high`; `typical` is the median. A prior with
    `low` > 0 is log-normal, one that includes both signs is normal.
    """

    low: float
    typical: float
    high: float


class LookAlike(NamedTuple):
    """An effect that explains the same data, and an experiment that distinguishes the two."""

    name: str
    experiment: str


@dataclass(frozen=True)
class Identity:
    """Prior knowledge about an effect.

    Attributes:
        site: Part of the robot where the effect is located, one of `SITES`.
        equation: Law in one line, with the names of the parameters as symbols.
        priors: Prior of every parameter that can be identified.
        source: Source of the law.
        look_alikes: Effects that may be confused with it.
        touches: Signals at which it enters, of `PLANT_SIGNALS` and `SENSOR_SIGNALS`.
        passive: Whether it can never add energy to a robot without drives.
        smooth: Whether the motion is a differentiable function of its parameters, so that
            gradients may be used.
        strengths: Parameters that are all zero when the effect is absent; by default the
            first of `priors`.
        kind: Name of the family of laws, such as friction; data may identify only the kind.
        twins: Effects that no recording can distinguish from it; gap finding reports all of them.
        untried: Reason why gap finding never tries it; "" if it does.
        noise: Whether it is zero-mean noise, which a prediction omits.
        whole_steps: Name of the parameter that the plant rounds to whole physics steps.
        late: Name of the parameter that delays all readings of a channel without any other change.
        turned: Name of the parameter that offsets joint angles from their sensor readings.
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
