# SPDX-License-Identifier: Apache-2.0
"""A robot of servos on a bus that may fail."""

import time

import numpy as np
import pytest

pytest.importorskip("dynamixel_sdk")

from loco_control.exceptions import GraphError  # noqa: E402
from loco_sim.hardware import wiring  # noqa: E402
from loco_sim.hardware.dynamixel import ServoRobot  # noqa: E402
from loco_sim.hardware.packets import SYNC_WRITE  # noqa: E402
from loco_sim.robot import robot as robots  # noqa: E402


@pytest.fixture
def servos(bus):
    robot = robots.load("servo_pendulum")
    servos = ServoRobot(wiring.load(bus.file, robot), robot)
    yield servos
    servos.close()


def until(servos, reached, q=None, patience=10.0):
    """Drive, or only measure, until a state is reached."""
    end = time.monotonic() + patience
    while not reached(state := servos.measure(0, 0.0)):
        assert time.monotonic() < end, (state, servos.fault)
        if q is not None:
            servos.drive(np.array([q]))
        time.sleep(0.01)
    return state


def test_it_is_limp_until_it_is_driven_and_goes_where_it_is_told(bus, servos):
    assert not any(bus.torques.values())
    state = until(servos, lambda s: abs(s.q[0] - 0.4) < 0.05 and abs(s.dq[0]) < 0.2, q=0.4)
    assert all(bus.torques.values())
    assert bus.angles[0] == pytest.approx(state.q[0], abs=0.05)
    servos.limp()
    until(servos, lambda s: not any(bus.torques.values()))


def test_a_bus_that_loses_and_garbles_packets_is_counted_and_followed(bus, servos):
    bus.lost = bus.garbled = 0.1
    until(servos, lambda s: abs(s.q[0] - 0.4) < 0.05, q=0.4)
    until(servos, lambda s: servos.lost > 0, q=0.4)


def test_a_servo_that_falls_silent_is_named(bus, servos):
    bus.silence(1)
    until(servos, lambda s: "servo 1 (pivot) does not answer" in servos.fault)


def test_a_servo_that_is_too_hot_is_named(bus, servos):
    bus.overheat(1)
    until(servos, lambda s: "servo 1 (pivot)" in servos.fault)


def test_a_driver_that_falls_silent_leaves_servos_that_stay_where_they_are(bus, servos):
    until(servos, lambda s: abs(s.q[0] - 0.4) < 0.05 and abs(s.dq[0]) < 0.2, q=0.4)
    servos.drive(np.array([-0.4]))
    time.sleep(3.0)  # its watchdog barks; a goal that was sent before is forgotten
    settled = bus.angles[0]
    time.sleep(0.3)
    assert bus.angles[0] == pytest.approx(settled, abs=0.02)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_command_that_is_no_number_is_not_sent(bus, servos, value):
    servos.drive(np.array([value]))
    assert servos.rejected == 1 and not any(bus.torques.values())


def test_the_torque_is_off_after_the_end(bus):
    robot = robots.load("servo_pendulum")
    servos = ServoRobot(wiring.load(bus.file, robot), robot)
    servos.drive(np.array([0.2]))
    until(servos, lambda s: all(bus.torques.values()))  # it has read all that was sent
    told, execute = [], bus._execute
    bus._execute = lambda packet: told.append(packet.instruction) or execute(packet)
    servos.close()
    servos.close()
    end = time.monotonic() + 10.0  # a bus without processor time reads later
    while any(bus.torques.values()) and time.monotonic() < end:
        time.sleep(0.01)
    assert not any(bus.torques.values())
    assert told[0] == SYNC_WRITE  # all at once, before each is asked whether it heard


def test_a_servo_that_is_not_there_and_a_port_that_is_none_are_one_line(bus):
    robot = robots.load("servo_pendulum")
    bus.silence(1)
    with pytest.raises(GraphError, match="servo 1 .pivot. does not answer.*check its supply"):
        ServoRobot(wiring.load(bus.file, robot), robot)
    with pytest.raises(GraphError, match="/nowhere cannot be opened.*check bus.port"):
        ServoRobot(wiring.load(bus.file, robot, "/nowhere"), robot)
