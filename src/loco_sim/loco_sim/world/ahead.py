# SPDX-License-Identifier: Apache-2.0
"""Implicit damping for engines without it: prediction of joint speeds after the next step.

One step of the motion is solved with the mass matrix and the engine's latest contacts:

    (M + dt D) v' = M v + dt (tau + wanted - c) + J' f,    J v' >= 0 _|_ f, within friction,

with D the damping gains and c the bias forces (gravity, Coriolis and centrifugal).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..drives.servo_kernels import DEMAND, GAIN, LIMIT, PASSIVE
from ..geometry import Triple, rotation_matrix
from ..jit import njit
from ..multibody import tree
from ..multibody.dynamics import (
    ALONG,
    AT,
    cross,
    dot,
    dynamics,
    factorise,
    solve,
    vector,
    workshop,
)
from ..robot.description import Description

MADE_OF = "20bdded77032"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py

POINT, NORMAL, SPEED, GIVE, FRICTION, TOUCH = 0, 3, 6, 7, 8, 9  # columns of a contact; their number
SWEEPS = 50  # largest number of iterations over the contacts
SPEED_TOLERANCE = 1e-7  # speed change below which the iterations end [m/s]


class Contact(NamedTuple):
    """A point of the robot in contact with the ground, or close to it."""

    link: str
    point: Triple  # world frame [m]
    normal: Triple  # normal of the ground
    speed: float  # minimum speed along the normal [m/s]
    give: float  # speed per impulse of a compliant contact [1/kg]
    friction: float


class Ahead:
    """Prediction of a robot's next step from its equations of motion."""

    def __init__(
        self, description: Description, joints: tuple[str, ...], fixed: bool, gravity: Triple
    ):
        """Build the equations of motion of a robot.

        Args:
            description: The robot.
            joints: All moving joints.
            fixed: Whether the base is fixed.
            gravity: Acceleration of gravity [m/s²].

        Raises:
            ParameterError: The robot has other moving joints, or links without inertia.
        """
        self._tree, self._order, self._frames = tree.build(description, joints, not fixed)
        self._fixed, self._gravity = fixed, np.array(gravity)
        self._joints = np.argsort(self._order)[: len(joints)]
        self._workspace = workshop(len(self._order))[:2]

    def after(
        self,
        motion: tuple[Sequence[float], Sequence[float]],
        base: tuple[Triple, Sequence[float], Triple, Triple],
        tau: np.ndarray,
        law: np.ndarray,
        contacts: Sequence[Contact],
        dt: float,
    ) -> np.ndarray:
        """Speeds after a step [rad/s], and torques of drives at their limit, else NaN, (2, n).

        Args:
            motion: Joint positions [rad] and velocities [rad/s], (n,) each.
            base: Position, orientation, velocity and angular velocity of the base, world frame.
            tau: Torques in addition to those of `law` [N·m], (n,).
            law: Rows wanted, gain, limit and passive of `World.damped_step`, (4, n).
            contacts: Points where the robot touches the ground.
            dt: Step [s].
        """
        n, order = len(tau), self._order
        size = len(order)
        state, laws = np.zeros((3, size)), np.zeros((4, size))
        state[0, :n], state[1, :n], state[2, :n], laws[:, :n] = *motion, tau, law
        if not self._fixed:
            place, orientation, velocity, spin = base
            turn = np.reshape(rotation_matrix(orientation), (3, 3))
            self._tree.body[0, tree.PLACE : tree.PLACE + 3] = place
            self._tree.body[3, tree.TURN : tree.TURN + 9] = turn.ravel()
            state[1, n:] = *velocity, *(turn.T @ spin)
        bodies = np.array([self._frames[c.link].body for c in contacts], dtype=np.int64)
        touch = np.array([(*c.point, *c.normal, *c[3:]) for c in contacts]).reshape(-1, TOUCH)
        result = stepped(
            self._tree, self._gravity, state[:, order], laws[:, order], bodies, touch, dt,
            self._workspace,
        )  # fmt: skip
        return result[:, self._joints]


