# SPDX-License-Identifier: Apache-2.0
"""Choice of joint impedance gains that carry a robot and are stable at the physics step.

A joint carries I = M (r² with the lever arm r to a foot, M its share of the mass) and holds
the torque T of the weight and its dry friction. Its stiffness is the largest of

    kp = T / sag,      kp = I (2 pi f)²,      kp = 2 pi f d      and      kp = 3 k

(d its passive damping and k the stiffness of its spring, which oppose the drive),

its damping kd = 2 z sqrt(kp I), but at most `DAMPING` I_free / dt, where I_free is the
inertia at the joint when its limb is in the air: explicit damping diverges at
kd dt / I_free = 2. A joint too light for half of the damping gets an armature, the inertia of
rotor and gear, which few URDFs include.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..drives.stability import stability_ratio
from ..robot.equipment import GRAVITY
from .body import Body

SAG = 0.03  # deflection of a joint under the weight [rad]
SLIDE_SAG = 0.003  # deflection of a prismatic joint under the weight [m]
FREQUENCY = 2.5  # natural frequency of a joint with its load [Hz]
AGAINST = 3.0  # stiffness of the drive / stiffness of the joint's spring
DAMPING_RATIO = 0.7
DAMPING = 0.4  # largest kd dt / I
STEPS = 8  # largest number of sub-steps for the gains
PHYSICS_RATE = 1000.0  # [Hz]
MIN_INERTIA = 1e-5  # joint inertia below which an armature is added [kg·m²]


@dataclass(frozen=True)
class Gains:
    """Impedances of all joints.

    Attributes:
        kp: Stiffness [N·m/rad or N/m], (n,); 0 of wheels.
        kd: Damping [N·m·s/rad or N·s/m], (n,).
        armature: Additional inertia about the joint axis [kg·m² or kg], (n,).
        steps: Number of sub-steps per physics step that the gains need.
    """

    kp: np.ndarray
    kd: np.ndarray
    armature: np.ndarray
    steps: int


def choose(
    body: Body,
    q: np.ndarray,
    feet: np.ndarray,
    bodies: list[int],
    wheels: list[int],
    bolted: bool,
    stiffer: float = 1.0,
    preset: Mapping[str, tuple[float, float]] | None = None,
) -> Gains:
    """Gains for a posture.

    Args:
        body: The robot.
        q: The posture, (n,).
        feet: Points of contact, base frame [m], (m, 3).
        bodies: Bodies in ground contact, m.
        wheels: Wheel joints, with a velocity loop only.
        bolted: Whether the base is fixed to the world.
        stiffer: Scale factor of the stiffness.
        preset: Stiffness and damping of joints by name, which are kept; a damping of 0 is chosen,
            and one beyond what the steps allow is reduced.
    """
    tau = np.abs(body.weight_torque(q, [] if bolted else bodies, feet)) + body.friction
    inertia = body.inertia(q, bolted)
    held = np.diag(inertia).copy()  # inertia with all other joints locked
    if not bolted:
        held = np.maximum(held, _load_torque(body, q, feet, bodies))
    tau = np.where(body.slides, np.maximum(tau, GRAVITY * np.diag(inertia)), tau)  # as if vertical
    sag = np.where(body.slides, SLIDE_SAG, SAG)
    pace = 2.0 * np.pi * FREQUENCY
    min_stiffness = np.maximum(body.damping * pace, AGAINST * body.stiffness)
    kp = stiffer * np.maximum.reduce([tau / sag, held * pace**2, min_stiffness])
    fixed = [(i, preset[j]) for i, j in enumerate(body.joints) if preset and j in preset]
    for i, (stiffness, _) in fixed:
        kp[i] = stiffness
    kd = 2.0 * DAMPING_RATIO * np.sqrt(kp * held)
    for i, (_, damping) in fixed:
        kd[i] = damping or kd[i]
    # A wheel tracks a speed; its gain stops the robot within about a second.
    kp[wheels] = 0.0
    kd[wheels] = pace * held[wheels]
    dt = 1.0 / (PHYSICS_RATE * STEPS)
    free = 1.0 / np.diag(np.linalg.inv(inertia))
    need = np.maximum((0.5 * kd + body.damping) * dt / DAMPING, MIN_INERTIA)
    need[body.slides] = 0.0  # an armature does not apply to prismatic joints
    armature = np.where(free < need, need - free, 0.0)
    inertia = inertia + np.diag(armature)
    kd = np.minimum(kd, DAMPING * (free + armature) / dt)
    ratio = stability_ratio(kd + body.damping, dt, inertia)
    kd *= min(1.0, DAMPING / ratio)
    ratio = stability_ratio(kd + body.damping, 1.0 / PHYSICS_RATE, inertia)
    return Gains(kp, kd, armature, max(1, int(np.ceil(ratio / 0.5 - 1e-9))))


def _load_torque(body: Body, q: np.ndarray, feet: np.ndarray, bodies: list[int]) -> np.ndarray:
    """Inertia of each joint's share of the robot at the lever arm of its foot [kg·m²], (n,)."""
    frames, share = body.forward(q), body.mass.sum() / max(1, len(bodies))
    inertia = np.zeros(len(body.joints))
    for k, point in zip(bodies, feet, strict=True):
        arm = body.jacobian(k, np.asarray(point), frames)
        inertia = np.maximum(inertia, share * np.sum(arm**2, axis=0))
    return inertia
