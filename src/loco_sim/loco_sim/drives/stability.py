# SPDX-License-Identifier: Apache-2.0
"""Stability of damping that is computed once per physics step, and the sub-steps it needs."""

from __future__ import annotations

from math import ceil, isfinite

import numpy as np

from loco_control.exceptions import ParameterError

from ..params import SimParams
from ..robot.robot import Robot
from ..robot.servo import ServoParams


def stability_ratio(kd: np.ndarray, dt: float, inertia: np.ndarray) -> float:
    """Largest kd dt / I over the joints: damping held over a step `dt` is unstable above 2.

    A damping torque computed at the start of a step and held for `dt` turns a
    velocity v into (1 - kd dt / I) v, which overshoots zero above 1 and grows
    above 2. For joints that move each other, I is the joint-space inertia matrix
    and the ratio is the largest eigenvalue of dt M^-1 diag(kd).

    Args:
        kd: Damping of each joint [N·m·s/rad], (n,).
        dt: Time for which a torque is held [s].
        inertia: Inertia at each joint, (n,), or inertia matrix, (n, n) [kg·m²].
    """
    kd, inertia = np.asarray(kd, dtype=float), np.asarray(inertia, dtype=float)
    if inertia.ndim < 2:
        return float(np.max(kd * dt / inertia))
    root = np.sqrt(kd)  # the symmetric form has the same eigenvalues, all real
    return float(dt * np.linalg.eigvalsh(root[:, None] * np.linalg.inv(inertia) * root)[-1])


def plan(
    robot: Robot, passive: np.ndarray, inertia: np.ndarray, dt: float,
    params: SimParams, solve: bool,
) -> tuple[int, bool]:  # fmt: skip
    """Number of sub-steps that a robot's damping needs, and whether damping is solved implicitly.

    Damping that would need sub-steps is solved implicitly (`damping.DampedDrives`), except that of
    servos. Smaller damping is explicit, as is all damping if `solve` is False.

    Args:
        robot: Drives and springs.
        passive: Damping of the joints themselves [N·m·s/rad], (n,).
        inertia: Joint-space inertia matrix [kg·m²], (n, n).
        dt: Physics step [s].
        params: `damping_limit`, `max_substeps` and `implicit_damping`.
        solve: Whether implicit damping is allowed: no effect changes the torques of the drives.

    Raises:
        ParameterError: More sub-steps than `max_substeps` would be needed.
    """
    total = robot.damping + passive
    if not (solve and params.implicit_damping):
        return substeps(total, inertia, dt, params), False
    drives = [robot.drives.get(joint) for joint in robot.joints]
    servos = np.array([d.damping if isinstance(d, ServoParams) else 0.0 for d in drives])
    count = substeps(servos, inertia, dt, params)
    return count, _parts(total, inertia, dt, params) > count


def plan_passive(
    robot: Robot, passive: np.ndarray, inertia: np.ndarray, dt: float
) -> tuple[int, bool]:
    """Number of sub-steps, and whether the damping of the joints themselves is implicit.

    It is where explicit damping would need sub-steps: whatever acts on the drives, it stays a
    damping of the joints, unlike that of the drives.

    Args:
        robot: Drives, springs and settings of the simulation.
        passive: Damping of the joints themselves [N·m·s/rad], (n,).
        inertia: Joint-space inertia matrix [kg·m²], (n, n).
        dt: Physics step [s].

    Raises:
        ParameterError: More sub-steps than `max_substeps` would be needed.
    """
    params, total = robot.sim, robot.damping + passive
    if _parts(total, inertia, dt, params) == 1:
        return 1, False
    if not (params.implicit_damping and passive.any()):
        return substeps(total, inertia, dt, params), False
    return substeps(robot.damping, inertia + dt * np.diag(passive), dt, params), True


def _parts(damping: np.ndarray, inertia: np.ndarray, dt: float, params: SimParams) -> int:
    ratio = stability_ratio(damping, dt, inertia)
    if not isfinite(ratio):
        raise ParameterError(
            f"damping of up to {damping.max():.3g} N·m·s/rad is beyond what can be simulated; "
            "lower it, or correct the inertias of the robot"
        )
    return max(1, ceil(ratio / params.damping_limit - 1e-9))


def substeps(damping: np.ndarray, inertia: np.ndarray, dt: float, params: SimParams) -> int:
    """Number of sub-steps per physics step for which kd dt / I <= damping_limit.

    The torque loop computes damping at the start of a step and holds it, which
    removes too much speed when kd dt / I nears 1 and diverges at 2; the gait
    would then depend on the integrator, not on the robot.

    Args:
        damping: Largest damping of each joint, passive plus drive [N·m·s/rad], (n,).
        inertia: Joint-space inertia matrix [kg·m²], (n, n).
        dt: Physics step [s].
        params: `damping_limit` and `max_substeps`.

    Raises:
        ParameterError: More sub-steps than `max_substeps` would be needed.
    """
    count = _parts(damping, inertia, dt, params)
    if count > params.max_substeps:
        raise ParameterError(
            f"the damping gains need {count} sub-steps per physics step (kd dt / I = "
            f"{stability_ratio(damping, dt, inertia):.3g}, allowed {params.damping_limit:g}), "
            f"more than max_substeps = {params.max_substeps}: lower kd, or raise physics_rate or "
            "max_substeps; impedance drives and springs need none while sim.implicit_damping is "
            "on and no effect acts on drives or joints"
        )
    return count
