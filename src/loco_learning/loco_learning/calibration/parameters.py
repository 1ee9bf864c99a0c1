# SPDX-License-Identifier: Apache-2.0
"""Parameters of a body that a calibration may change: thesis eq. (5.1), and the author's own list.

A parameter has a unit, bounds, a value before calibration and the places in
``robot.yaml`` to which it is written. Friction and contact depth span decades and are
searched on a logarithmic scale.

The sets ``seven`` and ``ten`` are for Tigrillo, ``legs`` is for legs with joint impedance
control such as HyQ's.

``seven`` is eq. (5.1): stiffness, contact depth and friction, front and hind, and the
mass distribution at a fixed total. ``ten`` is the list in the author's code: two independent
masses, and the smallest knee angle (his compression tolerance). ``legs`` is
an addition: stiffness of the drives in stance, damping and armature, alike on all legs.

The bounds are those of the author's code, except where these exclude the optimum printed in
the thesis: hind friction 8.2e-4 (lower bound 1e-3) and front mass 0.674 kg (upper bound
0.5 kg, perhaps without legs). The published run must have used other, unknown bounds.
``seven`` searches friction from 5e-4, below the printed optimum, to 2,
above any foot; ``ten`` keeps the code's 1e-3 to 50. Masses here include the legs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from loco_control.exceptions import NameUnknownError

FRONT, HIND = "[lr]f", "[lr]h"  # patterns of leg names
MASSES = ("masses.front_body", "masses.hind_body")  # each including its legs
TOTAL = 0.95  # mass of the robot [kg], thesis section 4.2


@dataclass(frozen=True)
class BodyParameter:
    """One parameter of the body.

    Attributes:
        name: Name of the parameter in files and tables.
        unit: Unit of the parameter.
        low: Lower bound of the search.
        high: Upper bound of the search.
        default: Value before calibration, thesis Table 5.1, column "No Optim".
        thesis: Value after calibration on the author's robot, Table 5.1, column "Optim".
        target: Dotted name in ``robot.yaml``, patterns allowed; empty for `mass_share`, which
            `ParameterSet.overrides` converts to two masses.
        text: Meaning, for tables.
        log: Whether it is searched on a logarithmic scale.
    """

    name: str
    unit: str
    low: float
    high: float
    default: float
    thesis: float | None
    target: str
    text: str
    log: bool = False

    def to_unit(self, value: float) -> float:
        """Position of a value between the bounds, 0 to 1."""
        low, high, value = (self._scale(v) for v in (self.low, self.high, value))
        return (value - low) / (high - low)

    def from_unit(self, x: float) -> float:
        """Value at a position between the bounds."""
        low, high = self._scale(self.low), self._scale(self.high)
        value = low + min(max(x, 0.0), 1.0) * (high - low)
        return min(max(math.exp(value) if self.log else value, self.low), self.high)

    def _scale(self, value: float) -> float:
        return math.log(value) if self.log else value


def _pair(quantity: str, text: str, key: str, front: tuple, hind: tuple, **same) -> tuple:
    """A parameter for the front and one for the hind legs; (default, thesis) values of each."""
    return tuple(
        BodyParameter(
            f"{quantity}_{end}", default=values[0], thesis=values[1],
            target=key.format(leg=leg), text=f"{place} {text}", **same,
        )
        for end, place, leg, values in (
            ("front", "front", FRONT, front), ("hind", "hind", HIND, hind)
        )
    )  # fmt: skip


_STIFFNESS = _pair(
    "stiffness", "knee spring stiffness", "springs.{leg}_kfe_joint.stiffness",
    (181.6, 181.4691), (181.6, 440.629), unit="N/m", low=50.0, high=1000.0, log=True,
)  # fmt: skip
_DEPTH = _pair(
    "depth", "contact depth under the standing load", "contacts.{leg}_foot.depth",
    (5e-4, 3.8e-3), (5e-4, 7.8e-3), unit="m", low=1e-4, high=1e-2, log=True,
)  # fmt: skip
_FEET = ("friction", "feet friction coefficient", "contacts.{leg}_foot.friction",
         (0.1, 0.283), (0.1, 8.19e-4))  # fmt: skip
_FRICTION = _pair(*_FEET, unit="-", low=5e-4, high=2.0, log=True)
_FRICTION_CODE = _pair(*_FEET, unit="-", low=1e-3, high=50.0, log=True)
# Bounds in the author's code: 0.1 to 0.5 kg, for the boxes of the trunk alone.
_MASS = tuple(
    BodyParameter(f"mass_{end}", "kg", 0.2, 0.75, *values, target, f"{end} mass, legs included")
    for end, target, values in zip(
        ("front", "hind"), MASSES, ((0.712, 0.674), (0.238, 0.276)), strict=True
    )
)
_STOP = _pair(
    "stop", "smallest knee angle", "springs.{leg}_kfe_joint.stop",
    (0.92, None), (0.9015, None), unit="rad", low=0.7, high=1.2,
)  # fmt: skip
_SHARE = BodyParameter(
    "mass_share", "-", 0.5, 0.79, 0.712 / TOTAL, 0.674 / TOTAL, "", "share of the mass in front"
)


def _legs() -> tuple[BodyParameter, ...]:
    """Drive, friction and armature of each kind of joint; defaults are the values of HyQ.

    The default armature is small instead of zero, which a logarithmic scale does not permit.
    """
    legs = []
    for kind, text, stiffness in (
        ("haa", "hip abduction", 150.0), ("hfe", "hip flexion", 250.0), ("kfe", "knee", 150.0)
    ):  # fmt: skip
        rows = (
            ("stiffness", "N·m/rad", 30.0, 1000.0, stiffness, "drives.*_{}_joint.kp", True),
            ("damping", "N·m·s/rad", 0.01, 30.0, 0.1, "dynamics.*_{}_joint.damping", True),
            ("armature", "kg·m²", 1e-4, 1.0, 1e-3, "dynamics.*_{}_joint.armature", True),
        )
        for quantity, unit, low, high, default, target, log in rows:
            legs.append(
                BodyParameter(
                    f"{quantity}_{kind}", unit, low, high, default, None, target.format(kind),
                    f"{text} {quantity}", log,
                )
            )  # fmt: skip
    return tuple(legs)


@dataclass(frozen=True)
class ParameterSet:
    """Parameters that are calibrated together."""

    name: str
    text: str
    parameters: tuple[BodyParameter, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names in the order of all vectors, (d,)."""
        return tuple(p.name for p in self.parameters)

    @property
    def default(self) -> dict[str, float]:
        """Values before calibration."""
        return {p.name: p.default for p in self.parameters}

    def to_unit(self, values: Mapping[str, float]) -> np.ndarray:
        """Vector in the unit cube, (d,), for the optimiser."""
        return np.array([p.to_unit(values[p.name]) for p in self.parameters])

    def from_unit(self, x: np.ndarray) -> dict[str, float]:
        """Values by name from a vector in the unit cube, (d,)."""
        return {p.name: p.from_unit(float(v)) for p, v in zip(self.parameters, x, strict=True)}

    def overrides(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of ``robot.yaml`` by dotted name for a body."""
        overrides = {p.target: float(values[p.name]) for p in self.parameters if p.target}
        if "mass_share" in values:
            share = float(values["mass_share"])
            overrides |= {MASSES[0]: share * TOTAL, MASSES[1]: (1.0 - share) * TOTAL}
        return overrides


SETS = {
    s.name: s
    for s in (
        ParameterSet("seven", "thesis eq. (5.1)", (*_STIFFNESS, *_DEPTH, *_FRICTION, _SHARE)),
        ParameterSet(
            "ten", "the author's code", (*_MASS, *_FRICTION_CODE, *_DEPTH, *_STIFFNESS, *_STOP)
        ),
        ParameterSet("legs", "legs under joint impedance", _legs()),
    )
}


def parameter_set(name: str) -> ParameterSet:
    """Parameter set by its name.

    Raises:
        NameUnknownError: The set does not exist.
    """
    if name not in SETS:
        raise NameUnknownError("parameter set", name, SETS)
    return SETS[name]
