# SPDX-License-Identifier: Apache-2.0
"""Quadrupeds that nobody here drew: the URDFs that come with PyBullet, and which joint is which."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import yaml

from loco_control.legs.geometry import HYQ, LegGeometry
from loco_control.legs.kinematics import jacobian
from loco_control.names import LEGS
from loco_sim.robot.description import Description


class _Data:
    """Folder of the URDFs of others; a test that asks for one is skipped where there are none."""

    def __truediv__(self, name):
        spec = find_spec("pybullet_data")
        if spec is None:
            pytest.skip("the URDFs come with PyBullet, which is not installed")
        return Path(spec.origin).parent / name


DATA = _Data()
UNITREE = ("{}_hip_joint", "{}_upper_joint", "{}_lower_joint", "{}_toe")
LAIKAGO = (
    "{}_hip_motor_2_chassis_joint",
    "{}_upper_leg_2_hip_motor_joint",
    "{}_lower_leg_2_upper_leg_joint",
    "toe{}",
)
CHEETAH = ("torso_to_abduct_{}_j", "abduct_{0}_to_thigh_{0}_j", "thigh_{0}_to_knee_{0}_j", "toe_{}")
GHOST = ("{haa}", "{hfe}", "{kfe}", "toe{}")  # joints are numbers
ROBOTS = {  # URDF, names of haa hfe kfe foot, and of the legs lf rf lh rh in them
    "a1": ("a1/a1.urdf", UNITREE, ("FL", "FR", "RL", "RR")),
    "aliengo": ("aliengo/aliengo.urdf", UNITREE, ("FL", "FR", "RL", "RR")),
    "laikago": ("laikago/laikago_toes_zup.urdf", LAIKAGO, ("FL", "FR", "RL", "RR")),
    "mini_cheetah": ("mini_cheetah/mini_cheetah.urdf", CHEETAH, ("fl", "fr", "hl", "hr")),
    "spirit40": ("quadruped/spirit40.urdf", GHOST, (0, 2, 1, 3)),
    "vision60": ("quadruped/vision60.urdf", GHOST, (0, 2, 1, 3)),
}


def legs_of(name):
    """Section ``legs`` of a robot.yaml."""
    _, patterns, legs = ROBOTS[name]
    section = {}
    for leg, own in zip(LEGS, legs, strict=True):
        number = own if isinstance(own, int) else 0
        words = {"haa": 8 + number, "hfe": 2 * number, "kfe": 2 * number + 1}
        parts = (pattern.format(own, **words) for pattern in patterns)
        section[leg] = dict(zip(("haa", "hfe", "kfe", "foot"), parts, strict=True))
    return section


def mended(path):
    """URDF with inertias that bodies can have and without shapes of no size, meshes in place."""
    description = Description(path.read_text())
    for link in description.elements("link"):
        if link.find("inertial") is not None:
            description.add_inertia(link.get("name"), (1e-9, 1e-9, 1e-9))
        for shape in link.findall("visual"):
            sphere = shape.find("geometry/sphere")
            if sphere is not None and float(sphere.get("radius")) == 0.0:
                link.remove(shape)
    return description.text(path.parent)


def write(folder, name, **more):
    """Robot folder `folder`/`name`; returns its path. The URDF is mended, nothing else changed."""
    section = legs_of(name)
    joints = [section[leg][kind] for leg in LEGS for kind in ("haa", "hfe", "kfe")]
    path = Path(folder) / name
    path.mkdir()
    (path / "robot.urdf").write_text(mended(DATA / ROBOTS[name][0]))
    values = {"urdf": "robot.urdf", "joints": joints, "legs": section, **more}
    (path / "robot.yaml").write_text(yaml.safe_dump(values))
    return path


def joint_limits(geometry: LegGeometry | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest position of each joint of HyQ's leg [rad], each (12,)."""
    geometry = geometry or LegGeometry()
    front = np.array([geometry.haa_range, geometry.hfe_range, geometry.kfe_range])  # (3, 2)
    hind = np.array([front[0], -front[1, ::-1], -front[2, ::-1]])
    limits = np.concatenate([front, front, hind, hind])
    return limits[:, 0], limits[:, 1]


def joint_velocity(q: np.ndarray, foot_velocity: np.ndarray, legs: np.ndarray = HYQ) -> np.ndarray:
    """Joint velocities [rad/s], (12,), that move the feet at `foot_velocity` [m/s], (4, 3)."""
    velocity = np.asarray(foot_velocity, dtype=float).reshape(4, 3, 1)
    return np.linalg.solve(jacobian(q, legs), velocity).ravel()
