# SPDX-License-Identifier: Apache-2.0
"""Target generator: stride clock, foot paths and joint references of a gait.

The arithmetic is in `cpg` (oscillators and filter) and `kinematics` (joints);
here are the parameters, the patterns and the smooth changes at run time.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ..exceptions import NameUnknownError, ParameterError
from ..legs.geometry import FRONT, HIP_X, HYQ, LEFT
from ..params import Params, parameter
from ..types import GaitTarget, RobotState

PATTERNS = {  # phase of lf rf lh rh when lf touches down [strides]
    "trot": (0.0, 0.5, 0.5, 0.0),
    "walk": (0.0, 0.5, 0.25, 0.75),  # lh lf rh rf, a quarter stride apart
    "bound": (0.0, 0.0, 0.5, 0.5),
    "pace": (0.0, 0.5, 0.0, 0.5),
}
# Parameters that may change at run time, in the order of the vector `gait` of `cpg.advance`.
LIVE = ("speed", "frequency", "duty_factor", "step_height", "lateral_speed", "yaw_rate")
TWIST = ("speed", "lateral_speed", "yaw_rate")  # components of the trunk's twist
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])  # orientation of a level trunk, x y z w
HALVINGS = 7  # bisection steps for an unreachable twist; the largest reachable share is met to 1 %


@dataclass(frozen=True)
class GaitParams(Params):
    """Gait of the RCF generator; the defaults are the thesis's simulated trot.

    Source: thesis section 4.3.3; Barasuol et al., ICRA 2013 (RCF).
    """

    pattern: str = parameter("trot", "order in which the legs step", choices=tuple(PATTERNS))
    speed: float = parameter(0.25, "forward speed of the trunk", "m/s", low=-1.0, high=1.0)
    lateral_speed: float = parameter(0.0, "speed of the trunk to the left", "m/s", -1.0, 1.0)
    yaw_rate: float = parameter(0.0, "turning rate of the trunk to the left", "rad/s", -2.0, 2.0)
    frequency: float = parameter(1.7, "stride frequency without coupling", "Hz", low=0.2, high=4.0)
    duty_factor: float = parameter(0.5, "stance share of the stride", low=0.2, high=0.9)
    step_height: float = parameter(0.10, "foot clearance of the swing", "m", low=0.005, high=0.3)
    origin: tuple[float, float, float] = parameter(
        (0.375, 0.28, -0.60), "foot centre: |x|, |y| and z in the base frame", "m"
    )
    start_time: float = parameter(1.0, "time before which the robot stands", "s", low=0.0)
    smoothing: float = parameter(0.25, "time constant of two lags on each change", "s", low=0.0)
    coupling: float = parameter(0.5, "gain of the coupling of the legs", low=0.0, high=10.0)
    convergence: float = parameter(40.0, "alpha, convergence rate", "1/s", low=1.0, high=400.0)
    sharpness: float = parameter(50.0, "b, steepness of the swing/stance switch", low=1.0)
    swing_skew: float = parameter(1.0, "k_vf, early over late swing speed", low=0.6, high=10.0)
    filter_gain: float = parameter(60.0, "k_c, gain of a swing foot to its oscillator", "1/s", 0.0)
    substeps: int = parameter(20, "integration steps per control period", low=1, high=1000)
    adjustment: float = parameter(
        0.0, "kinematic adjustment: share of roll and pitch by which feet turn back", "-", 0.0, 1.0
    )
    adjustment_limit: float = parameter(0.35, "largest angle of the adjustment", "rad", 0.0, 1.0)
    recovery: float = parameter(
        0.0, "push recovery: share of the way to the capture point", "-", 0.0, 3.0
    )
    recovery_limit: float = parameter(
        0.25, "largest shift of a step by the recovery", "m", 0.0, 1.0
    )
    recovery_lag: float = parameter(0.05, "lag of the velocity for the recovery", "s", low=0.0)
    schedule: list[dict[str, float]] | None = parameter(
        None,
        "list of {time, speed?, frequency?, duty_factor?, step_height?, lateral_speed?, "
        "yaw_rate?}, applied at their times",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not isinstance(self.schedule, (list, tuple, type(None))):
            raise ParameterError(f"GaitParams.schedule must be a list, got {self.schedule!r}")
        for change in self.schedule or ():
            _check_change(self, change)


def _check_change(params: GaitParams, change: Any) -> None:
    time = change.get("time") if isinstance(change, dict) else None
    if not isinstance(time, (int, float)) or not time >= 0.0:
        raise ParameterError(f"each change in GaitParams.schedule needs a time [s], got {change!r}")
    params.replace(schedule=None, **_live({k: v for k, v in change.items() if k != "time"}))


def _live(changes: dict[str, float]) -> dict[str, float]:
    for name in changes:
        if name not in LIVE:
            raise NameUnknownError("gait parameter that changes at run time", name, LIVE)
    return changes


def foot_centres(origin: tuple[float, float, float], legs: np.ndarray | None = None) -> np.ndarray:
    """Foot centres in the base frame [m], (4, 3), from |x|, |y| and z of one of them.

    |x| counts from the middle between the hips of `legs` (HyQ's by default), (4, 16).
    """
    (x, y, z), middle = origin, 0.25 * float((HYQ if legs is None else legs)[:, HIP_X].sum())
    return np.stack([x * FRONT + middle, y * LEFT, np.full(4, z)], axis=1)


def standing_pose(origin: tuple[float, float, float], legs: np.ndarray | None = None) -> np.ndarray:
    """Joint positions of the robot standing on its foot centres [rad], (12,).

    Args:
        origin: Foot centre, as in `GaitParams`.
        legs: Geometry, columns named by `legs.geometry.COLUMNS`, (4, 16); default HyQ's.

    Raises:
        ParameterError: The foot centres are out of reach.
    """
    from ..legs import kinematics

    legs = HYQ if legs is None else legs
    return kinematics.joint_position(foot_centres(origin, legs), legs)


class TargetGenerator:
    """Foot paths and joint references of a gait, one `step` per control period.

    The robot stands until `start_time`; then the oscillators grow from a small
    seed and the speed rises from zero. Changes by `set` or by the schedule are
    smoothed by two cascaded lags.

    Args:
        params: The gait.
        dt: Control period [s].
        legs: Geometry, columns named by `legs.geometry.COLUMNS`, (4, 16); default HyQ's.

    Attributes:
        standing: Joint positions of the robot standing on its foot centres [rad], (12,).

    Raises:
        ParameterError: The foot centres or the steps are out of reach.
    """

    def __init__(self, params: GaitParams, dt: float, legs: np.ndarray | None = None):
        # Kernels are imported here so that reading an experiment does not load numba.
        from ..legs import kinematics
        from . import cpg, recovery

        self.params, self.dt = params, float(dt)
        self._cpg, self._kinematics, self._recovery = cpg, kinematics, recovery
        self._legs = HYQ if legs is None else legs
        self._centre = foot_centres(params.origin, self._legs)
        self.standing = standing_pose(params.origin, self._legs)
        self._offsets = np.array(PATTERNS[params.pattern])
        self._schedule = self._planned(params)
        blend, self._blend = (
            1.0 - np.exp(-dt / lag) if lag > 0.0 else 1.0
            for lag in (params.smoothing, params.recovery_lag)
        )  # fmt: skip
        shape = np.array([getattr(params, name) for name in cpg.SHAPE])
        self._constants = (
            *(float(blend), cpg.coupling_matrices(self._offsets), shape, self.dt, params.substeps),
            *(self._centre, self._legs),
        )
        self.reset()
        at_rest = (self.standing, np.zeros(12), UPRIGHT, np.zeros(3), np.ones(4, dtype=bool))
        self._target(True, *self._responses(*at_rest))  # compile now, not in the first tick
        self.reset()

    def reset(self) -> None:
        """Return to standing at time 0 and discard changes made by `set`."""
        self._goal = self.params.replace(schedule=None)
        self._changes = list(self._schedule)
        self._setpoint = self._vector(self._goal)
        gait = self._setpoint.copy()
        gait[[self._cpg.SPEED, self._cpg.LATERAL, self._cpg.YAW]] = 0.0
        self._error, self._stance = np.zeros(2), np.ones(4, dtype=bool)
        self._memory = (self._cpg.seed_state(self._offsets), np.zeros((4, 3)), gait, gait.copy())

    def set(self, **changes: float) -> None:
        """Change parameters named in `LIVE`, smoothly from the next step on.

        Raises:
            NameUnknownError: The parameter cannot change at run time.
            ParameterError: The value is out of range, or its steps exceed the reach of the legs.
        """
        goal = self._goal.replace(**_live(changes))
        self._setpoint = self._vector(goal)
        self._goal = goal

    def follow(self, speed: float, lateral_speed: float, yaw_rate: float) -> dict[str, float]:
        """Request a twist of the trunk, scaled down to what the reach of the legs allows.

        Args:
            speed: Speed forwards [m/s].
            lateral_speed: Speed to the left [m/s].
            yaw_rate: Rate of turning to the left [rad/s].

        Returns:
            The twist that is followed, by the names in `TWIST`.

        Raises:
            ParameterError: A value is not finite.
        """
        requested = dict(zip(TWIST, (speed, lateral_speed, yaw_rate), strict=True))
        if not np.isfinite(list(requested.values())).all():
            raise ParameterError(f"the velocity of the trunk must be finite, got {requested}")
        limits = {f.name: f.metadata["high"] for f in fields(GaitParams) if f.name in TWIST}
        share = 1.0 / max(1.0, *(abs(requested[name]) / limits[name] for name in TWIST))
        if not self._takes(requested, share):
            low, high = 0.0, share
            for _ in range(HALVINGS):
                share = 0.5 * (low + high)
                low, high = (share, high) if self._takes(requested, share) else (low, share)
            share = low
            self._takes(requested, share)
        return {name: share * value for name, value in requested.items()}

    def _takes(self, twist: dict[str, float], share: float) -> bool:
        """Set `share` times a twist; False if that exceeds the reach of the legs."""
        try:
            self.set(**{name: share * value for name, value in twist.items()})
        except ParameterError:
            return False
        return True

    def step(self, state: RobotState) -> GaitTarget:
        """Target for the tick of `state`; call it once per tick."""
        while self._changes and state.t >= self._changes[0][0] - 0.5 * self.dt:
            self.set(**self._changes.pop(0)[1])
        moving = state.t >= self.params.start_time - 0.5 * self.dt
        responses = (np.zeros(2), np.zeros(2))
        if moving:
            sensed = (state.q, state.dq, state.orientation, state.angular_velocity)
            responses = self._responses(*sensed, self._stance & state.contact)
        target = GaitTarget(state.tick, state.t, *self._target(moving, *responses))
        self._stance = target.stance
        return target

    def _responses(
        self,
        q: np.ndarray,
        dq: np.ndarray,
        orientation: np.ndarray,
        angular_velocity: np.ndarray,
        standing: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Shift of the steps [m] and angles of the feet [rad], (2,) each; 0 if switched off."""
        p, shift, lean = self.params, np.zeros(2), np.zeros(2)
        if p.adjustment > 0.0:
            lean = self._recovery.lean_of(orientation, p.adjustment, p.adjustment_limit)
        if p.recovery > 0.0:
            if standing.any():  # else the last velocity remains
                velocity = self._recovery.trunk_velocity(
                    q, dq, orientation, angular_velocity, standing, self._legs
                )
                requested = self._memory[2][[self._cpg.SPEED, self._cpg.LATERAL]]
                self._error += self._blend * (velocity - requested - self._error)
            height = -self._centre[:, 2].mean()
            shift = self._recovery.step_shift(self._error, height, p.recovery, p.recovery_limit)
        return shift, lean

    def _target(self, moving: bool, shift: np.ndarray, lean: np.ndarray) -> tuple:
        return self._cpg.target(moving, self._memory, shift, lean, self._setpoint, *self._constants)

    def _planned(self, params: GaitParams) -> list[tuple[float, dict[str, float]]]:
        """Times and changes of the schedule in order; raises if a step is out of reach."""
        goal, planned = params.replace(schedule=None), []
        for change in sorted(params.schedule or (), key=lambda change: change["time"]):
            values = {name: value for name, value in change.items() if name != "time"}
            goal = goal.replace(**values)
            self._vector(goal)
            planned.append((change["time"], values))
        return planned

    def _vector(self, params: GaitParams) -> np.ndarray:
        """References of the oscillators, (6,); raises if a step exceeds the reach of the legs."""
        forward_speed = params.speed - params.yaw_rate * self._centre[:, 1]
        left = params.lateral_speed + params.yaw_rate * self._centre[:, 0]
        half_time = 0.5 * params.duty_factor / params.frequency
        half_step = half_time * np.stack([forward_speed, left, np.zeros(4)], axis=1)  # (4, 3)
        for offset in (half_step, -half_step, [0.0, 0.0, params.step_height]):
            self._kinematics.joint_position(self._centre + offset, self._legs)
        return np.array([getattr(params, name) for name in LIVE])
