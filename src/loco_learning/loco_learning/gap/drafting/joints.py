# SPDX-License-Identifier: Apache-2.0
"""Joints of a robot, as a draft of a mapping needs them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Joints:
    """Joints of a robot.

    Attributes:
        names: Names; empty if the robot is unknown.
        follows: Joints whose drives are known to follow positions or velocities.
        passive: Joints that are known to have no drive, and need no command.
        endless: Velocity limits of joints that turn without end [rad/s].
    """

    names: Sequence[str] = ()
    follows: Sequence[str] = ()
    passive: Collection[str] = ()
    endless: Mapping[str, float] = field(default_factory=dict)
