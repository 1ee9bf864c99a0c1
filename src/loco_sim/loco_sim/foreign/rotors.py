# SPDX-License-Identifier: Apache-2.0
"""Properties that a URDF cannot hold: rotor inertia, springs, actuators, gravity."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Rotors:
    """Properties of an MJCF that a URDF cannot hold.

    Attributes:
        armature: Inertia of rotor and gear about the axis [kg·m²], by joint.
        springs: Stiffness [N·m/rad or N/m] and rest position [rad or m], by joint.
        gains: Stiffness [N·m/rad or N/m] and damping [N·m·s/rad or N·s/m] of position actuators, by
            joint; a damping of 0 is unknown.
        idle: Joints without an actuator, in a robot that has actuators.
        gravity: Acceleration of gravity that the file states [m/s²]; None for that of the earth.
    """

    armature: dict[str, float] = field(default_factory=dict)
    springs: dict[str, tuple[float, float]] = field(default_factory=dict)
    gains: dict[str, tuple[float, float]] = field(default_factory=dict)
    idle: set[str] = field(default_factory=set)
    gravity: float | None = None
