# SPDX-License-Identifier: Apache-2.0
"""Joint impedance: what the torque loop of the robot does with a motion command."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .names import LEGS
from .params import Params, parameter


@dataclass(frozen=True)
class ImpedanceParams(Params):
    """Gains of the joint impedance per (HAA, HFE, KFE), the same on every leg.

    The defaults are the gains of the author's simulation options.
    Source: the author's option file (hyq_ml); thesis section 7.3.3 for the switch
    between swing and stance.
    """

    swing_kp: tuple[float, float, float] = parameter(
        (150.0, 250.0, 250.0), "stiffness of a swing leg (haa hfe kfe)", "N·m/rad", low=0.0
    )
    swing_kd: tuple[float, float, float] = parameter(
        (12.0, 8.0, 6.0), "damping of a swing leg (haa hfe kfe)", "N·m·s/rad", low=0.0
    )
    stance_kp: tuple[float, float, float] = parameter(
        (150.0, 250.0, 150.0), "stiffness of a stance leg (haa hfe kfe)", "N·m/rad", low=0.0
    )
    stance_kd: tuple[float, float, float] = parameter(
        (10.0, 8.0, 6.0), "damping of a stance leg (haa hfe kfe)", "N·m·s/rad", low=0.0
    )


def gains(params: ImpedanceParams, stance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping of each joint for the legs now in stance.

    Args:
        params: Gains of swing and stance.
        stance: Legs that stand, (4,) bool.

    Returns:
        kp [N·m/rad] and kd [N·m·s/rad], each (12,).
    """
    legs = np.asarray(stance, dtype=bool).reshape(len(LEGS), 1)
    kp = np.where(legs, params.stance_kp, params.swing_kp).ravel()
    kd = np.where(legs, params.stance_kd, params.swing_kd).ravel()
    return kp, kd


def impedance_torque(
    q_desired: np.ndarray,
    dq_desired: np.ndarray,
    q: np.ndarray,
    dq: np.ndarray,
    kp: np.ndarray,
    kd: np.ndarray,
    feed_forward: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Torque kp (q_d - q) + kd (dq_d - dq) + feed_forward.

    Positions in [rad], velocities in [rad/s], kp in [N·m/rad], kd in [N·m·s/rad],
    torques in [N·m]; every array (12,) or of one broadcastable shape.

    Source: thesis eq. (4.8), (4.9), with the signs of the author's code.
    """
    return kp * (q_desired - q) + kd * (dq_desired - dq) + feed_forward


def stability_ratio(kd: np.ndarray, dt: float, inertia: np.ndarray) -> float:
    """Largest kd dt / I over the joints: damping held over a step `dt` is unstable above 2.

    A damping torque computed at the start of a step and held for `dt` turns a
    velocity v into (1 - kd dt / I) v, which overshoots zero above 1 and grows
    above 2. For joints that move each other, I is the joint-space inertia matrix
    and the ratio is the largest eigenvalue of dt M^-1 diag(kd).

    Args:
        kd: Damping of each joint [N·m·s/rad], (n,).
        dt: Time for which a torque is held [s].
        inertia: Inertia felt at each joint, (n,), or inertia matrix, (n, n) [kg·m²].
    """
    kd, inertia = np.asarray(kd, dtype=float), np.asarray(inertia, dtype=float)
    if inertia.ndim < 2:
        return float(np.max(kd * dt / inertia))
    root = np.sqrt(kd)  # the symmetric form has the same eigenvalues, all real
    return float(dt * np.linalg.eigvalsh(root[:, None] * np.linalg.inv(inertia) * root)[-1])
