# SPDX-License-Identifier: Apache-2.0
"""Answers of the RCF to the state of the trunk: kinematic adjustment and push recovery.

The thesis had both switched off, so that its gait is an open loop (section 4.3.3).

- **Kinematic adjustment.** The gait plans its feet and their velocities in the horizontal frame
  under the trunk. If the trunk leans by roll and pitch, both are turned back by that.
- **Push recovery.** A swing foot steps farther by d = k sqrt(h / g) (v - V): the capture point
  of a pendulum of height h that moves at v instead of V, for k = 1.

Sources: Barasuol et al., ICRA 2013 (RCF); Pratt et al., Humanoids 2006 (capture point). Departures:
v is the mean over the stance feet of the velocity that their joints and the gyroscope tell, through
one lag; constants were chosen for loco.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ..legs.kinematics import turned_feet
from ..orientation import roll_pitch_yaw, rotation_base_to_horizontal

GRAVITY = 9.81  # [m/s²]


@njit(cache=True)
def lean_of(orientation, share, limit):
    """Roll and pitch [rad], (2,), by which the feet are turned back: `share` of those of the trunk.

    Args:
        orientation: Base to world, x y z w, (4,).
        share: Share of roll and pitch, 0 to 1.
        limit: Largest angle of each [rad].
    """
    roll, pitch, _ = roll_pitch_yaw(orientation)
    return np.array([min(max(share * angle, -limit), limit) for angle in (roll, pitch)])


@njit(cache=True)
def turned_back(feet, velocity, lean):
    """Feet [m] and velocities [m/s] of the horizontal frame in a base that leans, (4, 3) each.

    Args:
        feet: Positions in the horizontal frame under the trunk [m], (4, 3).
        velocity: Velocities in this frame [m/s], (4, 3).
        lean: Roll and pitch of the base [rad], (2,); at 0 nothing changes, in no bit.
    """
    if lean[0] == 0.0 and lean[1] == 0.0:
        return feet, velocity
    R = rotation_base_to_horizontal(lean[0], lean[1])
    return feet @ R, velocity @ R  # rows: R^T p


@njit(cache=True)
def trunk_velocity(q, dq, orientation, angular_velocity, standing, legs):
    """Velocity of the trunk forwards and to the left [m/s], (2,), by the feet that stand.

    Args:
        q: Joint positions [rad], (12,).
        dq: Joint velocities [rad/s], (12,).
        orientation: Base to world, x y z w, (4,).
        angular_velocity: Base frame [rad/s], (3,).
        standing: Feet that stand without slipping, (4,) bool, one at least.
        legs: Leg geometry, columns named by `legs.geometry.COLUMNS`, (4, 16).
    """
    roll, pitch, _ = roll_pitch_yaw(orientation)
    R = rotation_base_to_horizontal(roll, pitch)
    spin = R @ angular_velocity
    _, _, velocity = turned_feet(q.reshape(4, 3), dq.reshape(4, 3), R, spin, legs)
    total = np.zeros(2)
    for leg in range(4):
        if standing[leg]:
            total -= velocity[leg, :2]
    return total / standing.sum()


@njit(cache=True)
def step_shift(error, height, gain, limit):
    """Shift of the steps [m], (2,), that answers an error of the trunk's velocity.

    Args:
        error: Velocity minus requested velocity, forwards and to the left [m/s], (2,).
        height: Height of the trunk over the feet [m].
        gain: Share of the shift to the capture point.
        limit: Largest shift [m].
    """
    shift = gain * math.sqrt(height / GRAVITY) * error
    size = math.hypot(shift[0], shift[1])
    return shift * (limit / size) if size > limit else shift
