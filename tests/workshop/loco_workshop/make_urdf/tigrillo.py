# SPDX-License-Identifier: Apache-2.0
"""Generator of ``assets/tigrillo/tigrillo.urdf`` from a table of sizes and masses.

Frames follow REP-103: x forward, y left, z up; the base is at the underside of the
body, between the hips. All joints turn about -y, so a positive hip swings the leg
forwards and a positive knee folds the shank forwards; both 0 is a straight leg that
points down. The knee coordinate is therefore the angle that the Hall sensor reports.
Run ``python -m loco_workshop.make_urdf.tigrillo`` after a change here; a test compares.
Source: gurbain/tigrillo2, exp/model.py, which has y forward. Its leg parts have the
density 1e5 kg/m³ and the robot 3.9 kg; here a leg weighs 43 g and the robot the 0.95 kg
of the thesis (section 4.2), split as in Table 5.1: 0.712 kg in front, 0.238 kg behind.
"""

from __future__ import annotations

from math import pi
from pathlib import Path

import loco_sim
from loco_control.names import LEGS, foot_name, joint_name

from .text import COLOURS, DARK, METAL, RUBBER, ZERO, Vector, link, shape, text

FEMUR, SHANK, TIBIA_TOP = 0.07, 0.055, 0.035  # hip-knee, knee-foot, knee-spring [m]
RADIUS, FOOT_RADIUS = 0.004, 0.006  # radii of rods and feet [m]
HIP_X, HIP_Y = {"f": 0.08, "h": -0.07}, {"f": 0.0745, "h": 0.0495}  # [m]
HIP_Z = -0.033  # below the body [m]
HIP_RANGE, KNEE_RANGE = (-pi / 2, pi / 2), (0.0, pi / 2 + 0.59)  # [rad]
EFFORT, SPEED = 2.6, 13.2  # limits of the servo [N·m], [rad/s]
FEMUR_MASS, TIBIA_MASS, FOOT_MASS = 0.020, 0.020, 0.003  # with spring and sensor [kg]
HALF_MASS = {"f": 0.712, "h": 0.238}  # body, battery, servos and legs [kg]
BODY = {"f": (0.08, 0.14, 0.03), "h": (0.06, 0.09, 0.025)}  # boxes [m]
NAMES = {"f": "front_body", "h": "hind_body"}
PLATE_MASS = 1e-4  # engines treat a massless base as fixed to the world [kg]
MOTOR = (0.036, 0.036, 0.0506)  # sides of a servo [m]



def write() -> str:
    """Text of the URDF."""
    plate = shape("visual", "box", (0.09, 0.05, 0.0025), (0.005, 0.0, 0.012), colour=METAL)
    lines = [
        '<?xml version="1.0"?>',
        "<!-- SPDX-License-Identifier: Apache-2.0 -->",
        "<!-- Written by loco_workshop.make_urdf.tigrillo: edit that module, not this file. -->",
        '<robot name="tigrillo">',
        *link("base_link", PLATE_MASS, ZERO, (1e-7, 1e-7, 1e-7, 0.0, 0.0, 0.0), [plate]),
        *_body("f"),
        *_body("h"),
    ]
    for leg in LEGS:
        lines += _leg(leg)
    return "\n".join([*lines, "</robot>", ""])


def _body(half: str) -> list[str]:
    size, name = BODY[half], NAMES[half]
    mass = HALF_MASS[half] - 2.0 * (FEMUR_MASS + TIBIA_MASS + FOOT_MASS)
    middle = (0.0, 0.0, size[2] / 2)
    motors = [
        shape("visual", "box", MOTOR, (0.0, side * (HIP_Y[half] - 0.022), -0.022), colour=DARK)
        for side in (1.0, -1.0)
    ]
    shapes = [
        shape("collision", "box", size, middle),
        shape("visual", "box", size, middle, colour=METAL),
        *motors,
    ]
    at = (HIP_X[half], 0.0, 0.0)
    return [
        *_joint(f"{name}_joint", "base_link", name, at, "fixed"),
        *link(name, mass, ZERO, _box(mass, (size[0], size[1], 0.05)), shapes),
    ]


def _leg(leg: str) -> list[str]:
    side, pair = (1.0 if leg[0] == "l" else -1.0), leg[1]
    upper, lower, foot = f"{leg}_upper_leg", f"{leg}_lower_leg", foot_name(leg)
    hip, knee, tip = (0.0, side * HIP_Y[pair], HIP_Z), (0.0, 0.0, -FEMUR), (0.0, 0.0, -SHANK)
    length, middle = SHANK + TIBIA_TOP, (0.0, 0.0, (TIBIA_TOP - SHANK) / 2)
    femur = [
        shape("visual", "cylinder", (RADIUS, FEMUR), (0.0, 0.0, -FEMUR / 2), colour=COLOURS[leg]),
        shape("collision", "sphere", (FOOT_RADIUS,), knee),
    ]
    tibia = [shape("visual", "cylinder", (RADIUS, length), middle, colour=COLOURS[leg])]
    sole = [
        shape("collision", "sphere", (FOOT_RADIUS,)),
        shape("visual", "sphere", (FOOT_RADIUS,), colour=RUBBER),
    ]
    ball = (0.4 * FOOT_MASS * FOOT_RADIUS**2,) * 3
    return [
        *_joint(joint_name(leg, "hfe"), NAMES[pair], upper, hip, "revolute", HIP_RANGE),
        *link(upper, FEMUR_MASS, (0.0, 0.0, -FEMUR / 2), _rod(FEMUR_MASS, FEMUR), femur),
        *_joint(joint_name(leg, "kfe"), upper, lower, knee, "revolute", KNEE_RANGE),
        *link(lower, TIBIA_MASS, middle, _rod(TIBIA_MASS, length), tibia),
        *_joint(f"{leg}_foot_joint", lower, foot, tip, "fixed"),
        *link(foot, FOOT_MASS, ZERO, (*ball, 0.0, 0.0, 0.0), sole),
    ]


def _joint(name: str, parent: str, child: str, at: Vector, kind: str,
           span: tuple[float, float] | None = None) -> list[str]:  # fmt: skip
    lines = [
        f'  <joint name="{name}" type="{kind}">',
        f'    <parent link="{parent}"/><child link="{child}"/><origin xyz="{text(at)}"/>',
    ]
    if span:
        lines += [
            '    <axis xyz="0 -1 0"/>',
            f'    <limit lower="{span[0]:.9g}" upper="{span[1]:.9g}" effort="{EFFORT}" '
            f'velocity="{SPEED}"/>',
        ]
    return [*lines, "  </joint>"]


def _box(mass: float, size: Vector) -> tuple[float, ...]:
    x, y, z = (s * s * mass / 12.0 for s in size)
    return (y + z, x + z, x + y, 0.0, 0.0, 0.0)


def _rod(mass: float, length: float) -> tuple[float, ...]:
    across = mass * (3.0 * RADIUS**2 + length**2) / 12.0
    return (across, across, mass * RADIUS**2 / 2.0, 0.0, 0.0, 0.0)


if __name__ == "__main__":
    (Path(loco_sim.__file__).parent / "assets" / "tigrillo" / "tigrillo.urdf").write_text(write())
