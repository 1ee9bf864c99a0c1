# SPDX-License-Identifier: Apache-2.0
"""Generator of the URDFs of HyQ and of a single HyQ leg, from a table of frames, masses and limits.

The leg geometry comes from `LegGeometry`, so kinematics and plant cannot
disagree. Run ``python -m loco_workshop.make_urdf.hyq`` after a change here; a test compares
the file with what this module writes.
Source: frames, masses and limits of DLS-Lab's hyq-description (Apache-2.0).
Shapes: boxes, cylinders and spheres in place of the meshes there. Only the
trunk, the knees and the feet collide: they touch flat ground before a shank does.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi
from pathlib import Path

import loco_sim
from loco_control.legs.geometry import LegGeometry
from loco_control.names import LEGS, foot_name, joint_name

from .text import COLOURS, DARK, METAL, RUBBER, ZERO, Vector, link, shape, text

ALONG_X: Vector = (0.0, pi / 2, 0.0)  # turns a cylinder's axis from z to x

EFFORT, SPEED, DAMPING = 150.0, 12.0, 0.1  # limits and damping of joints [N·m, rad/s, N·m·s/rad]
KNEE_RADIUS = 0.038  # [m]



def write(geometry: LegGeometry | None = None) -> str:
    """Text of the URDF for a leg geometry (default: HyQ's)."""
    geometry = geometry or LegGeometry()
    return _robot("hyq", LEGS, geometry)


def write_leg(leg: str = LEGS[0], geometry: LegGeometry | None = None) -> str:
    """Text of the URDF of the trunk with one leg, for a test bench."""
    return _robot("hyq_leg", (leg,), geometry or LegGeometry())


def _robot(name: str, legs: Sequence[str], geometry: LegGeometry) -> str:
    lines = [
        '<?xml version="1.0"?>',
        "<!-- SPDX-License-Identifier: Apache-2.0 -->",
        "<!-- Written by loco_workshop.make_urdf.hyq: edit that module, not this file. -->",
        f'<robot name="{name}">',
        *_trunk(),
    ]
    for leg in legs:
        lines += _leg(leg, geometry)
    return "\n".join([*lines, "</robot>", ""])


def _trunk() -> list[str]:
    inertia = (1.5725937, 8.5015928, 9.1954911, 0.028375, -0.203139, -0.004462)
    shapes = [
        shape("collision", "box", (0.9, 0.35, 0.2)),
        shape("visual", "box", (0.64, 0.22, 0.14), colour=DARK),
        shape("visual", "box", (0.42, 0.27, 0.08), (0.0, 0.0, 0.0), colour=METAL),
        shape("visual", "box", (0.13, 0.30, 0.12), (0.36, 0.0, 0.01), colour=DARK),
        shape("visual", "box", (0.13, 0.30, 0.12), (-0.36, 0.0, 0.01), colour=DARK),
        shape("visual", "box", (0.05, 0.15, 0.06), (0.42, 0.0, 0.02), colour=RUBBER),
    ]
    return link("base_link", 58.96, (0.01, 0.0, 0.00358), inertia, shapes)


def _leg(leg: str, geometry: LegGeometry) -> list[str]:
    front = 1.0 if leg[1] == "f" else -1.0
    left = 1.0 if leg[0] == "l" else -1.0
    hip, thigh, shank = (f"{leg}_{part}" for part in ("hipassembly", "upperleg", "lowerleg"))
    haa_at = (front * geometry.hip_x, left * geometry.hip_y, 0.0)
    haa_turn = (0.0, pi / 2, pi if left > 0 else 0.0)
    hfe_at, kfe_at = (geometry.hip_length, 0.0, 0.0), (geometry.thigh_length, 0.0, 0.0)
    foot_at, foot_turn = (geometry.shank_length, 0.0, 0.0), (pi / 2, 0.0, -pi / 2)
    return [
        *_joint(joint_name(leg, "haa"), "base_link", hip, haa_at, haa_turn,
                geometry.haa_range),
        *_hip(hip, front * left),
        *_joint(joint_name(leg, "hfe"), hip, thigh, hfe_at, (left * pi / 2, 0.0, 0.0),
                _mirrored(geometry.hfe_range, front)),
        *_thigh(thigh, front, geometry.thigh_length, COLOURS[leg]),
        *_joint(joint_name(leg, "kfe"), thigh, shank, kfe_at, ZERO,
                _mirrored(geometry.kfe_range, front)),
        *_shank(shank, front, geometry.shank_length, COLOURS[leg]),
        *_joint(f"{leg}_foot_joint", shank, foot_name(leg), foot_at, foot_turn),
        *_foot(foot_name(leg), geometry.foot_radius),
    ]  # fmt: skip


def _hip(name: str, sign: float) -> list[str]:
    inertia = (0.05071, 0.05486, 0.00571, -0.00004 * sign, -0.00159 * sign, -0.00005)
    shapes = [
        shape("visual", "box", (0.10, 0.075, 0.13), colour=METAL),
        shape("visual", "box", (0.10, 0.085, 0.08), (0.07, 0.0, 0.0), colour=DARK),
    ]
    return link(name, 2.93, (0.04263, 0.0, 0.16931 * sign), inertia, shapes)


def _thigh(name: str, sign: float, length: float, colour: Vector) -> list[str]:
    inertia = (0.00368, 0.02719, 0.02811, -0.00302 * sign, 0.0001 * sign, 0.00002)
    middle = (length / 2, 0.0, 0.0)
    shapes = [
        shape("collision", "sphere", (KNEE_RADIUS,), (length, 0.0, 0.0)),
        shape("visual", "box", (length - 0.02, 0.065, 0.05), middle, colour=colour),
        shape("visual", "cylinder", (KNEE_RADIUS, 0.07), (length, 0.0, 0.0), colour=METAL),
    ]
    return link(name, 2.638, (0.15074, -0.02625 * sign, 0.0), inertia, shapes)


def _shank(name: str, sign: float, length: float, colour: Vector) -> list[str]:
    inertia = (0.00047, 0.01256, 0.01233, 0.00006 * sign, -0.00001 * sign, 0.0)
    middle = (length / 2, 0.0, 0.0)
    shapes = [shape("visual", "cylinder", (0.019, length), middle, ALONG_X, colour)]
    return link(name, 0.881, (0.1254, 0.00004 * sign, -0.0001 * sign), inertia, shapes)


def _foot(name: str, radius: float) -> list[str]:
    shapes = [
        shape("collision", "sphere", (radius,)),
        shape("visual", "sphere", (radius + 0.004,), colour=RUBBER),
    ]
    return link(name, 0.0, ZERO, (0.0,) * 6, shapes)  # explicit: without it PyBullet adds 1 kg


def _mirrored(span: tuple[float, float], front: float) -> tuple[float, float]:
    return span if front > 0 else (-span[1], -span[0])


def _joint(name: str, parent: str, child: str, xyz: Vector, rpy: Vector,
           span: tuple[float, float] | None = None) -> list[str]:  # fmt: skip
    lines = [
        f'  <joint name="{name}" type="{"revolute" if span else "fixed"}">',
        f'    <parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{text(xyz)}" rpy="{text(rpy)}"/>',
    ]
    if span:
        lines += [
            f'    <axis xyz="0 0 1"/><dynamics damping="{DAMPING}" friction="0"/>',
            f'    <limit lower="{span[0]:.9g}" upper="{span[1]:.9g}" effort="{EFFORT}" '
            f'velocity="{SPEED}"/>',
        ]
    return [*lines, "  </joint>"]


if __name__ == "__main__":
    assets = Path(loco_sim.__file__).parent / "assets"
    (assets / "hyq" / "hyq.urdf").write_text(write())
    (assets / "hyq_leg" / "hyq_leg.urdf").write_text(write_leg())
