# SPDX-License-Identifier: Apache-2.0
"""Scaling of gaits and gains from one quadruped to another of different size (Froude similarity).

Two walking robots move alike when inertia, weight and stiffness keep their proportions. With
leg length L and mass m relative to the reference (HyQ), gravity unchanged,

    length ~ L, time ~ sqrt(L), speed ~ sqrt(L), frequency ~ 1 / sqrt(L), force ~ m,

and every other unit follows: N·m/rad ~ m L, N·s/m ~ m / sqrt(L). HyQ's own numbers are reproduced
exactly. Source: Alexander and Jayes, J. Zool. 201 (1983), dynamic similarity of quadrupeds.
"""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ..legs.geometry import DOWN, HIP_X, HIP_Y, HIP_Z, HYQ, SHANK, SIDE
from ..params import Params
from ..stance.controller import StanceParams
from ..stance.trunk import TrunkParams
from .generator import GaitParams

T = TypeVar("T", bound=Params)

MASS = 84.756  # mass of the reference, HyQ with its rounded masses [kg]
DIGITS = 4  # significant digits of a scaled value
# Powers of leg length and of mass by which a unit scales; other units do not.
POWERS = {
    "m": (1.0, 0.0),
    "m/s": (0.5, 0.0),
    "s": (0.5, 0.0),
    "tick": (0.5, 0.0),
    "Hz": (-0.5, 0.0),
    "1/s": (-0.5, 0.0),
    "rad/s": (-0.5, 0.0),
    "kg": (0.0, 1.0),
    "N": (0.0, 1.0),
    "N/m": (-1.0, 1.0),
    "N·s/m": (-0.5, 1.0),
    "N·m/rad": (1.0, 1.0),
    "N·m·s/rad": (1.5, 1.0),
}
SETTINGS = ("start_time", "estimator_start", "origin")  # from the experiment or the hips


class Size(NamedTuple):
    """Size of a robot relative to the reference."""

    length: float = 1.0  # leg length / HyQ's leg length [-]
    mass: float = 1.0  # mass / HyQ's mass [-]


def leg_length(legs: np.ndarray) -> float:
    """Mean length of stretched legs, HAA axis to foot [m]; `legs` (4, 16) as in `kinematics`."""
    return float(np.mean(legs[:, DOWN : SHANK + 1].sum(axis=1)))


def size_of(legs: np.ndarray, mass: float) -> Size:
    """Size of a robot with this geometry, (4, 16), and mass [kg].

    Rounded to six digits, so that HyQ is exactly 1 in spite of rounding errors in its total mass.
    """
    return Size(round(leg_length(legs) / leg_length(HYQ), 6), round(mass / MASS, 6))


def factor(unit: str, size: Size) -> float:
    """Scale factor of a value of this unit for a robot of this size [-]."""
    of_length, of_mass = POWERS.get(unit, (0.0, 0.0))
    return size.length**of_length * size.mass**of_mass


def scaled(params: T, size: Size, only: tuple[str, ...] | None = None) -> T:
    """Parameters for a robot of another size, within their ranges.

    Args:
        params: Parameters of the reference robot.
        size: Size of the robot.
        only: Fields to scale; default all except `SETTINGS`.
    """
    changes: dict[str, Any] = {}
    for f in dataclasses.fields(params):
        if dataclasses.is_dataclass(inner := getattr(params, f.name)):
            changes[f.name] = scaled(inner, size)
        by = factor(f.metadata.get("unit", "-"), size)
        if by != 1.0 and (f.name in only if only else f.name not in SETTINGS):
            changes[f.name] = _times(getattr(params, f.name), by, f.metadata)
    return params.replace(**changes)


def _times(value: Any, by: float, meta: Any) -> Any:
    if isinstance(value, (tuple, list)):
        return tuple(_times(v, by, meta) for v in value)
    if not isinstance(value, (int, float)) or value <= 0.0:  # negative values are codes
        return value
    product = float(f"{value * by:.{DIGITS}g}")
    low, high = meta.get("low"), meta.get("high")
    product = product if low is None else max(product, low)
    product = product if high is None else min(product, high)
    return round(product) if isinstance(value, int) else product


def foot_origin(legs: np.ndarray, size: Size) -> tuple[float, float, float]:
    """`GaitParams.origin` for a robot [m], with the feet relative to the hips as in HyQ."""
    ahead = 0.25 * float(legs[:2, HIP_X].sum() - legs[2:, HIP_X].sum())
    outside = float(np.mean(legs[:, HIP_Y] + legs[:, SIDE]))
    x, y, z = GaitParams().origin
    own_x, own_y = float(HYQ[0, HIP_X]), float(HYQ[0, HIP_Y])
    high = float(np.mean(legs[:, HIP_Z]))
    wide = outside + size.length * (y - own_y)
    feet = (ahead + size.length * (x - own_x), wide, high + size.length * z)
    return tuple(round(value, 4) for value in feet)


def control_defaults(legs: np.ndarray, size: Size) -> dict[str, Params]:
    """Gait, trunk and stance parameters of a robot of this geometry and size, by section."""
    gait = scaled(GaitParams(), size).replace(origin=foot_origin(legs, size))
    return {
        "gait": gait,
        "trunk": scaled(TrunkParams(), size),
        "stance": scaled(StanceParams(), size, ("height_threshold",)),
    }
