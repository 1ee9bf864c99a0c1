# SPDX-License-Identifier: Apache-2.0
"""The laws of a driver's tick: what it sends to servos, when, and when nothing but limp.

The node is called, not heard, and the servos only write down what they are told.
"""

import numpy as np
import pytest

pytest.importorskip("dynamixel_sdk")

from loco_bringup.testing import ASSETS  # noqa: E402
from loco_control.exceptions import ParameterError  # noqa: E402
from loco_control.ros.messages.joint_topics import JOINT_TOPICS  # noqa: E402
from loco_control.types import GroundTruth, MotionCommand, RobotState, TrunkTorque  # noqa: E402
from loco_msgs.msg import Event  # noqa: E402
from loco_sim.ros import driver_node  # noqa: E402
from loco_sim.ros.driver_node import DriverNode  # noqa: E402

pytestmark = pytest.mark.ros

RATE = 100.0  # [Hz]
APPROACH = 0.5  # fastest speed on the way to the standing posture, by default [rad/s]
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


class Servos:
    """Servos at an angle that write down what they are told."""

    fallen, rejected, lost, clipped = None, 0, 0, 0
    closed = False

    def __init__(self, wired, robot):
        self.robot, self.robot_description = robot, robot.urdf
        self.fault, self.q, self.told = "", 0.3, []

    def adc(self):
        return ()

    def ground_truth(self):
        return GroundTruth(0, 0.0, np.zeros(3), LEVEL, np.zeros(3), np.zeros(3))

    def reset(self):
        return self.measure(0, 0.0)

    def measure(self, tick, t):
        q = np.array([self.q])
        foot = np.zeros((0, 3))
        return RobotState(
            tick, t, q, 0.0 * q, 0.0 * q, foot, LEVEL, np.zeros(3), np.zeros(3), np.zeros(0, bool)
        )

    def drive(self, q, tau=None):
        self.told.append((float(q[0]), None if tau is None else float(tau[0])))

    def limp(self):
        self.told.append("limp")

    def close(self):
        self.closed = True


class Driver:
    """A driver of such servos."""

    def __init__(self, bench, run=True, **parameters):
        parameters = {"clock": "realtime", "robot": "servo_pendulum", **parameters}
        file = str(ASSETS / "servo_pendulum" / "servos.yaml")
        self.node = bench(DriverNode, JOINT_TOPICS, hardware=file, **parameters).node
        self.servos, self.told = self.node.sim, self.node.sim.told
        self.events, self.sent = events, sent = [], []
        # They hold no node: one that holds its test would stay until the next collection.
        self.node.event = lambda kind, text="", tick=0, t=0.0: events.append((kind, text, tick, t))
        self.node.send = lambda state: sent.append(state.tick)
        for name in sorted(self.node._waiting_for) if run else ():
            self.node._on_event(Event(node=name, kind="ready"))
        while run and not self.node.started:
            self.node._approach()
        if run:
            self.node._start_run()
            self.told.clear()

    def command(self, q, tick=None, tau=None):
        tick = self.node.state.tick if tick is None else tick
        trunk = None if tau is None else TrunkTorque(
            tick, 0.0, np.array([tau]), np.zeros(6), np.zeros(0, bool)
        )  # fmt: skip
        wanted = np.array([q])
        self.node._on_commands(MotionCommand(tick, tick / RATE, wanted, 0.0 * wanted), trunk)

    def step(self, count=1):
        """So many ticks are over."""
        for _ in range(count):
            self.node._step(self.node.state.tick)

    def kinds(self):
        return [event[0] for event in self.events]


@pytest.fixture(autouse=True)
def _servos(monkeypatch):
    monkeypatch.setattr(driver_node, "ServoRobot", Servos)


@pytest.mark.parametrize("clock", ["lockstep", "asap"])
def test_hardware_waits_for_nobody(bench, clock):
    with pytest.raises(ParameterError, match=f"got {clock}; take --clock realtime"):
        Driver(bench, clock=clock)


def test_nothing_is_sent_before_all_are_ready(bench):
    driver = Driver(bench, run=False)
    assert not driver.told and not driver.node.started
    assert driver.node.diagnose()["torque"] is False
    driver.node.close()
    assert driver.servos.closed


# ---- to the standing posture


