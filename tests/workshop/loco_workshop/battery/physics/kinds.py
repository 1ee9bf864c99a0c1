# SPDX-License-Identifier: Apache-2.0
"""Candidate hidden effects of a machine, with places and bounds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import slots
from .hidden import Hidden
from .machines import Machine
from .plant import joint_inertia

Draw = Callable[[np.random.Generator, Machine, int], dict[str, Any]]


@dataclass(frozen=True)
class Kind:
    """Rules by which an effect is drawn.

    Attributes:
        strength: Name of the parameter that gives its size.
        low: Smallest reasonable strength, in `unit`; `high` is the largest.
        among: Possible joints: all, driven, placed (driven by a loop on the position), direct
            (driven, but not by a servo), sprung, turning; or whole (the robot), body (a link).
        unit: Unit of the bounds, computed from the robot (`scale`).
        signed: Whether it may be negative.
        draw: Function that draws the other parameters of the effect.
        family: Effects of one family are never hidden together.
    """

    strength: str
    low: float
    high: float
    among: str = "driven"
    unit: str = "plain"
    signed: bool = False
    draw: Draw | None = None
    family: str = ""


def span(m: Machine, j: int) -> float:
    """Range of motion of a joint in the battery [rad]; for a passive joint the widest range."""
    drive = np.flatnonzero(m.driven == j)
    return float(m.span[drive[0]]) if len(drive) else float(np.max(m.span))


def speed(m: Machine, j: int) -> float:
    """Largest commanded speed of a joint [rad/s]; for a passive joint that of any."""
    drive = np.flatnonzero(m.driven == j)
    return m.speed(int(drive[0])) if len(drive) else float(np.max(m.fast))


def scale(unit: str, m: Machine, j: int) -> float:
    """Value of one unit of the bounds of a kind, for a joint of a machine."""
    effort, sweep, fast = float(m.body.effort[j]), span(m, j), speed(m, j)
    return {
        "plain": 1.0, "torque": effort, "span": sweep, "curve": 1.0 / sweep, "bend": 1.0 / sweep**2,
        "stiffness": effort / sweep, "cubic": effort / sweep**3, "damping": effort / fast,
        "drag": effort / fast**2, "compliance": sweep / effort, "slope": 1.0 / fast,
        "skew": sweep / fast**2, "inertia": float(joint_inertia(m)[j]),
        "mass": float(np.max(m.body.mass)), "force": effort / reach(m),
    }[unit]  # fmt: skip


def reach(m: Machine) -> float:
    """Distance of the last body's centre of mass from its joint [m], at least 0.1."""
    return max(0.1, float(np.linalg.norm(m.body.com[-1])))


