# SPDX-License-Identifier: Apache-2.0
"""Parameters of the simulated world; what belongs to a robot is in its ``robot.yaml``."""

from __future__ import annotations

from dataclasses import dataclass

from loco_control.params import Params, parameter


@dataclass(frozen=True)
class SimParams(Params):
    """Physics, contact and sensors. Joint damping and limits come from the URDF.

    Source: friction and rigid feet as in DLS-Lab's hyq-description (urdfs/leg/leg.gazebo).
    """

    physics_rate: float = parameter(
        1000.0, "physics steps per second, before sub-stepping", "Hz", low=100.0, high=20000.0
    )
    damping_limit: float = parameter(
        0.5,
        "largest kd dt / I of the joint loop; physics is sub-stepped until it holds. Explicit "
        "damping diverges at 2 and distorts the power of a gait by 30 % at 1.2",
        low=0.01,
        high=1.9,
    )
    max_substeps: int = parameter(
        20, "gains that need more sub-steps than this are refused", low=1, high=1000
    )
    gravity: float = parameter(9.81, "acceleration of gravity", "m/s²", low=0.0)
    friction: float = parameter(1.0, "Coulomb friction between robot and ground", low=0.0)
    restitution: float = parameter(0.0, "restitution between robot and ground", low=0.0, high=1.0)
    contact_stiffness: float = parameter(0.0, "stiffness of a contact, 0 is rigid", "N/m", low=0.0)
    contact_damping: float = parameter(
        1000.0, "damping of a contact, used when contact_stiffness > 0", "N·s/m", low=0.0
    )
    solver_iterations: int = parameter(50, "iterations of the contact solver", low=1, high=1000)
    grf: str = parameter(
        "mean",
        "ground reaction force: mean over the control period, or of its last physics step",
        choices=("mean", "last"),
    )
    contact_threshold: float = parameter(
        1.0, "a foot with more ground reaction force than this is in contact", "N", low=0.0
    )
    safety: bool = parameter(
        True, "keep the last good command when one is not finite (and count it), else raise"
    )
