# SPDX-License-Identifier: Apache-2.0
"""Four coupled oscillators and the filter that turns them into foot paths.

Each leg has an oscillator with the state (x, z), here in units of its ellipse
(x of half a step length L/2, z of the step height H), so that the cycle is the
unit circle whatever the step is, also in place (L = 0):

    E  = 1 - x² - z²
    x' = alpha E x + w z
    z' = alpha E z - w x + K Σ_j (cos d_ij z_j - sin d_ij x_j)
    w  = pi f / D [ D / (1 - D) s(b z) k_v + s(-b z) ],   s(u) = 1 / (1 + e^-u)

z > 0 is swing, z < 0 stance; x falls from +1 at touchdown to -1 at lift-off.
d_ij is the phase by which leg i leads leg j. The foot follows its oscillator
in swing and leaves it in stance, where it goes back with the speed V of the trunk:

    p' = s(b z) [ c' + k_c (c + d - p) ] - (1 - s(b z)) (V, 0),   c = (L x / 2, H z)

d shifts the steps of a push recovery (`recovery`), else 0.

The trunk may walk sideways and turn too: V is then the velocity of the trunk where the foot
is, v + w x p, forwards and sideways, and each leg steps along its own.

The sum over the other legs is held over a control period. Coupled like this a
trot of nominally 1.7 Hz steps at 1.693 Hz, as the author's recordings do.
Source: Barasuol et al., ICRA 2013 (RCF), constants of the author's set-up.
Departures: pi is exact (3.14 there: -0.05 % frequency); plain Euler sub-steps;
the coupling has a sine term, which is zero for trot, bound and pace and locks
the quarter phases of a walk; one sign of the bound matrix there is taken for a slip.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..legs.kinematics import inverse
from .recovery import turned_back

SPEED, FREQUENCY, DUTY, HEIGHT, LATERAL, YAW = range(6)  # indices into the vector `gait`
X, Z, Y = range(3)  # columns of a foot path
SHAPE = ("coupling", "convergence", "sharpness", "swing_skew", "filter_gain")  # shape of the stride
SEED_RADIUS = 3e-3  # radius from which the cycle grows when the gait starts [-]
MAX_FOOT_SPEED = 10.0  # largest speed of a foot [m/s]


def coupling_matrices(offsets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine of d_ij for all pairs of legs, each (4, 4), zero on the diagonal.

    Args:
        offsets: Phase of each leg when leg 0 touches down, in strides, (4,).
    """
    lead = 2.0 * np.pi * np.subtract.outer(offsets, offsets)
    cosine, sine = np.cos(lead), np.sin(lead)
    np.fill_diagonal(cosine, 0.0)
    return np.round(cosine, 12), np.round(sine, 12)


def seed_state(offsets: np.ndarray) -> np.ndarray:
    """Small oscillator states (x, z) with the phases `offsets` [strides], (4, 2)."""
    angle = 2.0 * np.pi * np.asarray(offsets)
    return SEED_RADIUS * np.stack([np.cos(angle), -np.sin(angle)], axis=1)


@njit(cache=True)
def stride_phase(state, duty):
    """Stride phase of each leg, (4,): 0 at touchdown, `duty` at lift-off, linear in time."""
    phase = np.empty(4)
    for leg in range(4):
        half_turns = math.atan2(-state[leg, 1], state[leg, 0]) / math.pi  # 0 touchdown, 1 lift-off
        if half_turns >= 0.0:
            phase[leg] = duty * half_turns
        else:
            phase[leg] = min(1.0 + (1.0 - duty) * half_turns, 1.0 - 1e-12)
    return phase


@njit(cache=True)
def sigmoid(u):
    """1 / (1 + e^-u) without overflow."""
    return 0.5 * (1.0 + math.tanh(0.5 * u))


