# SPDX-License-Identifier: Apache-2.0
"""Hidden effects of walking robots: their sizes, and their changes of the bodies.

Sizes are ranges of physical parameters. They cannot be derived from a comparison of runs with
and without the effect, since such runs diverge at the first delayed contact. Medium and large
are the halves of a range, small is below it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..physics.hidden import Hidden
from ..physics.machines import GRAVITY, OFF
from .walkers import Walker

Draw = Callable[[np.random.Generator, Walker, float], tuple[str, dict[str, Any]]]


@dataclass(frozen=True)
class Kind:
    """Rules by which an effect is drawn.

    Attributes:
        strength: Name of the parameter that gives its size.
        low: Smallest size, in the unit of `draw`; `high` is the largest.
        draw: Function that returns place and parameters for a size.
        family: Effects of one family are never hidden together.
    """

    strength: str
    low: float
    high: float
    draw: Draw
    family: str


def _slippery(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    foot = str(rng.choice(w.feet))
    return foot, {"foot": foot, "error": -x}


def _soft(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    give = x * w.leg / (0.5 * w.mass * GRAVITY)  # in a trot two feet carry the weight
    return "", {"compliance": give, "damping": float(rng.uniform(0.008, 0.03)) / give}


def _board(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    foot = str(rng.choice(w.feet))
    return foot, {"foot": foot, "height": x * w.leg}


def _incline(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    about = rng.uniform(0.0, 2.0 * np.pi)
    return "", {"pitch": float(x * np.cos(about)), "roll": float(x * np.sin(about))}


def _mounted(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    about = rng.uniform(0.0, 2.0 * np.pi)
    return "", {"roll": float(x * np.cos(about)), "pitch": float(x * np.sin(about)), "yaw": 0.0}


def _load(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    at = rng.uniform(-1.0, 1.0, 3) * (0.25, 0.1, 0.05) + (0.0, 0.0, 0.1)
    return w.trunk, {"link": w.trunk, "mass": x * w.mass, "position": (w.leg * at).tolist()}


def _shifted(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    about = rng.uniform(0.0, 2.0 * np.pi)
    direction = np.array([np.cos(about), np.sin(about), 0.0])
    return w.trunk, {"link": w.trunk, "offset": (x * w.leg * direction).tolist()}


def _rubbing(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    joint = str(rng.choice(w.joints))
    return joint, {"joint": joint, "torque": x * w.effort()[joint]}


def _weak(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    joint = str(rng.choice(w.joints))
    return joint, {"joint": joint, "error": float(rng.choice([-1.0, 1.0])) * x}


def _late(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    return "", {"delay": x}


def _ripple(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    first = next(iter(w.gains))  # suffix of the hip joints, which hardly move
    joint = str(rng.choice([j for j in w.joints if not j.endswith(first)]))
    return joint, {"joint": joint, "torque": x * w.effort()[joint],
                   "teeth": float(rng.uniform(40.0, 80.0))}  # fmt: skip


def _fluid(rng: np.random.Generator, w: Walker, x: float) -> tuple[str, dict[str, Any]]:
    return w.trunk, {"link": w.trunk, "drag": x * w.mass * GRAVITY}


KINDS: dict[str, Kind] = {
    "foot_friction": Kind("error", 0.65, 0.9, _slippery, "ground"),
    "ground_compliance": Kind("compliance", 0.005, 0.03, _soft, "ground"),
    "ground_height": Kind("height", 0.01, 0.03, _board, "ground"),
    "slope": Kind("pitch", 0.03, 0.1, _incline, "tilt"),
    "imu_tilt": Kind("roll", 0.015, 0.06, _mounted, "tilt"),
    "payload": Kind("mass", 0.03, 0.15, _load, "mass"),
    "com_offset": Kind("offset", 0.015, 0.06, _shifted, "mass"),
    "coulomb_friction": Kind("torque", 0.02, 0.08, _rubbing, "joint"),
    "torque_constant_error": Kind("error", 0.08, 0.25, _weak, "joint"),
    "command_delay": Kind("delay", 0.002, 0.008, _late, "time"),
}
OUTSIDERS: dict[str, Kind] = {  # effects that are not in the registry
    "gear_ripple": Kind("torque", 0.02, 0.08, _ripple, "joint"),
    "trunk_drag": Kind("drag", 0.05, 0.15, _fluid, "mass"),
}


def draw(name: str, walker: Walker, size: str, rng: np.random.Generator) -> Hidden:
    """An effect at a random place, with a random size in the part of the range for `size`."""
    kind = {**KINDS, **OUTSIDERS}[name]
    exponent = rng.uniform(0.0, 0.5) + {"small": -0.5, "medium": 0.0, "large": 0.5}[size]
    place, params = kind.draw(rng, walker, float(kind.low * (kind.high / kind.low) ** exponent))
    return Hidden(name, place, kind.strength, params)


def family(name: str) -> str:
    """Family of an effect."""
    return {**KINDS, **OUTSIDERS}[name].family


def bodies(walker: Walker, effects: Sequence[Hidden], off: bool, seed: int) -> str:
    """URDF with the effects on the bodies; with `off`, masses and inertias have small errors."""
    root = walker.tree()
    rng = np.random.default_rng([seed, 11])
    for part in root.iter("inertial") if off else ():
        heavier, rounder = (1.0 + rng.uniform(-most, most) for most in OFF[:2])
        _scale(part, "mass", heavier)
        _scale(part, "inertia", heavier * rounder)
    for effect in effects:
        p = effect.params
        if effect.effect == "payload":
            _hang(root, p["link"], p["mass"], p["position"])
        elif effect.effect == "com_offset":
            (inertial,) = (link.find("inertial") for link in _links(root, p["link"]))
            origin = inertial.find("origin")
            origin = ET.SubElement(inertial, "origin") if origin is None else origin
            at = np.array(origin.get("xyz", "0 0 0").split(), dtype=float) + p["offset"]
            origin.set("xyz", " ".join(map(repr, at.tolist())))
        elif effect.effect == "ground_height":
            for link in _links(root, p["foot"]):
                for ball in link.iter("sphere"):
                    ball.set("radius", repr(float(ball.get("radius", 0.0)) + p["height"]))
    return ET.tostring(root, encoding="unicode")


def motors(walker: Walker, off: bool, seed: int) -> dict[str, float]:
    """Ratio of actual to commanded torque, by joint."""
    rng = np.random.default_rng([seed, 12])
    wrong = (
        rng.uniform(-OFF[2], OFF[2], len(walker.joints)) if off else np.zeros(len(walker.joints))
    )
    return dict(zip(walker.joints, (1.0 + wrong).tolist(), strict=True))


def _links(root: ET.Element, name: str) -> Iterable[ET.Element]:
    return (link for link in root.findall("link") if link.get("name") == name)


def _scale(part: ET.Element, tag: str, by: float) -> None:
    for element in part.findall(tag):
        for key, value in element.attrib.items():
            element.set(key, repr(float(value) * by))


def _hang(root: ET.Element, link: str, mass: float, place: Sequence[float]) -> None:
    """Add a point mass to a link, as a separate link."""
    load = ET.SubElement(root, "link", name="hidden_load")
    inertial = ET.SubElement(load, "inertial")
    ET.SubElement(inertial, "mass", value=repr(mass))
    tiny = repr(1e-8 * mass)
    ET.SubElement(inertial, "inertia", ixx=tiny, iyy=tiny, izz=tiny, ixy="0", ixz="0", iyz="0")
    joint = ET.SubElement(root, "joint", name="hidden_load_joint", type="fixed")
    ET.SubElement(joint, "parent", link=link)
    ET.SubElement(joint, "child", link="hidden_load")
    ET.SubElement(joint, "origin", xyz=" ".join(map(repr, map(float, place))))
