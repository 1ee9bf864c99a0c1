# SPDX-License-Identifier: Apache-2.0
"""Convex model predictive control of the trunk: ground forces over the next steps of a plan.

The robot is one rigid body that the stance feet push. Its state x holds roll, pitch and yaw,
the position and both rates, of the centre of mass and in the horizontal frame, where for small
angles

    x = (a, p, w, v),   (a, p)' = (w, v),   (w, v)' = M u - (0, g)

with forces u on the feet over the weight. The forces of `horizon` steps minimise the sum of
|x - x_d|² and |u|², each error over the one with cost 1, within pyramids of friction; feet that
swing by the gait clock have none. This is a quadratic programme, which OSQP solves.

It is a baseline: its first forces take the place of the springs and dampers of `trunk`.
Sources: Di Carlo et al., IROS 2018 (convex MPC); Stellato et al., 2020 (OSQP). Departures: the
pyramids lie inside the cones; no position on the ground is held; costs were chosen for loco.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..exceptions import MissingPackageError
from ..params import Params, parameter
from ..types import GaitTarget, RobotState

STATES, ROWS = 12, 5  # values of a state; constraints of a foot, the last is its normal force
# OSQP: tolerance in units of the weight, most iterations, iterations between adaptations
TOLERANCE, ITERATIONS, ADAPTATION = 1e-4, 400, 25
TIME_TOLERANCE = 1e-6  # a plan may be made earlier by this, for rounding [s]


@dataclass(frozen=True)
class MpcParams(Params):
    """Model, horizon and costs of the MPC; lengths, times and speeds scale with the robot.

    Source: horizon and steps as in Di Carlo et al., IROS 2018; the body is HyQ's by its URDF, in
    the standing posture; the errors with cost 1 were chosen on HyQ.
    """

    horizon: int = parameter(10, "steps of a plan", low=1, high=50)
    step: float = parameter(0.04, "duration of a step of a plan", "s", low=0.001, high=0.2)
    period: float = parameter(0.008, "time between plans while the same legs stand", "s", low=0.0)
    duty_factor: float = parameter(0.5, "stance share of the stride, as in the gait", "-", 0.2, 0.9)
    friction: float = parameter(0.6, "friction coefficient of a plan", low=0.05, high=2.0)
    limit: float = parameter(1.5, "largest normal force on a foot over the weight", low=0.25)
    gyration: tuple[float, float, float] = parameter(
        (0.217, 0.368, 0.383), "radii of gyration of the robot about x, y and z", "m", low=0.01
    )
    drop: float = parameter(0.048, "height of the base origin over the centre of mass", "m")
    lean: float = parameter(0.2, "error of roll and pitch with cost 1", "rad", low=1e-3)
    turn: float = parameter(0.3, "error of yaw with cost 1", "rad", low=1e-3)
    height: float = parameter(0.05, "error of height with cost 1", "m", low=1e-4)
    spin: float = parameter(1.5, "error of angular velocities with cost 1", "rad/s", low=1e-3)
    velocity: float = parameter(0.5, "error of velocities with cost 1", "m/s", low=1e-3)
    force: float = parameter(10.0, "force with cost 1, over the weight", low=0.1)


class Mpc:
    """Forces of a plan by OSQP, each started from the last plan.

    Args:
        params: Model and costs.
        gravity: Gravity [m/s²].

    Raises:
        MissingPackageError: OSQP is not installed.
    """

    def __init__(self, params: MpcParams, gravity: float):
        try:
            import osqp
            from scipy import sparse
        except ModuleNotFoundError as error:
            raise MissingPackageError(
                f"{error.name} is not installed; it comes with `./loco install mpc`"
            ) from None
        p, n, self._gravity = params, params.horizon, gravity
        self.params, self._slope = p, p.friction / math.sqrt(2.0)
        self.times = p.step * np.arange(1, n + 1)  # ends of the steps, from now [s]
        steps = np.maximum(np.arange(1, n + 1)[:, None] - np.arange(n) - 0.5, 0.0)
        self._to_pose, self._to_rate = p.step**2 * steps, p.step * (steps > 0.0)  # (n, n)
        unbounded = (math.inf, math.inf)
        errors = [p.lean, p.lean, p.turn, *unbounded, p.height, *3 * [p.spin], *3 * [p.velocity]]
        self._weights = np.array(errors) ** -2.0
        self._cost = np.multiply.outer(self._weights[:6], self._to_pose.T @ self._to_pose)
        self._cost += np.multiply.outer(self._weights[6:], self._to_rate.T @ self._to_rate)
        sides = [[x, y, -self._slope] for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))]
        A = sparse.kron(sparse.identity(4 * n), np.array([*sides, [0, 0, 1]]), format="csc")
        self._low, self._high = np.full(A.shape[0], -np.inf), np.zeros(A.shape[0])
        self._low[ROWS - 1 :: ROWS] = 0.0
        self._lower = np.tril_indices(A.shape[1])  # by rows as OSQP's upper triangle by columns
        P = sparse.csc_matrix(np.triu(np.ones((A.shape[1], A.shape[1]))))
        self._solver = osqp.OSQP()
        self._solver.setup(
            *(P, np.zeros(A.shape[1]), A, self._low, self._high),
            **{"eps_abs": TOLERANCE, "eps_rel": TOLERANCE, "max_iter": ITERATIONS},
            **{"adaptive_rho": 1, "adaptive_rho_interval": ADAPTATION, "verbose": False},
        )

    def forces(
        self, state: np.ndarray, desired: np.ndarray, feet: np.ndarray, stance: np.ndarray
    ) -> np.ndarray:
        """Forces on the feet in the first step, over the weight, (4, 3).

        Args:
            state: x now, (12,).
            desired: x_d at the ends of the steps, (n, 12).
            feet: Feet relative to the centre of mass in each step [m], (n, 4, 3).
            stance: Feet on the ground in each step, (n, 4) bool.
        """
        p, n, times = self.params, self.params.horizon, self.times
        M = np.zeros((n, 6, 4, 3))  # accelerations by forces
        M[:, 3:] = np.eye(3)[:, None]
        x, y, z = np.moveaxis(feet, -1, 0)
        M[:, 0, :, 1], M[:, 0, :, 2] = -z, y
        M[:, 1, :, 0], M[:, 1, :, 2] = z, -x
        M[:, 2, :, 0], M[:, 2, :, 1] = -y, x
        M[:, :3] /= np.square(p.gyration)[:, None, None]
        M = self._gravity * M.reshape(n, 6, 12)
        falling = np.tile(state, (n, 1))  # x without forces
        falling[:, :6] += times[:, None] * state[6:]
        falling[:, 5] -= 0.5 * self._gravity * times**2
        falling[:, 11] -= self._gravity * times
        error = self._weights * (falling - desired)
        slope = self._to_pose.T @ error[:, :6] + self._to_rate.T @ error[:, 6:]
        P = np.einsum("jai,ajl,lak->jilk", M, self._cost, M, optimize=True).reshape(12 * n, -1)
        P[np.diag_indices(12 * n)] += p.force**-2.0
        self._high[ROWS - 1 :: ROWS] = np.where(stance, p.limit, 0.0).ravel()
        q = np.einsum("jai,ja->ji", M, slope).ravel()
        self._solver.update(q=q, u=self._high, Px=P[self._lower])
        u = self._solver.solve(raise_error=False).x[:12].reshape(4, 3)
        u[:, 2] = np.clip(u[:, 2], 0.0, np.where(stance[0], p.limit, 0.0))
        bound = self._slope * u[:, 2:]  # OSQP is outside by its tolerance
        return np.concatenate([np.clip(u[:, :2], -bound, bound), u[:, 2:]], axis=1)


class MpcTrunk:
    """Joint torques of the stance legs by the forces of an `Mpc`.

    The trunk goes forwards and turns as the target does; sideways its velocity is held at 0.

    Args:
        params: Model and costs.
        mass: Mass that the legs carry [kg].
        gravity: Gravity [m/s²].
        legs: Geometry, columns named by `legs.geometry.COLUMNS`, (4, 16).

    Raises:
        MissingPackageError: OSQP is not installed.
    """

    def __init__(self, params: MpcParams, mass: float, gravity: float, legs: np.ndarray):
        from ..legs import kinematics  # loads numba
        from . import kernels

        self._kinematics, self._kernels, self._legs = kinematics, kernels, legs
        self._params, self._mass, self._gravity = params, mass, gravity
        self.reset()

    def reset(self) -> None:
        """Discard all plans; the next step makes the first one."""
        self._mpc = Mpc(self._params, self._gravity)
        self._centre: np.ndarray | None = None
        self._due, self._stance = -math.inf, np.zeros(4, dtype=bool)
        self._forces, self._velocity = np.zeros((4, 3)), np.zeros(3)

    def step(
        self,
        state: RobotState,
        target: GaitTarget,
        heading: tuple[float, float],
        stance: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Joint torques [N·m], (12,), and wrench in the horizontal frame [N, N·m], (6,).

        Args:
            state: Readings of the sensors.
            target: References of the gait.
            heading: Desired yaw [rad] and turning rate [rad/s].
            stance: Legs that push, (4,) bool.
        """
        if self._centre is None:  # the robot stands at the first tick
            self._centre = target.foot_position.copy()
        roll, pitch, yaw = self._kernels.roll_pitch_yaw(state.orientation)
        R = self._kernels.rotation_base_to_horizontal(roll, pitch)
        spin, centre = R @ state.angular_velocity, R @ [0.0, 0.0, -self._params.drop]
        feet, J, velocity = self._kinematics.turned_feet(
            state.q.reshape(4, 3), state.dq.reshape(4, 3), R, spin, self._legs
        )
        if (stance & state.contact).any():  # else the last velocity remains
            base = -velocity[stance & state.contact].mean(axis=0)
            self._velocity = base + np.cross(spin, centre)
        if state.t > self._due - TIME_TOLERANCE or (stance != self._stance).any():
            lean = (roll, pitch, self._kernels.wrap_angle(yaw - heading[0]))
            height = (centre - feet[stance])[:, 2].mean()
            current = np.array([*lean, 0.0, 0.0, height, *spin, *self._velocity])
            plan = self._plan(target, heading[1], feet - centre, stance)
            self._forces = self._mass * self._gravity * self._mpc.forces(current, *plan)
            self._due, self._stance = state.t + self._params.period, stance.copy()
        tau = -np.einsum("lij,li->lj", J, self._forces)
        moment = np.cross(feet, self._forces).sum(axis=0)
        return tau.ravel(), np.concatenate([self._forces.sum(axis=0), moment])

    def _plan(
        self, target: GaitTarget, rate: float, feet: np.ndarray, stance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Desired states, feet and stance of all steps, as in `Mpc.forces`."""
        p, times = self._params, self._mpc.times
        desired = np.zeros((p.horizon, STATES))
        desired[:, 2] = rate * times
        desired[:, 5] = -target.foot_position[:, 2].min() - p.drop
        desired[:, [8, 9]] = rate, target.speed
        moving = target.foot_velocity.any()
        phase = target.phase + moving * target.frequency * (times[:, None] - 0.5 * p.step)
        on_ground = (phase % 1.0 < p.duty_factor) | (not moving)
        on_ground[0] = stance
        unmoved = stance & ((phase < p.duty_factor) | (not moving))  # where it is now
        unmoved[0] = True
        where = np.where(unmoved[..., None], feet, self._centre + [0.0, 0.0, p.drop])
        where[..., 0] -= np.where(unmoved, target.speed * (times[:, None] - p.step), 0.0)
        return desired, where, on_ground