@njit(error_model="numpy")
def stepped(tree, gravity, state, law, bodies, touch, dt, workspace):
    """Speeds after a step, and torques of drives at their limit, else NaN, (2, n).

    Args:
        tree: `tree.Tree` of n joints, those of a free base among them.
        gravity: Acceleration of gravity [m/s²], (3,).
        state: Positions, velocities and torques, (3, n).
        law: Rows wanted, gain, limit and passive, (4, n).
        bodies: Joint of the body of each contact, (k,).
        touch: Contacts, columns `POINT` to `FRICTION`, (k, TOUCH).
        dt: Step [s].
        workspace: First two arrays of `dynamics.workshop`.
    """
    links, matrix = workspace
    n, rows = len(law[0]), 3 * len(bodies)
    q, dq, bias = state[0], state[1], np.empty(n)
    dynamics(tree, gravity, q, dq, links, matrix, bias)
    jacobian = directions(tree[0], links, bodies, touch)
    saturated, result = np.full(n, np.nan), np.empty((2, n))
    for _ in range(n + 1):
        factor, answer = matrix.copy(), np.empty((rows + 1, n))
        for i in range(n):
            for k in range(rows):
                answer[k, i] = jacobian[k, i]
            slope, drive = law[PASSIVE, i], saturated[i]
            if np.isnan(drive):
                slope, drive = slope + law[GAIN, i], law[DEMAND, i]
            momentum = dt * (state[2, i] + drive - bias[i])
            for j in range(n):
                momentum += matrix[i, j] * dq[j]
            answer[rows, i] = momentum
            factor[i, i] += dt * slope
        factorise(tree[0], factor)
        for k in range(rows + 1):
            solve(tree[0], factor, answer, k)
        speed = answer[rows].copy()
        if rows:
            impulses = contact_impulses(jacobian @ answer[:rows].T, jacobian @ speed, touch)
            speed += impulses @ answer[:rows]
        over = False
        for i in range(n):
            torque = law[DEMAND, i] - law[GAIN, i] * speed[i]
            if np.isnan(saturated[i]) and abs(torque) > law[LIMIT, i]:
                saturated[i], over = np.copysign(law[LIMIT, i], torque), True
        if not over:
            break
    result[0], result[1] = speed, saturated
    return result


@njit(error_model="numpy")
def directions(kin, links, bodies, touch):
    """Jacobian of the contacts: normal and two tangential speeds per joint speed, (3 k, n)."""
    jacobian = np.zeros((3 * len(bodies), len(kin)))
    for k in range(len(bodies)):
        point, normal = vector(touch, k, POINT), vector(touch, k, NORMAL)
        side = (0.0, 1.0, 0.0) if abs(normal[1]) < 0.7 else (1.0, 0.0, 0.0)
        first = cross(side, normal)
        length = np.sqrt(dot(first, first))
        first = first[0] / length, first[1] / length, first[2] / length
        second = cross(normal, first)
        j = bodies[k]
        while j >= 0:
            at, along = vector(links, j, AT), vector(links, j, ALONG)
            moved = along
            if not kin[j, 1]:
                moved = cross(along, (point[0] - at[0], point[1] - at[1], point[2] - at[2]))
            jacobian[3 * k, j] = dot(normal, moved)
            jacobian[3 * k + 1, j] = dot(first, moved)
            jacobian[3 * k + 2, j] = dot(second, moved)
            j = kin[j, 0]
    return jacobian


@njit(error_model="numpy")
def contact_impulses(answer, speed, touch):
    """Impulses of the contacts, (3 k,), by Gauss-Seidel sweeps.

    Args:
        answer: Speed of each row per impulse of each row, (3 k, 3 k).
        speed: Speeds without impulses, (3 k,); changed.
        touch: Contacts, columns `POINT` to `FRICTION`, (k, TOUCH).
    """
    impulse = np.zeros(len(speed))
    for _ in range(SWEEPS):
        moved = 0.0
        for row in range(len(speed)):
            k, direction = row // 3, row % 3
            diagonal = answer[row, row]
            if direction == 0:
                diagonal += touch[k, GIVE]
                short = touch[k, SPEED] - speed[row] - touch[k, GIVE] * impulse[row]
                target = max(0.0, impulse[row] + short / diagonal)
            else:
                max_impulse = touch[k, FRICTION] * impulse[row - direction]
                target = min(max(impulse[row] - speed[row] / diagonal, -max_impulse), max_impulse)
            change = target - impulse[row]
            if change != 0.0:
                impulse[row] = target
                speed += change * answer[:, row]
                moved = max(moved, abs(change) * diagonal)
        if moved <= SPEED_TOLERANCE:
            break
    return impulse
