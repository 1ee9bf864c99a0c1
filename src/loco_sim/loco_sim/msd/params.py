# SPDX-License-Identifier: Apache-2.0
"""Parameters of the networks, with two presets: the text of the thesis, and its code."""

from __future__ import annotations

from dataclasses import dataclass

from loco_control.exceptions import NameUnknownError
from loco_control.params import Params, parameter


@dataclass(frozen=True)
class MsdParams(Params):
    """A chain of masses, its forces and its integration. Defaults are the preset ``thesis``."""

    nodes: int = parameter(20, "nodes, I", low=2, high=10000)
    connections: int = parameter(
        6,
        "links of an inner node, C, to its C / 2 nearest neighbours on each side",
        low=2,
        high=100,
    )
    dimension: int = parameter(2, "2 (x, z) or 3 (x, y, z)", low=2, high=3)
    spacing: float = parameter(1.0, "distance of nodes along x", "m", low=1e-6)
    height: float = parameter(4.0, "height of the arch of the even nodes", "m", low=0.0)
    width: float = parameter(0.5, "sideways distance of nodes, in three dimensions", "m", low=0.0)
    mass: float = parameter(1.0, "mass of a node when total_mass is 0", "kg", low=1e-9)
    total_mass: float = parameter(0.0, "mass of all nodes together; 0: use `mass`", "kg", low=0.0)
    stiffness: float = parameter(100.0, "k of all springs", "N/m", low=0.0)
    damping: float = parameter(10.0, "d of all dampers", "N·s/m", low=0.0)
    nonlinearity: float = parameter(
        0.03,
        "beta of eq. 4.3. The thesis gives no value; 0.03 is the one in the author's sources",
        low=0.0,
    )
    damper: str = parameter(
        "along_link",
        "a damper acts against the change of its length, or the whole relative velocity",
        choices=("along_link", "full_vector"),
    )
    gravity: float = parameter(9.81, "acceleration of gravity", "m/s²", low=0.0)
    drag: float = parameter(0.1, "air friction of a node", "N·s/m", low=0.0)
    ground: str = parameter(
        "stick",
        "stick: a node on the ground does not move until the forces lift it; author: "
        "only its height and velocity are reset, so that it creeps; none: no ground",
        choices=("stick", "author", "none"),
    )
    step: float = parameter(0.005, "integration step", "s", low=1e-7, high=1.0)
    integrator: str = parameter(
        "verlet",
        "verlet: forces that depend on velocity use that at the end of the "
        "step; author: that at its start, and no acceleration at the first step",
        choices=("verlet", "author"),
    )


@dataclass(frozen=True)
class NoiseParams(Params):
    """Disturbances of a network during the optimisation of its gait."""

    actuation: float = parameter(
        0.0, "standard deviation of white noise on each relative amplitude, each step", low=0.0
    )
    impulse_rate: float = parameter(
        0.0, "chance that an impulse begins in a step", low=0.0, high=1.0
    )
    impulse_size: float = parameter(
        0.0, "largest impulse over the mean absolute acceleration of the nodes", low=0.0
    )
    impulse_steps: int = parameter(1, "how long an impulse lasts [steps]", low=1, high=1000000)


@dataclass(frozen=True)
class Preset:
    """One variant of the model."""

    params: MsdParams
    noise: NoiseParams  # disturbances during an optimisation
    about: str


PRESETS = {
    "thesis": Preset(
        MsdParams(),
        NoiseParams(impulse_rate=0.05, impulse_size=0.1),
        "sections 4.1 and 6.2 as written",
    ),
    "author_code": Preset(
        MsdParams(
            damping=1.0,
            nonlinearity=0.0,
            damper="full_vector",
            ground="author",
            integrator="author",
        ),
        NoiseParams(actuation=0.04, impulse_rate=0.05, impulse_size=1.0, impulse_steps=100),
        "the author's SpringMassNetworks, November 2016",
    ),
}


def preset(name: str) -> Preset:
    """One of `PRESETS`.

    Raises:
        NameUnknownError: There is no such preset.
    """
    if name not in PRESETS:
        raise NameUnknownError("preset of mass-spring-damper networks", name, PRESETS)
    return PRESETS[name]
