# SPDX-License-Identifier: Apache-2.0
"""Hypotheses whose parameters are vectors, places or times: each has its own builder.

A builder gets a robot, the measured signals and `Hints`, and returns for each hypothesis its
place, fixed parameters, coordinates and variant.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import numpy as np

from loco_sim.description import Description
from loco_sim.effects.base import EFFECTS, turning
from loco_sim.effects.compliance import rest
from loco_sim.effects.identity import SENSOR_SIGNALS
from loco_sim.robot import Robot

from .channels import SENSORS
from .coordinates import Coordinate
from .hints import Hints
from .places import joint_places, links

FAST = 5000.0  # [Hz] physics for which the engine is too slow
AXES = np.eye(3).tolist()
Entry = tuple[str, tuple[tuple[str, Any], ...], tuple[Coordinate, ...], str]


def _bounds(effect: str, name: str) -> tuple[float, float, str]:
    meta = EFFECTS[effect].__dataclass_fields__[name].metadata
    low, high = meta.get("low"), meta.get("high")
    return (-math.inf if low is None else low, math.inf if high is None else high, meta["unit"])


def _strength(effect: str, name: str, size: float, direction: Sequence[float] = ()) -> Coordinate:
    low, high, unit = _bounds(effect, name)
    return Coordinate(name, size, (1.0,), low, high, unit, True, False, tuple(direction))


def _vector(effect: str, name: str) -> tuple[Coordinate, ...]:
    size = EFFECTS[effect].identity.priors[name].high / 3.0
    return tuple(_strength(effect, name, size, axis) for axis in AXES)


def _log(effect: str, name: str, starts: Sequence[float]) -> Coordinate:
    low, high, unit = _bounds(effect, name)
    at = tuple(math.log(value / starts[0]) for value in starts)
    return Coordinate(name, starts[0], at, max(low, 1e-9), high, unit, False, True)


def payload(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """A mass at the middle of each link; where it sits along a link that turns is free too."""
    made = []
    size = max(0.05 * Description(robot.urdf).mass(), 0.01)
    for link, com in links(robot):
        mass = _strength("payload", "mass", size)
        reach = float(np.linalg.norm(com))
        if reach < 1e-3 or not len(turning(robot)):
            made.append((link, (("link", link), ("position", list(com))), (mass,), ""))
            continue
        along = tuple(float(v) / reach for v in com)
        where = Coordinate("position", reach, (1.0, 1.8, 0.4), -5.0, 5.0, "m", direction=along)
        made.append((link, (("link", link),), (mass, where), ""))
    return made


def com_offset(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """The centre of mass of each link, in all directions."""
    if not len(turning(robot)) and robot.fixed_base:
        return []
    return [
        (link, (("link", link),), _vector("com_offset", "offset"), "") for link, _ in links(robot)
    ]


def _reached(robot: Robot) -> list[tuple[str, tuple[float, ...]]]:
    """Links that something may pull at: all that can move if the base is bolted, else the base."""
    found = links(robot)
    return found if robot.fixed_base else found[:1]


def push(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """A force on a link, or the base, during the time in which the residual is large."""
    made = []
    for (start, stop), (link, com) in product(hints.intervals, _reached(robot)):
        near = 0.5 * (stop - start) + 0.2  # beyond that it is another push
        times = tuple(
            Coordinate(name, 0.1, (at / 0.1,), max(0.0, at - near), at + near, "s")
            for name, at in (("start", start), ("stop", stop))
        )
        fixed = (("link", link), ("point", list(com)))
        made.append((link, fixed, (*_vector("push", "force"), *times), f"{start:g} s"))
    return made


def cable_force(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """A cable from each link, or the base, to anchors ahead, behind and above."""
    if robot.sim.physics_rate > FAST:  # it needs the engine, minutes for each simulation
        return []
    made = []
    ways = ((1.0, 0.0, 0.3), (-1.0, 0.0, 0.3), (0.0, 0.0, 1.0))
    for direction, (link, com) in product(ways, _reached(robot)):
        anchor = [float(v) for v in np.array([0.0, 0.0, robot.height or 0.5]) + direction]
        fixed = (("link", link), ("point", list(com)), ("anchor", anchor))
        free = (
            _strength("cable_force", "stiffness", 20.0),
            _log("cable_force", "length", (0.8,)),
        )
        made.append((link, fixed, free, f"to {anchor[0]:g} {anchor[2]:g}"))
    return made


def end_stop(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """A stop at either side of each joint, inside the range that was measured."""
    made = []
    slack = rest(robot, np.arange(len(robot.joints)))
    for joint in joint_places(robot, "all"):
        if joint not in robot.joints:
            continue
        j = robot.joints.index(joint)
        for side, edge in (("above", hints.high[j] - slack[j]), ("below", hints.low[j] - slack[j])):
            if not np.isfinite(edge) or abs(edge) < 1e-3 or (edge > 0) != (side == "above"):
                continue
            low, high = sorted((0.05 * edge, 1.3 * edge))
            angle = Coordinate("angle", float(edge), (0.9, 0.7, 0.98), low, high, "rad")
            stiffness = _strength("end_stop", "stiffness", 20.0)
            damping = _log("end_stop", "damping", (0.1,))
            made.append((joint, (("joint", joint),), (stiffness, angle, damping), side))
    return made


def trunk_flex(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """A hinge in the middle of the trunk, about each axis."""
    return [
        (
            "",
            (("axis", axis),),
            (
                _strength("trunk_flex", "compliance", 0.003),
                _log("trunk_flex", "damping", (0.1, 1.0)),
            ),
            axis,
        )
        for axis in "yxz"
    ]


def _sensor(effect: str, names: dict[str, str]) -> Callable[..., list[Entry]]:
    """Hypotheses of a linear sensor effect: one per measured signal, `names` to its parameter."""

    def build(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
        made: list[Entry] = []
        for signal, name in names.items():
            if signal not in signals:
                continue
            default = EFFECTS[effect].__dataclass_fields__[name].default
            if isinstance(default, tuple):
                made.append(("", (), _vector(effect, name), name))
                continue
            size = EFFECTS[effect].identity.priors[name].high / 3.0
            free = (_strength(effect, name, size),)
            if signal in ("q", "dq", "tau"):
                made += [(j, (("joint", j),), free, name) for j in joint_places(robot, "all")]
            else:
                made.append(("", (), free, name))
        return made

    return build


def sensor_latency(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """All sensors, or those of one signal where several were measured."""
    delay = EFFECTS["sensor_latency"].identity.priors["delay"].typical
    free = (_strength("sensor_latency", "delay", delay),)
    made: list[Entry] = [("", (), free, "")]
    for signal in signals if len(signals) > 1 else ():
        channel = SENSORS.get(signal, signal)
        if channel in SENSOR_SIGNALS:
            made.append(("", (("channel", channel),), free, channel))
    return made


def sensor_nonlinearity(robot: Robot, signals: Sequence[str], hints: Hints) -> list[Entry]:
    """Both bends of each joint's sensor."""
    free = tuple(
        _strength("sensor_nonlinearity", name, size)
        for name, size in (("quadratic", 0.2), ("cubic", 0.4))
    )
    return [(j, (("joint", j),), free, "") for j in joint_places(robot, "all")]


BUILDERS: dict[str, Callable[..., list[Entry]]] = {
    "payload": payload,
    "com_offset": com_offset,
    "push": push,
    "cable_force": cable_force,
    "end_stop": end_stop,
    "trunk_flex": trunk_flex,
    "sensor_bias": _sensor(
        "sensor_bias",
        {"q": "q", "tau": "tau", "gyro": "gyro", "acceleration": "accelerometer"},
    ),
    "sensor_gain": _sensor(
        "sensor_gain",
        {"q": "q", "tau": "tau", "grf": "grf", "gyro": "gyro", "acceleration": "accelerometer"},
    ),
    "sensor_latency": sensor_latency,
    "sensor_nonlinearity": sensor_nonlinearity,
}