def approach(driver, most=10_000):
    """Angles that are sent on the way."""
    for _ in range(most):
        driver.node._approach()
        if driver.node.started:
            return [q for q, _ in driver.told]
    raise AssertionError(f"not there after {most} ticks")


def ready(driver):
    for name in sorted(driver.node._waiting_for):
        driver.node._on_event(Event(node=name, kind="ready"))


@pytest.mark.parametrize("start", [1.3, -0.4])
def test_the_robot_goes_from_where_it_is_to_its_standing_posture_slowly_and_then_begins(
    bench, start
):
    driver = Driver(bench, run=False)
    driver.servos.q = start
    ready(driver)
    assert driver.kinds() == ["approach"] and not driver.told and not driver.sent
    way = [start, *approach(driver)]
    steps = np.diff(way)
    assert way[-1] == pytest.approx(driver.servos.robot.standing[0])
    assert np.all(steps * (way[-1] - start) >= 0.0)
    fastest = np.abs(steps).max() * RATE
    assert 0.9 * APPROACH < fastest <= 1.001 * APPROACH
    assert abs(steps[0]) < 0.1 * fastest / RATE and abs(steps[-1]) < 0.1 * fastest / RATE
    assert driver.sent == [0] and driver.kinds() == ["approach", "started"]
    assert driver.node._timer.is_canceled()


def test_a_robot_that_stands_already_is_told_so_once(bench):
    driver = Driver(bench, run=False)
    driver.servos.q = driver.servos.robot.standing[0]
    ready(driver)
    assert approach(driver) == [driver.servos.q]


@pytest.mark.parametrize("why", ["operator", "servo"])
def test_a_stop_on_the_way_is_limp_and_the_way_begins_anew_after_a_reset(bench, why):
    driver = Driver(bench, run=False)
    driver.servos.q = 1.3
    ready(driver)
    for _ in range(50):
        driver.node._approach()
    if why == "operator":
        driver.node._estop.engage("a finger")
        assert driver.told[-1] == "limp"
    driver.servos.fault = "" if why == "operator" else "servo 1 is hot"
    del driver.told[:]
    for _ in range(500):
        driver.node._approach()
    assert set(driver.told) == {"limp"} and not driver.node.started
    assert driver.events[-1][1] == (driver.servos.fault or "a finger")
    driver.servos.fault = driver.node._estop.reason = ""
    driver.servos.q = 1.1  # it has sunk
    del driver.told[:]
    way = [1.1, *approach(driver)]
    assert np.abs(np.diff(way)).max() * RATE <= 1.001 * APPROACH


# ---- ticks


def test_a_command_is_sent_as_soon_as_it_comes_and_once(bench):
    driver = Driver(bench)
    standing = driver.servos.robot.standing[0]
    for tick in range(5):
        driver.command(standing + 0.01 * tick)
        assert driver.told == [(pytest.approx(standing + 0.01 * tick), None)]
        driver.command(standing)
        driver.step()
        assert len(driver.told) == 1 and driver.sent[-1] == tick + 1
        driver.told.clear()


def test_a_command_of_another_tick_waits_for_the_end_of_this_one(bench):
    driver = Driver(bench)
    driver.command(0.0)
    driver.step(2)
    driver.told.clear()
    for tick in (1, 5):
        driver.command(0.01, tick)
        assert not driver.told
    driver.node._step(7)
    assert not driver.told and driver.node.state.tick == 2
    driver.step()
    assert driver.told == [(pytest.approx(0.01), None)]


def test_a_torque_goes_with_the_angle(bench):
    driver = Driver(bench)
    driver.command(0.0, tau=0.5)
    assert driver.told == [(0.0, 0.5)]


def test_the_first_command_is_compared_with_what_is_measured(bench):
    driver = Driver(bench)
    q = driver.servos.q
    driver.command(q + 2.0)
    velocity, rate = 13.2, DriverNode.margins.rate
    assert driver.told == [(pytest.approx(q + velocity * rate / RATE), None)]


def test_what_is_limited_is_told_the_first_time(bench):
    driver = Driver(bench)
    driver.command(driver.servos.q)
    assert "clipped" not in driver.kinds()
    for _ in range(3):
        driver.step()
        driver.command(9.0)
    assert [e[1] for e in driver.events if e[0] == "clipped"] == [
        "command brought back to the limit of rate"
    ]
    driver.servos.clipped = 3
    driver.step()
    driver.command(driver.servos.q)
    assert driver.events[-1][1] == "command brought back to the limit of servo"


