# SPDX-License-Identifier: Apache-2.0
"""Experiments that excite a robot, scaled to the limits of its joints.

`library` works for every robot whose drives accept a position or a torque command. Amplitudes are
shares of the travel of a joint about its standing position; velocities stay below `SPEED_SHARE`
of the limits in the URDF, commanded torques below `TORQUE_SHARE`.
"""

from __future__ import annotations

import dataclasses
import math
import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import TorqueDrive

from ...runs import gait_file
from ...runs.experiment import Experiment

ROOM_SHARE, SPEED_SHARE, TORQUE_SHARE = 0.8, 0.4, 0.2
MOST_ROOM = 0.6  # limit for a joint without close stops [rad or m]
FASTEST = 8.0  # end frequency of a chirp [Hz]
HANG = 1.0  # height of the base of a robot that hangs in the air [m]
DROP = 0.05  # drop height [m]
START = 0.5  # time at rest before the motion [s]


@dataclass(frozen=True)
class Joints:
    """Driven joints of a robot.

    Attributes:
        rest: Initial command [rad, or N·m for torque drives], (m,).
        room: Largest amplitude about it, (m,).
        speed: Largest velocity of the command [rad/s]; infinite for torques, (m,).
    """

    rest: np.ndarray
    room: np.ndarray
    speed: np.ndarray


def joints_of(robot: Robot) -> Joints:
    """Amplitude and velocity limits of the driven joints."""
    description, fastest = Description(robot.urdf), velocities(robot.urdf)
    rest, margin, speed = [], [], []
    for i in robot.driven:
        name, home = robot.joints[i], float(robot.standing[i])
        low, high = description.limits(name)
        drive = robot.drives.get(name)
        if isinstance(drive, TorqueDrive):
            effort = float(robot.effort[i])
            rest.append(0.0)
            margin.append(min(TORQUE_SHARE * effort if math.isfinite(effort) else 1.0, math.pi))
            speed.append(math.inf)
            continue
        rest.append(home)
        margin.append(min(ROOM_SHARE * min(high - home, home - low), MOST_ROOM))
        limit = min(fastest.get(name, math.inf), getattr(drive, "no_load_speed", math.inf))
        speed.append(SPEED_SHARE * limit)
    return Joints(*(np.array(values, dtype=float) for values in (rest, margin, speed)))


def velocities(urdf: str) -> dict[str, float]:
    """Velocity limit of each joint [rad/s or m/s] in a URDF."""
    result = {}
    for joint in ET.fromstring(urdf).iter("joint"):
        limit = joint.find("limit")
        if limit is not None and limit.get("velocity"):
            result[joint.get("name", "")] = float(limit.get("velocity"))
    return result


Maker = Callable[[Joints], tuple[float, dict[str, Any]]]  # duration and target

MAKERS: dict[str, Maker] = {}


def _motion(make: Maker) -> Maker:
    """Register a motion; its docstring becomes the description of the experiment."""
    MAKERS[make.__name__] = make
    return make


def _sweep(j: Joints, size: float, first: float, upper: float) -> dict[str, Any]:
    """Chirp of 6.5 s whose highest frequency respects the velocity limit of the joints."""
    amplitude = size * j.room
    limit = float(np.min(j.speed / (2.0 * math.pi * np.maximum(amplitude, 1e-9))))
    last = max(first, min(upper, limit))
    return _target(
        j, kind="chirp", amplitude=amplitude, frequency=first, end_frequency=last, sweep=6.5
    )


def _target(j: Joints, **values: Any) -> dict[str, Any]:
    target = {"offset": j.rest, "phase": np.zeros(1), "start_time": START, "ramp": 0.5, **values}
    return {k: _rounded(v) for k, v in target.items()}


def _rounded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return [round(float(x), 5) for x in value]
    return round(value, 5) if isinstance(value, float) else value


def _rise(j: Joints, travel: np.ndarray, min_time: float) -> float:
    """Duration of a step within the velocity limit [s]; the peak is 1.5 times the mean velocity."""
    return max(min_time, float(np.max(1.5 * travel / j.speed)))


@_motion
def chirp_small(j: Joints) -> tuple[float, dict]:
    """A small chirp: shows lags, elasticity and noise, apart from friction."""
    return 7.0, _sweep(j, 0.15, 0.3, FASTEST)


@_motion
def chirp_large(j: Joints) -> tuple[float, dict]:
    """A large chirp: shows effects that grow with velocity and angle."""
    return 7.0, _sweep(j, 0.9, 0.2, 3.0)


@_motion
def slow_ramp(j: Joints) -> tuple[float, dict]:
    """Slow motion up and down: shows friction, play, stiffness and rest angle without inertia."""
    return 10.5, _target(j, kind="triangle", amplitude=0.9 * j.room, frequency=0.1, ramp=0.0)


@_motion
def steps(j: Joints) -> tuple[float, dict]:
    """Steps of several sizes: distinguish delays from lags, show limits of torque and velocity."""
    levels = [1.0, -0.5, 0.5, -1.0, 0.25, 0.0]
    rise = _rise(j, 2.0 * 0.7 * j.room, 0.1)
    return 6.5, _target(
        j, kind="steps", amplitude=0.7 * j.room, frequency=1.0, levels=levels, rise=rise, ramp=0.0
    )


