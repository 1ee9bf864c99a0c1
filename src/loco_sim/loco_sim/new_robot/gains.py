# SPDX-License-Identifier: Apache-2.0
"""Gains of joint impedances that carry a robot and are stable at the physics step.

A joint carries I = M (r² with the lever arm r to a foot, M its share of the mass) and holds
the torque T of the weight. Its stiffness is the largest of

    kp = T / sag,      kp = I (2 pi f)²,      kp = 2 pi f d      and      kp = 3 k

(d its passive damping and k its spring, which would hold it back),

its damping kd = 2 z sqrt(kp I), but at most `DAMPING` I_free / dt, where I_free is the
inertia that the joint feels when its limb is in the air: damping that is computed at the
start of a step diverges at 2. What is too light for half of the damping gets an armature.
An armature stands for the rotor and gear that every geared joint has and few URDFs tell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..drives.stability import stability_ratio
from ..robot.equipment import GRAVITY
from .body import Body

SAG = 0.03  # that a joint gives way under the weight [rad]
SLIDE_SAG = 0.003  # the same of a slide [m]
FREQUENCY = 2.5  # of a joint with what it carries [Hz]
AGAINST = 3.0  # times the spring of a joint that its drive is as stiff as
DAMPING_RATIO = 0.7
DAMPING = 0.4  # largest kd dt / I
STEPS = 8  # sub-steps that gains may cost
PHYSICS_RATE = 1000.0  # [Hz]
LEAST = 1e-5  # inertia of a joint below which it gets an armature [kg·m²]


@dataclass(frozen=True)
class Gains:
    """Impedances of all joints.

    Attributes:
        kp: Stiffness [N·m/rad or N/m], (n,); 0 of wheels.
        kd: Damping [N·m·s/rad or N·s/m], (n,).
        armature: Inertia to be added about the axis [kg·m² or kg], (n,).
        steps: Sub-steps of a physics step that they need.
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
) -> Gains:
    """Gains for a posture.

    Args:
        body: The robot.
        q: The posture, (n,).
        feet: Points of contact, base frame [m], (m, 3).
        bodies: Bodies that stand, m.
        wheels: Joints that are wheels, with a velocity loop only.
        bolted: The base is fixed to the world.
        stiffer: Factor on the stiffness.
    """
    tau = np.abs(body.weight_torque(q, [] if bolted else bodies, feet))
    inertia = body.inertia(q, bolted)
    held = np.diag(inertia).copy()  # with all other joints locked
    if not bolted:
        held = np.maximum(held, _carried(body, q, feet, bodies))
    tau = np.where(body.slides, np.maximum(tau, GRAVITY * np.diag(inertia)), tau)  # upright once
    sag = np.where(body.slides, SLIDE_SAG, SAG)
    pace = 2.0 * np.pi * FREQUENCY
    least = np.maximum(body.damping * pace, AGAINST * body.stiffness)
    kp = stiffer * np.maximum.reduce([tau / sag, held * pace**2, least])
    kd = 2.0 * DAMPING_RATIO * np.sqrt(kp * held)
    # A wheel follows a speed; it stops the robot within a second or so.
    kp[wheels] = 0.0
    kd[wheels] = pace * held[wheels]
    dt = 1.0 / (PHYSICS_RATE * STEPS)
    free = 1.0 / np.diag(np.linalg.inv(inertia))
    need = np.maximum((0.5 * kd + body.damping) * dt / DAMPING, LEAST)
    need[body.slides] = 0.0  # a rotor is no mass
    armature = np.where(free < need, need - free, 0.0)
    inertia = inertia + np.diag(armature)
    kd = np.minimum(kd, DAMPING * (free + armature) / dt)
    ratio = stability_ratio(kd + body.damping, dt, inertia)
    kd *= min(1.0, DAMPING / ratio)
    ratio = stability_ratio(kd + body.damping, 1.0 / PHYSICS_RATE, inertia)
    return Gains(kp, kd, armature, max(1, int(np.ceil(ratio / 0.5 - 1e-9))))


def _carried(body: Body, q: np.ndarray, feet: np.ndarray, bodies: list[int]) -> np.ndarray:
    """Inertia of each joint's share of the robot, with the lever arm of its foot [kg·m²], (n,)."""
    frames, share = body.forward(q), body.mass.sum() / max(1, len(bodies))
    carried = np.zeros(len(body.joints))
    for k, point in zip(bodies, feet, strict=True):
        arm = body.jacobian(k, np.asarray(point), frames)
        carried = np.maximum(carried, share * np.sum(arm**2, axis=0))
    return carried
