# SPDX-License-Identifier: Apache-2.0
"""A robot of servos on a bus that may fail; time is the bus's, however busy the machine is."""

from contextlib import closing

import numpy as np
import pytest

pytest.importorskip("dynamixel_sdk")

from loco_control.exceptions import GraphError  # noqa: E402
from loco_sim.hardware import packets as p  # noqa: E402
from loco_sim.hardware.wiring import COUNTS, TURN  # noqa: E402

from .conftest import Servos, barked, passes, put, said  # noqa: E402

WATCHDOG = 0.2  # by default [s]


@pytest.fixture
def servos(bus):
    servos = Servos(bus)
    yield servos
    servos.close()


@pytest.fixture
def joints(arm):
    """Servos of the arm: number 4 takes angles, number 2 torques."""
    servos = Servos(arm)
    yield servos
    servos.close()


def until(servos, bus, reached, q=None, patience=10.0):
    """Drive, or only measure, until a state is reached."""
    end = bus.time + patience
    while not reached(state := servos.measure(0, 0.0)):
        assert bus.time < end, (state, servos.fault)
        if q is not None:
            servos.drive(np.array([q]))
        passes(bus, 0.01)
    return state


def near(q):
    return lambda s: abs(s.q[0] - q) < 0.05 and abs(s.dq[0]) < 0.2


def told(bus, monkeypatch):
    """Instructions that the bus gets from now on."""
    packets, execute = [], bus._execute
    monkeypatch.setattr(bus, "_execute", lambda packet: packets.append(packet) or execute(packet))
    return packets


# ---- what is sent


def test_it_is_limp_until_it_is_driven_and_goes_where_it_is_told(bus, servos):
    assert not any(bus.torques.values())
    state = until(servos, bus, near(0.4), q=0.4)
    assert all(bus.torques.values()) and not any(barked(bus))
    assert bus.angles[0] == pytest.approx(state.q[0], abs=0.05)
    servos.limp()
    until(servos, bus, lambda s: not any(bus.torques.values()))


def test_each_servo_takes_what_its_drive_wants_within_its_limits(arm, joints):
    assert said(arm, 4, p.OPERATING_MODE) == p.POSITION_MODE
    assert said(arm, 2, p.OPERATING_MODE) == p.CURRENT_MODE
    joints.drive(np.array([0.1, 3.0]), np.array([9.0, 0.2]))
    joints.measure(0, 0.0)
    assert said(arm, 4, p.GOAL_POSITION) == round(1000 + 0.1 / TURN)
    assert said(arm, 4, p.GOAL_CURRENT) == int(1.2 / 0.00269)  # its limit, no torque
    assert said(arm, 2, p.GOAL_CURRENT) == round(-0.2 / 0.00269)
    for wanted in (9.0, -9.0):
        joints.drive(np.zeros(2), np.array([0.0, wanted]))
        joints.measure(0, 0.0)
        assert said(arm, 2, p.GOAL_CURRENT) == -np.sign(wanted) * int(0.5 / 0.00269)  # the URDF's
    assert joints.clipped == 0
    assert all(arm.torques.values())
    assert {said(arm, n, p.BUS_WATCHDOG) for n in (2, 4)} == {round(WATCHDOG / p.WATCHDOG_UNIT)}


def test_what_is_measured_is_what_the_robot_does(arm, joints):
    for _ in range(20):
        joints.drive(np.array([0.3, 0.0]), np.array([0.0, 0.1]))
        passes(arm, 0.01)
        state, true = joints.measure(3, 0.03), arm.angles
    np.testing.assert_allclose(state.q, true, atol=0.3)  # it moves meanwhile
    joints.limp()
    passes(arm, 3.0)  # at rest
    np.testing.assert_allclose(joints.measure(0, 0.0).q, arm.angles, atol=2 * TURN)
    assert (state.tick, state.t) == (3, 0.03)
    assert not joints.fault and joints.lost == 0


@pytest.mark.parametrize(("angle", "count"), [(10.0, COUNTS - 1), (-10.0, 0)])
def test_a_goal_beyond_the_turn_of_a_servo_is_its_end_and_is_counted(arm, joints, angle, count):
    joints.drive(np.array([angle, 10.0]), np.zeros(2))
    joints.measure(0, 0.0)
    assert said(arm, 4, p.GOAL_POSITION) == count
    assert joints.clipped == 1


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_command_that_is_no_number_is_not_sent(arm, joints, value):
    joints.drive(np.array([value, 0.0]), np.zeros(2))
    joints.drive(np.zeros(2), np.array([0.0, value]))
    joints.measure(0, 0.0)
    assert joints.rejected == 2 and not any(arm.torques.values())