def _stribeck(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    return {"velocity": float(speed(m, j) * rng.uniform(0.04, 0.1))}


def _backlash(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    return {"inertia": float(scale("inertia", m, j) * rng.uniform(0.1, 0.2))}


def _rest(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    return {"rest": float(rng.uniform(-0.2, 0.2) * span(m, j))}


def _stop(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    drive = np.flatnonzero(m.driven == j)
    centre = float(m.centre[drive[0]]) - float(m.rest[j]) if len(drive) else 0.0
    side = 1.0 if (rng.random() < 0.5) == (centre >= 0.0) or centre == 0.0 else np.sign(centre)
    angle = centre + side * span(m, j) * rng.uniform(0.4, 0.65)
    return {"angle": float(angle), "damping": float(0.01 * scale("stiffness", m, j))}


def _hysteresis(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    return {"stroke": float(span(m, j) * rng.uniform(0.06, 0.15))}


def _maxwell(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    return {"time": float(rng.uniform(0.08, 0.3))}


def _series(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    rotor = scale("inertia", m, j) * rng.uniform(0.15, 0.3)
    row = m.drives[j]
    stiffness = row[1] + row[2] * row[5] or row[4] or scale("stiffness", m, j)
    return {"inertia": float(rotor), "damping": float(2.0 * np.sqrt(stiffness * rotor))}


def _saturation(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    return {"torque": float(rng.uniform(0.05, 0.08))}


def _payload(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    com = m.body.com[j] * rng.uniform(0.9, 1.4)
    return {"link": m.body.links[j], "position": com.tolist()}


def _com(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    across = np.cross(m.body.axis[j], m.body.com[j])
    across = across if np.any(across) else np.array([1.0, 0.0, 0.0])
    axis = across / np.linalg.norm(across) * rng.choice([-1.0, 1.0])
    along = m.body.com[j] / max(1e-9, float(np.linalg.norm(m.body.com[j])))
    return {"link": m.body.links[j], "offset": (axis + rng.uniform(-0.5, 0.5) * along).tolist()}


def _push(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    force, start = rng.uniform(-1.0, 1.0, 3) * (1.0, 0.3, 1.0), rng.uniform(0.8, 2.0)
    force[0] += np.copysign(0.5, force[0])
    return {"link": m.body.links[j], "point": m.body.com[j].tolist(), "force": force.tolist(),
            "start": float(start), "stop": float(start + rng.uniform(0.5, 1.2))}  # fmt: skip


def _force(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    return {"link": m.body.links[j], "point": m.body.com[j].tolist(),
            "force": rng.standard_normal(3).tolist()}  # fmt: skip


def _cable(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    away = np.array([rng.choice([-1.0, 1.0]) * rng.uniform(0.8, 1.1), 0.0, rng.uniform(0.1, 0.4)])
    return {"link": m.body.links[j], "point": m.body.com[j].tolist(), "anchor": away.tolist(),
            "length": float(rng.uniform(0.5, 0.9))}  # fmt: skip


KINDS: dict[str, Kind] = {
    "coulomb_friction": Kind("torque", 1e-4, 0.4, "all", "torque", family="dry"),
    "viscous_friction": Kind("damping", 1e-4, 1.0, "all", "damping", family="damping"),
    "stribeck_friction": Kind("torque", 1e-3, 0.4, "driven", "torque", draw=_stribeck,
                              family="dry"),
    "load_friction": Kind("share", 0.001, 0.6, family="dry"),
    "backlash": Kind("width", 1e-4, 0.3, "direct", "span", draw=_backlash, family="play"),
    "command_delay": Kind("delay", 2e-4, 0.15, "whole", family="time"),
    "actuation_delay": Kind("delay", 2e-4, 0.05, "direct", family="time"),
    "actuator_lag": Kind("time", 2e-4, 0.1, "direct", family="time"),
    "torque_limit": Kind("reduction", 0.05, 0.95, family="limit"),
    "torque_speed_line": Kind("slope", 0.05, 1.2, unit="slope", family="limit"),
    "supply_sag": Kind("sag", 0.001, 0.8, "whole", family="limit"),
    "torque_bias": Kind("torque", 1e-3, 0.5, "driven", "torque", True, family="zero"),
    "torque_ripple": Kind("sine", 1e-3, 0.5, "driven", "torque", True,
                          lambda rng, m, j: {"count": float(2.0 * np.pi * rng.uniform(3.0, 6.0)
                                                            / span(m, j))}, "ripple"),
    "torque_constant_error": Kind("error", 0.005, 0.5, signed=True, family="gain"),
    "joint_offset": Kind("offset", 1e-4, 0.3, "placed", "span", True, family="zero"),
    "added_stiffness": Kind("stiffness", 1e-4, 1.0, "all", "stiffness", draw=_rest,
                            family="spring"),
    "cubic_stiffness": Kind("cubic", 1e-4, 2.0, "all", "cubic", family="spring"),
    "stiffness_error": Kind("error", 0.01, 1.0, "sprung", signed=True, family="spring"),
    "rest_angle_error": Kind("offset", 0.005, 0.2, "sprung", signed=True, family="zero"),
    "spring_saturation": Kind("lost", 0.05, 1.0, "sprung", draw=_saturation, family="spring"),
    "end_stop": Kind("stiffness", 1e-3, 30.0, "all", "stiffness", draw=_stop, family="spring"),
    "hysteresis": Kind("torque", 1e-3, 0.4, "all", "torque", draw=_hysteresis, family="dry"),
    "viscoelasticity": Kind("stiffness", 1e-3, 2.0, "all", "stiffness", draw=_maxwell,
                            family="damping"),
    "series_elasticity": Kind("compliance", 1e-4, 0.5, "direct", "compliance", draw=_series,
                              family="play"),
    "payload": Kind("mass", 1e-3, 2.0, "body", "mass", draw=_payload, family="mass"),
    "com_offset": Kind("offset", 1e-3, 0.15, "body", draw=_com, family="mass"),
    "armature": Kind("inertia", 1e-3, 3.0, "turning", "inertia", family="mass"),
    "cable_force": Kind("stiffness", 1e-3, 3.0, "body", "force", draw=_cable, family="outside"),
    "push": Kind("force", 1e-3, 0.5, "body", "force", draw=_push, family="outside"),
    "constant_force": Kind("force", 1e-3, 0.5, "body", "force", draw=_force, family="outside"),
    "sensor_bias": Kind("q", 1e-5, 0.3, "all", "span", True, family="zero"),
    "sensor_gain": Kind("q", 1e-4, 0.3, "all", signed=True, family="gain"),
    "sensor_nonlinearity": Kind("cubic", 1e-4, 1.0, "all", "bend", True,
                                lambda rng, m, j: {"quadratic": 0.0}, family="gain"),
    "sensor_latency": Kind("delay", 2e-4, 0.1, "whole", family="time"),
}  # fmt: skip


def _spot(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    sweep, drive = span(m, j), np.flatnonzero(m.driven == j)
    centre = float(m.centre[drive[0]]) + rng.uniform(-0.4, 0.4) * sweep
    return {"centre": float(centre), "width": float(rng.uniform(0.1, 0.3) * sweep)}


def _hum(rng: np.random.Generator, m: Machine, j: int) -> dict[str, Any]:
    frequency = 2.0 * np.pi * m.band[1] * rng.uniform(0.3, 2.0)
    return {"frequency": float(frequency), "phase": float(rng.uniform(0.0, 2.0 * np.pi))}


OUTSIDERS: dict[str, Kind] = {  # effects that are not in the registry
    "friction_drift": Kind("torque", 1e-3, 0.5, "driven", "torque",
                           draw=lambda rng, m, j: {"time": float(rng.uniform(0.4, 0.9))}),
    "worn_spot": Kind("torque", 1e-3, 0.5, "driven", "torque", draw=_spot),
    "hum": Kind("torque", 1e-3, 0.5, "driven", "torque", draw=_hum),
    "quadratic_drag": Kind("drag", 1e-3, 3.0, "driven", "drag"),
    "loose_mass": Kind("inertia", 1e-3, 2.0, "driven", "inertia", draw=lambda rng, m, j: {
        "frequency": float(rng.uniform(2.0, 5.0)), "ratio": float(rng.uniform(0.03, 0.1))}),
    "rubber": Kind("torque", 1e-3, 0.5, "driven", "torque", draw=lambda rng, m, j: {
        "stroke": float(span(m, j) * rng.uniform(0.2, 0.4)), "hardening": 2.0}),
    # Dry friction in one direction equals Coulomb friction plus a constant torque, which are in
    # the registry.
    "one_way_damping": Kind("damping", 1e-3, 3.0, "driven", "damping"),
    "torque_jump": Kind("error", 0.01, 0.6, "driven", draw=lambda rng, m, j: {
        "time": float(rng.uniform(1.6, 2.4))}),
    "torque_deadband": Kind("band", 1e-3, 0.5, "driven", "torque"),
    "sensor_play": Kind("width", 1e-4, 0.3, "driven", "span"),
    "speed_skew": Kind("skew", 1e-3, 0.5, "driven", "skew", True),
}  # fmt: skip
ALL = {**KINDS, **OUTSIDERS}


def places(kind: Kind, m: Machine) -> list[int]:
    """Possible joints for a kind of effect; for body effects, the joints of these bodies."""
    selected = {
        "whole": m.driven[:1],
        "all": range(len(m.joints)),
        "body": range(len(m.joints)),
        "driven": m.driven,
        "placed": [j for j in m.driven if _placed(m.drives[j])],
        "direct": [j for j in m.driven if m.drives[j, 0] != slots.SERVO],
        "sprung": m.sprung,
        "turning": [j for j in m.driven if not m.body.slides[j]],
    }[kind.among]
    return [int(j) for j in selected]


def _placed(row: np.ndarray) -> bool:
    """Whether a drive has a loop on the position, whose zero can be wrong."""
    looped = row[0] == slots.IMPEDANCE and row[1] + row[3] + row[5] > 0.0
    return bool(row[0] == slots.SERVO or looped)


def draw(name: str, m: Machine, rng: np.random.Generator) -> tuple[Hidden, float, float] | None:
    """An effect at a random place, and the bounds of its strength; None without such a place."""
    kind = ALL[name]
    candidates = places(kind, m)
    if not candidates:
        return None
    j = int(rng.choice(candidates))
    params = kind.draw(rng, m, j) if kind.draw else {}
    sign = -1.0 if kind.signed and rng.random() < 0.5 else 1.0
    params.setdefault(kind.strength, sign)
    place = {"whole": "", "body": m.body.links[j]}.get(kind.among, m.joints[j])
    unit = scale(kind.unit, m, j)
    return Hidden(name, place, kind.strength, params), kind.low * unit, kind.high * unit
