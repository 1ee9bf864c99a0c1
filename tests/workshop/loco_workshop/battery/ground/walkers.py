# SPDX-License-Identifier: Apache-2.0
"""Nominal walking robots of the battery, defined independently of loco's robot files."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from loco_control.exceptions import MissingPackageError

SIGNALS = {  # standard deviation of the noise
    "q": 4e-5, "dq": 4e-3, "tau": 0.1, "gyro": 2e-3, "force": 0.05, "attitude": 1e-4, "grf": 1.0,
}  # fmt: skip


@dataclass(frozen=True)
class Walker:
    """A trotting robot.

    Attributes:
        name: Name in the battery.
        robot: Name of the robot for the workflow; empty if loco lacks it.
        urdf: URDF file.
        gains: Stiffness and damping [N·m/rad, N·m·s/rad] in stance, then in swing, by the suffix
            of a joint's name, (4,) each.
        trunk: Link that carries loads.
        leg: Length of a leg [m].
        speeds: Slowest and fastest trot [m/s].
        steps: Physics steps in a control period of 4 ms.
        about: Contents of robot.yaml if loco lacks the robot.
        noise: Standard deviation of the noise of each signal.
    """

    name: str
    robot: str
    urdf: Path
    gains: Mapping[str, tuple[float, float, float, float]]
    trunk: str
    leg: float
    speeds: tuple[float, float]
    steps: int = 64
    about: Mapping[str, Any] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=lambda: SIGNALS)

    @property
    def torque_noise(self) -> float:
        """Standard deviation of the torque sensors' noise [N·m]."""
        return self.noise["tau"]

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the movable joints, in the order of the URDF."""
        elements = self.tree().findall("joint")
        return tuple(j.get("name", "") for j in elements if j.get("type") != "fixed")

    @property
    def links(self) -> tuple[str, ...]:
        """Names of the links."""
        return tuple(link.get("name", "") for link in self.tree().findall("link"))

    @property
    def feet(self) -> tuple[str, ...]:
        """Links that touch the ground."""
        return tuple(link for link in self.links if link.endswith(("_foot", "_toe")))

    @property
    def mass(self) -> float:
        """Mass of all links [kg]."""
        return sum(float(m.get("value", 0.0)) for m in self.tree().iter("mass"))

    def tree(self) -> ET.Element:
        """A new copy of the URDF without visual elements."""
        root = ET.parse(self.urdf).getroot()
        for link in root.iter("link"):
            for shape in link.findall("visual"):
                link.remove(shape)
        return root

    def effort(self) -> dict[str, float]:
        """Largest torque of each joint [N·m]."""
        limits = {j.get("name", ""): j.find("limit") for j in self.tree().findall("joint")}
        return {n: float(e.get("effort", 0.0)) for n, e in limits.items() if e is not None}

    def gains_of(self, joint: str) -> tuple[float, float, float, float]:
        """Gains of a joint; see `gains`."""
        return next(g for end, g in self.gains.items() if joint.endswith(end))


def _hyq() -> Walker:
    """HyQ with the gains of legs in stance and in swing."""
    folder = find_spec("loco_sim").submodule_search_locations[0]
    gains = {
        "_haa_joint": (150.0, 10.0, 150.0, 12.0), "_hfe_joint": (250.0, 8.0, 250.0, 8.0),
        "_kfe_joint": (150.0, 6.0, 250.0, 6.0),
    }  # fmt: skip
    urdf = Path(folder) / "assets" / "hyq" / "hyq.urdf"
    return Walker("hyq_trot", "hyq", urdf, gains, "base_link", 0.7, (0.15, 0.4))


def _a1() -> Walker:
    """The quadruped A1 of `pybullet_data`."""
    data = find_spec("pybullet_data")
    if data is None:
        raise MissingPackageError("the URDF of a1_trot comes with PyBullet, which is not installed")
    urdf = Path(data.submodule_search_locations[0]) / "a1" / "a1.urdf"
    gains = {"_hip_joint": (70.0, 4.0), "_upper_joint": (70.0, 4.0), "_lower_joint": (100.0, 3.0)}
    legs = {"lf": "FL", "rf": "FR", "lh": "RL", "rh": "RR"}
    joints = [f"{leg}_{j}_joint" for leg in legs.values() for j in ("hip", "upper", "lower")]
    about = {
        "fixed_base": False, "joints": joints, "feet": [f"{leg}_toe" for leg in legs.values()],
        "legs": {
            name: {"haa": f"{leg}_hip_joint", "hfe": f"{leg}_upper_joint",
                   "kfe": f"{leg}_lower_joint", "foot": f"{leg}_toe"}
            for name, leg in legs.items()
        },
        "standing": [0.0, 0.84, -1.677] * 4, "control_rate": 250,
        "drives": {f"*{end}": {"kind": "impedance", "kp": kp, "kd": kd}
                   for end, (kp, kd) in gains.items()},
        "fall": {"height": 0.144, "roll": 0.8, "pitch": 0.8},
    }  # fmt: skip
    both = {end: (*pair, *pair) for end, pair in gains.items()}
    return Walker("a1_trot", "", urdf, both, "trunk", 0.4, (0.15, 0.4), 80, about)


WALKERS: dict[str, Callable[[], Walker]] = {"hyq_trot": _hyq, "a1_trot": _a1}


@cache
def get(name: str) -> Walker:
    """Walker by its name in `WALKERS`; shared, so it must not be modified."""
    return WALKERS[name]()