# ---- servos that fail


def test_a_bus_that_loses_and_garbles_packets_is_counted_and_followed(bus, servos):
    bus.lost = bus.garbled = 0.1
    until(servos, bus, lambda s: abs(s.q[0] - 0.4) < 0.05, q=0.4)
    until(servos, bus, lambda s: servos.lost > 0, q=0.4)


@pytest.mark.parametrize(("silent", "name"), [(4, "servo 4 (shoulder)"), (2, "servo 2 (elbow)")])
def test_a_silent_servo_is_named_after_some_readings_in_a_row_and_hides_no_other(
    arm, joints, silent, name
):
    for _ in range(2):  # not only the first time
        arm.silence(silent)
        before = joints.lost
        for reading in range(1, 9):
            joints.measure(0, 0.0)
            assert joints.lost == before + reading
            assert joints.fault == (f"{name} does not answer" if reading >= 5 else "")
        arm.silence(silent, False)
        joints.measure(0, 0.0)
        assert joints.lost == before + 8 and not joints.fault


@pytest.mark.parametrize("garbled", [4, 2])
def test_a_garbled_answer_is_lost_and_no_other(arm, monkeypatch, garbled):
    whole = arm._read

    def read(number, address, size):
        answer = whole(number, address, size)
        return answer[:-1] + bytes([answer[-1] ^ 1]) if number == garbled else answer

    # The good answer lies behind the garbled one while a busy machine lets the time-out go by.
    with closing(Servos(arm, latency=0.1)) as joints:
        monkeypatch.setattr(arm, "_read", read)
        for reading in range(1, 5):
            joints.measure(0, 0.0)
            assert joints.lost == reading and not joints.fault
        joints.measure(0, 0.0)
        assert joints.fault.startswith(f"servo {garbled} (")


@pytest.mark.parametrize("servo", [4, 2])
def test_a_servo_beyond_its_temperature_is_named(arm, joints, servo):
    for degrees, fault in ((65, ""), (66, "is at 66 degC, more than 65"), (40, "")):
        put(arm, servo, p.PRESENT_TEMPERATURE, degrees)
        joints.measure(0, 0.0)
        assert fault in joints.fault and bool(joints.fault) == bool(fault)
        assert f"servo {servo} (" in joints.fault or not fault


@pytest.mark.parametrize("servo", [4, 2])
@pytest.mark.parametrize(("error", "words"), [*p.ERRORS.items(), (0x40, "a hardware error")])
def test_an_error_is_named_however_cold_the_servo_is(arm, joints, servo, error, words):
    put(arm, servo, p.PRESENT_TEMPERATURE, 5)
    put(arm, servo, p.HARDWARE_ERROR, error)
    joints.measure(0, 0.0)
    assert joints.fault.startswith(f"servo {servo} (") and joints.fault.endswith(f"reports {words}")


def test_a_servo_that_overheats_is_named(bus, servos):
    bus.overheat(1)
    servos.measure(0, 0.0)
    assert servos.fault == "servo 1 (pivot) reports overheating"


@pytest.mark.parametrize(
    ("fails", "words"),
    [(lambda arm: arm.silence(2), "servo 2 (elbow) does not answer"),
     (lambda arm: put(arm, 2, p.HARDWARE_ERROR, 0x20), "servo 2 (elbow) refuses 1 at address 64")],
)  # fmt: skip
def test_torque_that_cannot_be_had_is_off_everywhere_and_a_fault_of_the_next_reading(
    arm, fails, words
):
    servos = Servos(arm, missing=1000)
    fails(arm)
    servos.drive(np.zeros(2))
    assert words in servos.fault
    put(arm, 2, p.HARDWARE_ERROR, 0)
    servos.measure(0, 0.0)
    assert words in servos.fault
    assert not any(arm.torques.values())
    servos.measure(0, 0.0)
    assert not servos.fault  # said once; whoever hears it stops the robot for good
    servos.close()


# ---- watchdogs


def test_a_driver_that_falls_silent_leaves_servos_that_stay_and_speaks_to_them_again(bus, servos):
    until(servos, bus, near(0.4), q=0.4)
    servos.drive(np.array([-0.4]))
    passes(bus, 0.5 * WATCHDOG)
    assert not any(barked(bus))
    passes(bus, WATCHDOG)
    assert all(barked(bus))
    passes(bus, 3.0)
    settled = bus.angles[0]
    passes(bus, 0.3)
    assert bus.angles[0] == pytest.approx(settled, abs=0.02)
    until(servos, bus, near(-0.4), q=-0.4)


