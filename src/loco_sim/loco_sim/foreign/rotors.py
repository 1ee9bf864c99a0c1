# SPDX-License-Identifier: Apache-2.0
"""Rotors, springs and idle joints, which no URDF names."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass
class Rotors:
    """Properties of joints that an MJCF names and no URDF can.

    Attributes:
        armature: Inertia of rotor and gear about the axis [kg·m²], by joint.
        springs: Stiffness [N·m/rad or N/m] and rest position [rad or m], by joint.
        idle: Joints that no actuator moves, while others have one.
    """

    armature: dict[str, float] = field(default_factory=dict)
    springs: dict[str, tuple[float, float]] = field(default_factory=dict)
    idle: set[str] = field(default_factory=set)
