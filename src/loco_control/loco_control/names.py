# SPDX-License-Identifier: Apache-2.0
"""Leg and joint names, in the order of every array (leg-major, HAA HFE KFE)."""

LEGS = ("lf", "rf", "lh", "rh")
JOINT_KINDS = ("haa", "hfe", "kfe")


def joint_name(leg: str, kind: str) -> str:
    """URDF name of a joint, e.g. ``joint_name("lf", "haa") == "lf_haa_joint"``."""
    return f"{leg}_{kind}_joint"


def foot_name(leg: str) -> str:
    """URDF name of the foot link of a leg."""
    return f"{leg}_foot"


JOINTS = tuple(joint_name(leg, kind) for leg in LEGS for kind in JOINT_KINDS)
FEET = tuple(foot_name(leg) for leg in LEGS)