def test_a_torque_is_gone_when_the_driver_falls_silent(arm, joints):
    joints.drive(np.zeros(2), np.array([0.0, 0.3]))
    joints.measure(0, 0.0)
    assert said(arm, 2, p.GOAL_CURRENT)
    passes(arm, 1.5 * WATCHDOG)
    assert all(barked(arm)) and not said(arm, 2, p.GOAL_CURRENT)


def test_servos_whose_watchdog_barked_before_a_goal_had_come_follow_again(bus, monkeypatch):
    """The driver loses the processor between its look at the clock and the goal."""
    servos = Servos(bus)
    until(servos, bus, near(0.4), q=0.4)
    with monkeypatch.context() as patched:
        send = servos._send
        patched.setattr(servos, "_send", lambda *goal: (passes(bus, 2.0 * WATCHDOG), send(*goal)))
        servos.drive(np.array([0.4]))
    assert all(barked(bus))
    until(servos, bus, near(-0.4), q=-0.4)
    servos.close()


def test_servos_that_heard_nothing_for_a_while_follow_again(bus):
    servos = Servos(bus, missing=1000)
    until(servos, bus, near(0.4), q=0.4)
    bus.lost, end = 1.0, bus.time + 2.0 * WATCHDOG
    while bus.time < end:
        servos.measure(0, 0.0)
        servos.drive(np.array([0.4]))
    assert all(barked(bus))
    bus.lost = 0.0
    until(servos, bus, near(-0.4), q=-0.4)
    servos.close()


@pytest.mark.parametrize("watchdog", [0.02, 0.059, 0.2, 2.54])
def test_the_driver_never_takes_a_servo_for_awake_that_has_barked(bus, watchdog):
    servos = Servos(bus, watchdog=watchdog)
    servos.drive(np.array([0.1]))
    assert said(bus, 1, p.BUS_WATCHDOG) in (int(watchdog / p.WATCHDOG_UNIT), p.EXPIRED)
    while not any(barked(bus)):
        passes(bus, 0.01)
    assert servos._expired(0)
    servos.close()


# ---- the line


def test_an_answer_that_is_there_counts_however_late_it_is_read(bus, servos, monkeypatch):
    read, early = servos._port.ser.read, []

    def late(length):
        if not early:
            return read(length)
        early.clear()
        passes(bus, 0.1)  # it comes now, and the driver is away beyond all patience with it
        return b""

    monkeypatch.setattr(servos._port.ser, "read", late)
    for _ in range(5):
        early.append("too early for the answer")
        servos.measure(0, 0.0)
    assert servos.lost == 0 and not servos.fault


def test_an_error_of_the_line_does_not_keep_the_end_of_the_torque_from_being_sent(bus, monkeypatch):
    servos = Servos(bus)
    until(servos, bus, lambda s: all(bus.torques.values()), q=0.1)

    def fails(packet):
        raise OSError("unplugged")

    with monkeypatch.context() as patched:
        patched.setattr(servos._port.ser, "write", fails)
        with pytest.raises(GraphError, match="is gone: unplugged"):
            servos.measure(0, 0.0)
    packets = told(bus, monkeypatch)
    servos.close()
    passes(bus, 0.05)
    assert not any(bus.torques.values()) and packets[0].instruction == p.SYNC_WRITE


def test_the_torque_is_off_after_the_end(arm, monkeypatch):
    servos = Servos(arm)
    servos.drive(np.array([0.2, 0.0]))
    servos.measure(0, 0.0)
    assert all(arm.torques.values())
    packets = told(arm, monkeypatch)
    arm.silence(4)  # in the way of none
    servos.close()
    servos.close()
    passes(arm, 0.05)
    assert not any(arm.torques.values())
    assert packets[0].instruction == p.SYNC_WRITE  # all at once, before each is asked
    assert said(arm, 2, p.BUS_WATCHDOG) == 0


def test_a_servo_that_is_not_there_and_a_port_that_is_none_are_one_line(arm):
    arm.silence(2)
    with pytest.raises(GraphError, match="servo 2 .elbow. does not answer.*check its supply"):
        Servos(arm)
    with pytest.raises(GraphError, match="/nowhere cannot be opened.*check bus.port"):
        Servos(arm, port="/nowhere")
