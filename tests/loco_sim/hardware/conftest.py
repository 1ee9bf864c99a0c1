# SPDX-License-Identifier: Apache-2.0
"""Buses of simulated servos that a test may disturb."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest

pytest.importorskip("dynamixel_sdk")

from loco_bringup.testing import servo_bus  # noqa: E402
from loco_sim.hardware import packets as p  # noqa: E402
from loco_sim.hardware import wiring  # noqa: E402
from loco_sim.hardware.dynamixel import ServoRobot  # noqa: E402
from loco_sim.robot import robot as robots  # noqa: E402

_ROD = """<link name="{0}"><inertial><mass value="0.2"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{0}"/>
<origin xyz="0 0 {2}"/><axis xyz="0 1 0"/><dynamics damping="0.05"/>
<limit effort="{3}" velocity="13"/></joint>"""
_ARM = f"""<robot name="arm"><link name="base"/>{_ROD.format("shoulder", "base", 0.6, 2.6)}
{_ROD.format("elbow", "shoulder", -0.2, 0.5)}</robot>"""
_ROBOT = """urdf: arm.urdf
fixed_base: true
height: 0.0
joints: [shoulder, elbow]
control_rate: 100
drives:
  shoulder: {kind: servo, stall_torque: 2.6, no_load_speed: 13.0, kp: 6.0, rotor_inertia: 0.003}
  elbow: {kind: torque}
"""
_SERVOS = """bus: {}
servos:
  shoulder: {id: 4, zero: 1000, current: 1.2, torque_per_ampere: 1.78}
  elbow: {id: 2, sign: -1, current: 1.0, torque_per_ampere: 1.0}
"""


class Servos(ServoRobot):
    """A robot of servos that counts its patience by the clock of the bus, as tests do."""

    def __init__(self, bus, **changes):
        wired = wiring.load(bus.file, bus.robot)
        super().__init__(
            replace(wired, bus=wired.bus.replace(**changes)), bus.robot, lambda: bus.time
        )


def said(bus, servo, register):
    """Value of a register of a servo."""
    return bus._servos[servo].get(register)


def put(bus, servo, register, value):
    """Let a servo have a value in a register."""
    bus._servos[servo].put(register, value)


def barked(bus):
    """Whether the watchdog has stopped each servo."""
    return [said(bus, servo, p.BUS_WATCHDOG) == p.EXPIRED for servo in bus.torques]


def passes(bus, seconds):
    """Wait until so much time of the bus has gone by [s], however long that takes."""
    end = bus.time + seconds
    while bus.time < end:
        time.sleep(0.001)


@pytest.fixture
def bus():
    """The simulated bus of a pendulum on a servo."""
    with servo_bus() as bus:
        bus.robot = robots.load("servo_pendulum")
        yield bus


@pytest.fixture
def arm(tmp_path):
    """That of an arm: a servo that takes angles; one that takes torques and turns against it."""
    for name, text in (("arm.urdf", _ARM), ("robot.yaml", _ROBOT), ("servos.yaml", _SERVOS)):
        (tmp_path / name).write_text(text)
    with servo_bus(str(tmp_path / "robot.yaml"), tmp_path / "servos.yaml") as bus:
        bus.robot = robots.load(tmp_path / "robot.yaml")
        yield bus
