# SPDX-License-Identifier: Apache-2.0
"""Wiring files: assignment of servos on a bus to joints.

A wiring file is the argument of `loco run --hardware`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from loco_control.exceptions import ParameterError
from loco_control.params import Params, from_dict, parameter
from loco_control.reading import read_yaml, understood

from ..robot.equipment import matches
from ..robot.robot import Robot
from ..robot.servo import ImpedanceDrive

COUNTS = 4096  # counts per turn
TURN = 2.0 * math.pi / COUNTS  # angle of a count [rad]
BAUDS = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)


@dataclass(frozen=True)
class BusParams(Params):
    """A bus of Dynamixel servos, and the time-outs of its driver."""

    port: str = parameter("/dev/ttyUSB0", "serial port of the bus")
    baud: int = parameter(1_000_000, "speed of the bus", "bit/s", 9600, 4_000_000)
    latency: float = parameter(
        0.004, "patience with an answer, beside the time of its bytes", "s", 1e-4, 0.1
    )
    missing: int = parameter(
        5, "reads in a row without an answer of a servo before the robot is stopped", "-", 1, 1000
    )
    temperature: float = parameter(
        65.0, "warmest servo before the robot is stopped", "degC", 20.0, 100.0
    )
    watchdog: float = parameter(
        0.2, "silence of the bus after which the servos stop by themselves", "s", 0.02, 2.54
    )
    approach: float = parameter(
        0.5, "fastest speed on the way to the standing posture, before the run", "rad/s", 0.01, 10.0
    )


@dataclass(frozen=True)
class JointServo(Params):
    """The servo of one joint: joint angle = sign * (counts - zero) * 2 pi / 4096."""

    id: int = parameter(1, "number on the bus", "-", 0, 252)
    sign: int = parameter(1, "1, or -1 for a servo that turns against its joint", "-", -1, 1)
    zero: int = parameter(2048, "counts of the servo where the joint is at 0", "-", 0, COUNTS - 1)
    current: float = parameter(1.0, "largest current", "A", 0.001, 30.0)
    current_unit: float = parameter(0.00269, "current of one count", "A", 1e-4, 0.1)
    torque_per_ampere: float = parameter(1.0, "torque of one ampere", "N·m/A", 1e-3, 100.0)


@dataclass(frozen=True)
class Wiring:
    """Bus and servos of a robot.

    Attributes:
        bus: Parameters of the bus.
        servos: Servo of each joint, in the robot's order.
    """

    bus: BusParams
    servos: tuple[JointServo, ...]


@understood("whole wiring file")
def load(path: str | Path, robot: Robot, port: str = "") -> Wiring:
    """Wiring of a robot from a file.

    Args:
        path: YAML file: `bus` and, by joint or pattern, `servos`; later entries take precedence.
        robot: Robot driven by the servos, with a fixed base and a drive on each joint.
        port: Port in place of the file's.

    Raises:
        LocoError: The file cannot be read, a value is out of its range, a joint has no servo or
            two share one, or the robot needs features that servos lack.
    """
    values = read_yaml(path, "wiring file")
    if not isinstance(values, dict) or set(values) - {"bus", "servos"} or "servos" not in values:
        raise ParameterError(f"{path} must have the keys bus and servos, and no others")
    _suits(robot)
    bus = from_dict(BusParams, values.get("bus"), "bus")
    bus = bus.replace(port=port) if port else bus
    if bus.baud not in BAUDS:
        speeds = ", ".join(map(str, BAUDS))
        raise ParameterError(f"bus.baud must be one of {speeds}, got {bus.baud}")
    entries = _entries(values["servos"], robot.joints, path)
    servos = tuple(from_dict(JointServo, entries[j], f"servos.{j}") for j in robot.joints)
    _check(servos, robot.joints)
    return Wiring(bus, servos)


def _suits(robot: Robot) -> None:
    undriven = [j for j in robot.joints if j not in robot.drives]
    soft = [j for j in robot.joints if isinstance(robot.drives.get(j), ImpedanceDrive)]
    if not robot.fixed_base:
        reason = "its base moves, and servos measure no attitude: an IMU has to be read too"
    elif undriven:
        reason = f"{undriven[0]} has no drive, so no servo measures it"
    elif soft:
        reason = f"{soft[0]} is an impedance drive; servos take angles or torques"
    else:
        return
    raise ParameterError(
        f"robot {robot.name} cannot be driven by servos alone: {reason}; derive a driver of your "
        "own (docs/hardware.md)"
    )


def _entries(servos: Any, joints: tuple[str, ...], path: str | Path) -> dict[str, dict[str, Any]]:
    entries: dict[str, dict[str, Any]] = {}
    if not isinstance(servos, dict):
        raise ParameterError(f"{path}: servos must be a mapping of joints, got {servos!r}")
    for pattern, entry in servos.items():
        if not isinstance(entry, dict):
            raise ParameterError(f"{path}: servos.{pattern} must be a mapping, got {entry!r}")
        for joint in matches(joints, str(pattern), f"joint in {path}"):
            entries[joint] = {**entries.get(joint, {}), **entry}
    for joint in joints:
        if "id" not in entries.get(joint, {}):
            raise ParameterError(f"{path}: joint {joint} needs servos.{joint}.id")
    return entries


def _check(servos: tuple[JointServo, ...], joints: Iterable[str]) -> None:
    owner: dict[int, str] = {}
    for servo, joint in zip(servos, joints, strict=True):
        if servo.sign == 0:
            raise ParameterError(f"servos.{joint}.sign must be 1 or -1, got 0")
        if servo.id in owner:
            raise ParameterError(
                f"servos.{joint}.id must be its own: {owner[servo.id]} has {servo.id} too"
            )
        owner[servo.id] = joint