@_motion
def preload(j: Joints) -> tuple[float, dict]:
    """A small chirp on a constant load: closes play, shows cubic and hysteretic springs."""
    target = _sweep(j, 0.12, 0.3, 5.0)
    return 7.5, {**target, "bias": _rounded(0.6 * j.room), "ramp": 1.0}


@_motion
def still_poses(j: Joints) -> tuple[float, dict]:
    """Still poses: show weight, offsets and bias without motion."""
    levels = [0.5, -0.5, 1.0, -1.0, 0.0]
    rise = _rise(j, 2.0 * 0.9 * j.room, 0.8)
    return 10.5, _target(
        j, kind="steps", amplitude=0.9 * j.room, frequency=0.5, levels=levels, rise=rise, ramp=0.0
    )


@_motion
def in_turn(j: Joints) -> tuple[float, dict]:
    """One joint after another: shows in which joint an effect is."""
    count = len(j.rest)
    rise = _rise(j, 2.0 * 0.7 * j.room, 0.15)
    return 2.0 * count + 0.5, _target(
        j, kind="steps", amplitude=0.7 * j.room, frequency=1.5, rise=rise, ramp=0.0,
        levels=[1.0, -1.0, 0.0] + [0.0] * (3 * count - 3), phase=-3.0 * np.arange(count),
    )  # fmt: skip


def library(model: Model, notes: list[str] | None = None) -> list[Experiment]:
    """Experiments for the robot of a model, in a fixed order, with its effects and overrides.

    A robot with a free base has all motions in the air, and gentler versions of them on the ground,
    besides its gaits and a drop.

    Args:
        model: Robot, overrides and effects.
        notes: List to which a sentence is appended for each motion that the robot cannot make; if
            None, such a motion is an error.

    Raises:
        LocoError: A motion is impossible for the robot, and `notes` is None.
    """
    robot = model.make_robot()
    j = joints_of(robot)
    result = []
    for name, make in MAKERS.items():
        if name == "in_turn" and len(j.rest) < 2:
            continue
        try:
            result += _motions(model, name, make, j, robot.fixed_base)
        except LocoError as error:
            if notes is None:
                raise
            notes.append(f"the experiment {name} is not possible: {error}")
    return result + ([] if robot.fixed_base else [*_gaits(model, robot), *_drop(model, robot, j)])


def _motions(model: Model, name: str, make: Maker, j: Joints, fixed_base: bool) -> list[Experiment]:
    """A motion of a fixed-base robot, or its two versions in the air and on the ground."""
    duration, target = make(j)
    description = str(make.__doc__).rstrip(".")
    if fixed_base:
        return [_experiment(model, name, description, duration, target)]
    air, ground = f"{description}; in the air", f"{description}; on the ground"
    hanging = {"fixed_base": True, "height": HANG}
    return [
        _experiment(model, f"{name}_air", air, duration, target, hanging),
        _experiment(model, f"{name}_ground", ground, duration, _gentle(target)),
    ]


def _gentle(target: dict[str, Any]) -> dict[str, Any]:
    """Motion with 35 % of the amplitude, opposite in both halves of the joints, at most 3 Hz.

    The robot should not fall: when front and hind legs move in opposite directions, its centre
    hardly moves.
    """
    cap = {"end_frequency": min(target["end_frequency"], 3.0)} if "end_frequency" in target else {}
    size = target["amplitude"]
    signs = [1.0 if 2 * i < len(size) else -1.0 for i in range(len(size))]
    mirrored = [round(0.35 * s * a, 5) for s, a in zip(signs, size, strict=True)]
    return {**target, "amplitude": mirrored, **cap}


def _gaits(model: Model, robot: Robot) -> list[Experiment]:
    """The robot's stored gaits, at lower and higher frequencies."""
    experiments = []
    for name in gait_file.names():
        gait = gait_file.load(name)
        if gait.robot != robot.name:
            continue
        for suffix, share in (("slow", 0.8), ("fast", 1.2)):
            frequency = round(share * gait.target.frequency, 5)
            target = dataclasses.asdict(gait.target.replace(frequency=frequency))
            text = f"{name} at {frequency:g} Hz: contacts, masses and everything on the way"
            experiments.append(_experiment(model, f"{name}_{suffix}", text, 8.0, target))
    return experiments


def _drop(model: Model, robot: Robot, j: Joints) -> list[Experiment]:
    """A drop from a small height above the ground, in the standing pose."""
    from loco_sim.plant.simulation import Simulation

    with Simulation(None, [], 0, 1.0 / robot.control_rate, robot) as sim:
        sim.reset()
        height = float(sim.ground_truth().position[2])
    target = _target(j, kind="sine", amplitude=np.zeros(1), frequency=1.0)
    text = f"dropped from {100 * DROP:g} cm: ground, springs and masses"
    return [_experiment(model, "drop", text, 3.0, target, {"height": round(height + DROP, 5)})]


def _experiment(
    model: Model, name: str, text: str, duration: float, target: dict, overrides: dict | None = None
) -> Experiment:
    from loco_control.gait.oscillators import CpgParams
    from loco_control.params import from_dict

    return Experiment(
        name=name,
        description=text[0].upper() + text[1:] + ".",
        robot=model.robot,
        duration=duration,
        target=from_dict(CpgParams, target),
        overrides={**model.overrides, **(overrides or {})},
        effects=tuple(dict(e) for e in model.effects),
    )