@njit(cache=True)
def advance(state, foot, gait, cosine, sine, shape, dt, substeps, centre, shift):
    """Advance oscillators and feet by one control period, in place; return the foot velocity.

    Args:
        state: Oscillators (x, z) in units of their ellipse, (4, 2).
        foot: Foot paths (x, z, y) about the foot centre [m], (4, 3).
        gait: speed [m/s], frequency [Hz], duty factor [-], step height [m], speed to the left
            [m/s] and turning rate to the left [rad/s], (6,).
        cosine: cos of the desired phase leads, (4, 4).
        sine: sin of the desired phase leads, (4, 4).
        shape: K, alpha [1/s], b, k_vf and k_c [1/s], named by `SHAPE`, (5,).
        dt: Control period [s].
        substeps: Euler steps per period.
        centre: Foot centres in the base frame [m], (4, 3).
        shift: Shift of the swing feet forwards and to the left [m], (2,).
    """
    gain, alpha, sharp, skew, pull = shape[0], shape[1], shape[2], shape[3], shape[4]
    duty, height, h = gait[DUTY], gait[HEIGHT], dt / substeps
    stance_rate = math.pi * gait[FREQUENCY] / duty
    d_state, d_foot, correction = np.empty((4, 2)), np.empty((4, 3)), np.zeros(4)
    for leg in range(4):  # the coupling is updated once per control period
        for other in range(4):
            coupling_sum = cosine[leg, other] * state[other, 1] - sine[leg, other] * state[other, 0]
            correction[leg] += gain * coupling_sum
    for _ in range(substeps):
        for leg in range(4):
            x, z = state[leg, 0], state[leg, 1]
            up, energy = sigmoid(sharp * z), alpha * (1.0 - x * x - z * z)
            forward = sigmoid(sharp * x)  # k_v: fast early swing, slow late swing
            k_v = (1.0 - forward) * skew + forward * skew / (2.0 * skew - 1.0)
            rate = stance_rate * (duty / (1.0 - duty) * up * k_v + 1.0 - up)
            d_state[leg, 0] = energy * x + rate * z
            d_state[leg, 1] = energy * z - rate * x + correction[leg]
            v_z = height * d_state[leg, 1] + pull * (height * z - foot[leg, Z])
            forward_speed = gait[SPEED] - gait[YAW] * (centre[leg, 1] + foot[leg, Y])
            left = gait[LATERAL] + gait[YAW] * (centre[leg, 0] + foot[leg, X])
            d_foot[leg, Z] = up * v_z
            for axis, speed, moved in ((X, forward_speed, shift[0]), (Y, left, shift[1])):
                half_step = 0.5 * speed * duty / gait[FREQUENCY]
                ahead = half_step * x + moved - foot[leg, axis]
                swing = half_step * d_state[leg, 0] + pull * ahead
                d_foot[leg, axis] = up * swing - (1.0 - up) * speed
            for axis in range(3):
                d_foot[leg, axis] = min(max(d_foot[leg, axis], -MAX_FOOT_SPEED), MAX_FOOT_SPEED)
        for leg in range(4):
            for axis in range(2):
                state[leg, axis] += h * d_state[leg, axis]
            for axis in range(3):
                foot[leg, axis] += h * d_foot[leg, axis]
    return d_foot


@njit(cache=True)
def smooth(gait, halfway, target_gait, blend, moving):
    """Move `gait` towards `target_gait`, each (6,), through two lags, in place.

    Args:
        gait: Parameters that the oscillators follow.
        halfway: Output of the first lag, (6,).
        target_gait: Requested parameters.
        blend: Fraction of the remaining difference that each lag covers per control period.
        moving: Whether the robot moves; at rest all parameters except the speeds change at once.
    """
    for i in range(6):
        if moving:
            halfway[i] += blend * (target_gait[i] - halfway[i])
            gait[i] += blend * (halfway[i] - gait[i])
        elif i not in (SPEED, LATERAL, YAW):
            halfway[i] = gait[i] = target_gait[i]


@njit(cache=True)
def target(
    moving, memory, shift, lean, target_gait, blend, coupling, shape, dt, substeps, centre, legs
):
    """One control period of the generator: the fields of a `GaitTarget` after its time.

    Args:
        moving: Whether the gait has begun; before, the robot stands on its foot centres.
        memory: `state` and `foot` of `advance`, `gait` and `halfway` of `smooth`; all four
            are changed in place.
        shift: Shift of the steps by a push recovery, as in `advance`.
        lean: Roll and pitch by which the feet are turned back [rad], (2,).
        target_gait: Requested parameters, as in `smooth`.
        blend: Fraction of the change per period, as in `smooth`.
        coupling: Coupling, from `coupling_matrices`.
        shape: Shape of the stride, as in `advance`.
        dt: Control period [s].
        substeps: Euler steps per period.
        centre: Foot centres in the base frame [m], (4, 3).
        legs: Leg geometry, columns named by `legs.geometry.COLUMNS`, (4, 16).
    """
    state, foot, gait, halfway = memory
    feet, velocity, stance = centre.copy(), np.zeros((4, 3)), np.ones(4, dtype=np.bool_)
    smooth(gait, halfway, target_gait, blend, moving)
    if moving:
        foot_velocity = advance(state, foot, gait, *coupling, shape, dt, substeps, centre, shift)
        for leg in range(4):
            for i, axis in enumerate((0, 2, 1)):  # x, z and y
                feet[leg, axis] += foot[leg, i]
                velocity[leg, axis] = foot_velocity[leg, i]
            velocity[leg, 1] += 0.0  # turns -0.0 into 0.0
            stance[leg] = state[leg, 1] <= 0.0
    q, dq = inverse(*turned_back(feet, velocity, lean), legs)
    phase = stride_phase(state, gait[DUTY])
    return q, dq, feet, velocity, phase, gait[SPEED], gait[FREQUENCY], stance
