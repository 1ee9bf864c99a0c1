# SPDX-License-Identifier: Apache-2.0
"""The torque loop in the joints: impedance law, torque limits, and when it is stable."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import ceil, isfinite
from typing import NamedTuple

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.impedance import ImpedanceParams, gains, stability_ratio
from loco_control.types import MotionCommand, TrunkTorque

from .params import SimParams

GainsOf = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]  # stance flags to kp and kd


class Gains(NamedTuple):
    """Gains of every joint."""

    kp: list[float]  # [N·m/rad], (n,)
    kd: list[float]  # [N·m·s/rad], (n,)


class Drive:
    """Impedance law tau = kp (q_d - q) + kd (dq_d - dq) + tau_trunk of all joints.

    The law is linear, so what does not depend on the state is worked out once per
    command (`held_torque`). Plain lists are faster here than arrays.

    Attributes:
        q: Desired joint positions in force [rad], (n,).
        dq: Desired joint velocities in force [rad/s], (n,).
    """

    def __init__(self, impedance: ImpedanceParams | GainsOf, limits: np.ndarray, legs: int):
        self._gains_for, self._legs = gains_function(impedance), legs
        self._limits, self._smallest = limits.tolist(), float(min(limits))
        self._gains: dict[bytes, Gains] = {}

    def reset(self, q: np.ndarray) -> None:
        """Hold a pose [rad], (n,), with stance gains."""
        self.q, self.dq, self._tau = np.array(q, dtype=float), np.zeros(len(q)), np.zeros(len(q))
        self._gain = self._gains_of(np.ones(self._legs, dtype=bool))
        self.follow(self.q, self.dq)

    def accept(self, command: MotionCommand, trunk: TrunkTorque) -> bool:
        """Take a command over; False, and nothing changes, if it is not finite."""
        gain = self._gains_of(trunk.stance)
        held = held_torque(command.q, command.dq, gain, trunk.tau)
        if not isfinite(sum(held)):
            return False
        self.q, self.dq, self._tau = command.q, command.dq, trunk.tau
        self._gain, self._held = gain, held
        return True

    def follow(self, q: np.ndarray, dq: np.ndarray) -> None:
        """Follow these references instead of the command's, e.g. late ones."""
        self._held = held_torque(q, dq, self._gain, self._tau)

    def torque(self, joints: tuple[tuple[float, float, tuple, float], ...]) -> list[float]:
        """Joint torques within their limits [N·m], (n,).

        Args:
            joints: Position [rad] and velocity [rad/s] (and more) of each joint.
        """
        kp, kd = self._gain
        rows = zip(self._held, kp, kd, joints, strict=True)
        tau = [held - p * s[0] - d * s[1] for held, p, d, s in rows]
        if max(tau) > self._smallest or min(tau) < -self._smallest:
            return limited(tau, self._limits)
        return tau

    def _gains_of(self, stance: np.ndarray) -> Gains:
        """Gains of a stance pattern, made once."""
        key = stance.tobytes()
        if key not in self._gains:
            kp, kd = self._gains_for(stance)
            self._gains[key] = Gains(kp.tolist(), kd.tolist())
        return self._gains[key]


def gains_function(impedance: ImpedanceParams | GainsOf) -> GainsOf:
    """Kp and kd of every joint as a function of the stance flags.

    `ImpedanceParams` are for legs like HyQ's; any other robot brings a function.
    """
    return partial(gains, impedance) if isinstance(impedance, ImpedanceParams) else impedance


def held_torque(q: np.ndarray, dq: np.ndarray, gain: Gains, tau: np.ndarray) -> list[float]:
    """What the impedance law gives at zero joint position and velocity [N·m], (n,).

    Args:
        q: Desired joint positions [rad], (n,).
        dq: Desired joint velocities [rad/s], (n,).
        gain: Gains of the joints.
        tau: Feed-forward torque [N·m], (n,).
    """
    joints = zip(gain.kp, gain.kd, q.tolist(), dq.tolist(), tau.tolist(), strict=True)
    return [kp * angle + kd * rate + extra for kp, kd, angle, rate, extra in joints]


def limited(tau: list[float], limits: list[float]) -> list[float]:
    """Torques clipped to +-limits [N·m], (n,)."""
    return [
        x if -limit <= x <= limit else (limit if x > limit else -limit)
        for x, limit in zip(tau, limits, strict=True)
    ]


def substeps(
    impedance: ImpedanceParams | GainsOf,
    inertia: np.ndarray,
    damping: np.ndarray,
    legs: int,
    dt: float,
    params: SimParams,
) -> int:
    """How often a physics step must be divided for kd dt / I <= damping_limit.

    The torque loop computes damping at the start of a step and holds it, which
    takes too much speed away when kd dt / I nears 1 and diverges at 2; the gait
    would then show the integrator, not the robot.

    Args:
        impedance: Gains, of which the larger of swing and stance counts.
        inertia: Inertia that the joints feel [kg·m²], (n, n).
        damping: Passive damping of the joints [N·m·s/rad], (n,).
        legs: Number of legs.
        dt: Physics step [s].
        params: `damping_limit` and `max_substeps`.

    Raises:
        ParameterError: More sub-steps than `max_substeps` would be needed.
    """
    gains_for = gains_function(impedance)
    ratio = max(
        stability_ratio(gains_for(np.full(legs, stance))[1] + damping, dt, inertia)
        for stance in (False, True)
    )
    count = max(1, ceil(ratio / params.damping_limit - 1e-9))
    if count > params.max_substeps:
        raise ParameterError(
            f"the damping gains need {count} sub-steps per physics step "
            f"(kd dt / I = {ratio:.3g}, allowed {params.damping_limit:g}), more than "
            f"max_substeps = {params.max_substeps}: lower kd, or raise physics_rate or "
            "max_substeps"
        )
    return count