def test_without_limits_only_the_servos_have_some(bench):
    driver = Driver(bench, **{"safety.enabled": False})
    driver.command(9.0)
    assert driver.told == [(9.0, None)] and "clipped" not in driver.kinds()


def test_ticks_that_were_missed_are_left_out(bench):
    driver = Driver(bench)
    assert driver.node.tick.catch_up == 1
    driver.step(2)
    driver.node._deadlines.dropped = 3
    driver.step()
    assert driver.sent == [0, 1, 2, 6] and driver.node.state.t == pytest.approx(0.06)
    driver.step()
    driver.node._deadlines.dropped = 4
    driver.step()
    assert driver.sent[-2:] == [7, 9]


# ---- stops


def test_before_the_first_command_it_is_limp(bench):
    driver = Driver(bench)
    driver.step(3)
    assert driver.told == 3 * ["limp"] and driver.node.diagnose()["torque"] is False


def test_commands_that_stay_away_are_held_then_limp_every_time(bench):
    driver = Driver(bench, **{"fallback.hold": 0.03})
    for _ in range(2):  # not only the first silence
        driver.command(driver.servos.q)
        driver.told.clear()
        silence = round(driver.node.tick.command_timeout * RATE)
        driver.step(silence + 1)  # the newest command is held
        assert driver.told == silence * [(pytest.approx(driver.servos.q), None)]
        driver.told.clear()
        driver.step(6)
        assert driver.told[:3] == 3 * [(driver.servos.q, 0.0)]  # where it is measured
        assert driver.told[3:] == 3 * ["limp"]
        assert driver.node.diagnose()["torque"] is False
    driver.command(driver.servos.q)
    assert driver.told[-1] != "limp" and driver.node.diagnose()["torque"] is True


def test_a_stop_is_limp_at_once_and_at_each_tick_until_the_reset(bench):
    driver = Driver(bench)
    driver.command(driver.servos.q)
    driver.told.clear()
    driver.node._estop.engage("a finger")
    assert driver.told == ["limp"]
    for _ in range(3):
        driver.step()
        driver.command(driver.servos.q)
    driver.step()
    assert set(driver.told) == {"limp"} and len(driver.told) >= 4
    driver.node._estop.reason = ""
    driver.node._on_estop("estop reset", "go on")
    assert driver.kinds()[-1] == "estop reset" and driver.told[-1] == "limp"
    driver.step()
    driver.command(driver.servos.q + 2.0)
    moved = driver.told[-1][0] - driver.servos.q
    assert 0.0 < moved <= 13.2 * DriverNode.margins.rate / RATE + 1e-9


def test_a_stop_with_a_held_posture_is_limp_too(bench):
    driver = Driver(bench, **{"fallback.hold": 10.0})
    driver.command(driver.servos.q)
    driver.step()
    driver.node._estop.engage("a finger")
    driver.told.clear()
    driver.step(3)
    assert driver.told == 3 * ["limp"]


@pytest.mark.parametrize("late", [False, True])
def test_a_fault_of_a_servo_stops_the_robot_with_its_words(bench, late):
    """Also while commands are late: nobody else looks at the servos then."""
    driver = Driver(bench)
    driver.command(driver.servos.q)
    driver.step(30 if late else 1)
    driver.servos.fault = "servo 1 (pivot) is hot"
    driver.step()
    assert driver.node._estop.reason == "servo 1 (pivot) is hot"
    assert driver.told[-1] == "limp" and driver.kinds()[-1] == "estop"
    driver.servos.fault = ""
    driver.step()
    driver.command(driver.servos.q)
    assert driver.told[-1] == "limp"


def test_at_the_end_it_is_limp_and_stays_so(bench):
    driver = Driver(bench, duration=0.05)
    for _ in range(5):
        driver.command(driver.servos.q)
        driver.step()
    assert driver.kinds()[-1] == "finished" and driver.told[-1] == "limp"
    driver.told.clear()
    driver.command(driver.servos.q)
    assert not driver.told
    assert driver.node.diagnose()["torque"] is False


def test_reports_tell_what_the_bus_has_lost(bench):
    driver = Driver(bench)
    driver.servos.lost = 7
    driver.command(driver.servos.q)
    report = driver.node.diagnose()
    assert (report["lost_packets"], report["torque"], report["tick"]) == (7, True, 0)
