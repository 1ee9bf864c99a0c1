# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of a machine, and their constants in the compiled laws.

Names of effects and parameters are those of the registry, so that verdicts can be scored;
the laws are implemented independently in this package (`laws`, `motion`, `readings`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from . import slots
from .machines import Machine


@dataclass(frozen=True)
class Hidden:
    """A hidden effect in a machine.

    Attributes:
        effect: Name in the registry, or of an outsider (an effect that is not in the registry).
        place: Joint or pattern of joints, link of a body effect, empty for the whole robot.
        strength: Name of the parameter that gives its size.
        params: Parameters by name.
    """

    effect: str
    place: str
    strength: str
    params: dict[str, Any] = field(default_factory=dict)

    def scaled(self, value: float) -> Hidden:
        """The effect with another strength and the same sign (or direction of a vector)."""
        nominal = self.params[self.strength]
        if isinstance(nominal, (list, tuple)):
            length = float(np.linalg.norm(nominal))
            new: Any = [float(x) / length * value for x in nominal]
        else:
            new = float(np.copysign(value, nominal))
        return Hidden(self.effect, self.place, self.strength, {**self.params, self.strength: new})

    @property
    def size(self) -> float:
        """Absolute value of its strength."""
        return float(np.linalg.norm(self.params[self.strength]))


LAWS: dict[str, tuple[int, tuple[str, ...]]] = {  # row of the law, parameters in order
    "coulomb_friction": (slots.COULOMB, ("torque",)),
    "viscous_friction": (slots.VISCOUS, ("damping",)),
    "stribeck_friction": (slots.STRIBECK, ("torque", "velocity")),
    "load_friction": (slots.LOAD, ("share",)),
    "backlash": (slots.BACKLASH, ("width", "inertia")),
    "command_delay": (slots.COMMAND_DELAY, ("delay",)),
    "actuation_delay": (slots.ACTUATION_DELAY, ("delay",)),
    "actuator_lag": (slots.LAG, ("time",)),
    "torque_limit": (slots.LIMIT, ("reduction",)),
    "torque_speed_line": (slots.LINE, ("slope",)),
    "supply_sag": (slots.SAG, ("sag",)),
    "torque_bias": (slots.BIAS, ("torque",)),
    "torque_constant_error": (slots.GAIN, ("error",)),
    "joint_offset": (slots.OFFSET, ("offset",)),
    "added_stiffness": (slots.STIFFNESS, ("stiffness", "rest")),
    "cubic_stiffness": (slots.STIFFNESS, ("", "", "cubic")),
    "stiffness_error": (slots.SPRING_ERROR, ("error",)),
    "rest_angle_error": (slots.SPRING_ERROR, ("", "", "offset")),
    "spring_saturation": (slots.SATURATION, ("lost", "torque")),
    "end_stop": (slots.STOP, ("angle", "stiffness", "damping")),
    "hysteresis": (slots.HYSTERESIS, ("torque", "stroke")),
    "viscoelasticity": (slots.MAXWELL, ("stiffness", "time")),
    "series_elasticity": (slots.SERIES, ("compliance", "inertia", "damping")),
    "friction_drift": (slots.DRIFT, ("torque", "time")),
    "torque_ripple": (slots.RIPPLE, ("sine", "count")),
    "worn_spot": (slots.SPOT, ("torque", "centre", "width")),
    "hum": (slots.HUM, ("torque", "frequency", "phase")),
    "quadratic_drag": (slots.DRAG, ("drag",)),
    "rubber": (slots.RUBBER, ("torque", "stroke", "hardening")),
    "one_way_damping": (slots.ONE_WAY, ("damping",)),
    "torque_deadband": (slots.DEADBAND, ("band",)),
}


def at(machine: Machine, place: str) -> list[int]:
    """Indices of the joints at a place; all for an empty place."""
    return [j for j, name in enumerate(machine.joints) if fnmatchcase(name, place or "*")]


def constants(machine: Machine, found: Sequence[Hidden]) -> np.ndarray:
    """Constants of the hidden laws per joint, (LAWS, n, 4)."""
    rows = np.zeros((slots.LAWS, len(machine.joints), 4))
    for effect in found:
        p = effect.params
        if effect.effect in LAWS:
            law, order = LAWS[effect.effect]
            for column, name in enumerate(order):
                if name:
                    rows[law, at(machine, effect.place), column] += p[name]
        elif effect.effect == "loose_mass":
            omega = 2.0 * np.pi * p["frequency"]
            spring, damper = p["inertia"] * omega**2, 2.0 * p["ratio"] * p["inertia"] * omega
            rows[slots.ABSORBER, at(machine, effect.place), :3] = spring, damper, p["inertia"]
        elif effect.effect == "torque_jump":
            rows[slots.JUMP, at(machine, effect.place), :3] = -p["error"], p["error"], p["time"]
    return rows


def to_dict(effect: Hidden) -> dict[str, Any]:
    """Values for a truth file."""
    return {"effect": effect.effect, "place": effect.place, "strength": effect.strength,
            "params": effect.params}  # fmt: skip


def from_dict(values: dict[str, Any]) -> Hidden:
    """Effect from the values written by `to_dict`."""
    return Hidden(values["effect"], values["place"], values["strength"], values["params"])
