# SPDX-License-Identifier: Apache-2.0
"""Commands within the limits pass untouched; others come back to them; excess stops."""

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim import robot as robots
from loco_sim.safety import Safety, SafetyParams
from loco_sim.simulation import Simulation

SPEED, EFFORT = 12.0, 150.0  # of HyQ's URDF
DT = 0.004


@pytest.fixture(scope="module")
def hyq():
    return robots.load("hyq")


@pytest.fixture
def safety(hyq):
    return Safety(hyq, SafetyParams(), DT)


def command(q, dq=0.0):
    return MotionCommand(3, 0.012, np.array(q, dtype=float), np.full(12, float(dq)))


def torque(value):
    return TrunkTorque(3, 0.012, np.full(12, float(value)), np.zeros(6), np.ones(4, dtype=bool))


def test_a_healthy_command_is_the_same_object(safety, hyq):
    sent = command(hyq.standing, 5.0), torque(140.0)
    assert safety.limit(*sent)[0] is sent[0]
    assert safety.limit(*sent)[1] is sent[1]
    assert set(safety.limited.values()) == {0}


@pytest.mark.parametrize("seed", range(5))
def test_whatever_is_sent_what_comes_out_is_within_the_limits(hyq, seed):
    params = SafetyParams(velocity=1.0, rate=1.0, torque=1.0)
    safety, rng = Safety(hyq, params, DT), np.random.default_rng(seed)
    before = None
    for _ in range(50):
        scale = 10.0 ** rng.uniform(-2, 3)
        sent = command(rng.normal(0.0, scale, 12), rng.normal(0.0, scale))
        got, trunk = safety.limit(sent, torque(rng.normal(0.0, 10.0 * scale)))
        assert np.all(np.abs(got.q) < 2.5)
        assert np.all(np.abs(got.dq) <= SPEED)
        assert np.all(np.abs(trunk.tau) <= EFFORT)
        if before is not None:
            assert np.all(np.abs(got.q - before) <= SPEED * DT + 1e-12)
        before = got.q


def test_limits_are_counted_by_kind(safety, hyq):
    safety.limit(command(hyq.standing, 1e3), torque(1e4))
    safety.limit(command(hyq.standing + 2.0), torque(0.0))
    assert safety.limited == {"position": 1, "velocity": 1, "rate": 1, "torque": 1}


def test_the_first_command_may_be_anywhere_and_after_a_stop_it_may_not(hyq):
    safety, far = Safety(hyq, SafetyParams(rate=1.0), DT), np.array(hyq.standing) + 0.2
    assert np.array_equal(safety.limit(command(far), None)[0].q, far)
    with Simulation(robot="hyq", impedance=_gains()) as sim:
        state = sim.reset()
    safety.resume(state)
    moved = safety.limit(command(far), None)[0].q - state.q
    assert np.all(np.abs(moved) <= SPEED * DT + 1e-12)


def _gains():
    from loco_control.impedance import ImpedanceParams

    return ImpedanceParams()


def test_values_that_are_not_finite_are_left_to_the_plant(safety, hyq):
    q = np.array(hyq.standing)
    q[4] = np.nan
    got, _ = safety.limit(command(q), None)
    assert np.isnan(got.q[4])
    after, _ = safety.limit(command(hyq.standing), None)
    assert np.array_equal(after.q, hyq.standing)


def test_passive_joints_and_torque_drives_have_no_position_reference():
    for name in ("tigrillo", "pendulum"):
        robot = robots.load(name)
        safety = Safety(robot, SafetyParams(), 0.01)
        n = len(robot.joints)
        passive = [i for i in range(n) if i not in robot.driven]
        q = np.zeros(n)
        q[passive] = 50.0
        assert np.array_equal(safety.limit(MotionCommand(0, 0.0, q, q * 0.0), None)[0].q, q)


class Moving:
    """State of which only velocity and torque count."""

    def __init__(self, dq, tau):
        self.dq, self.tau = np.zeros(12), np.zeros(12)
        self.dq[5], self.tau[5] = dq, tau


@pytest.mark.parametrize(
    ("dq", "tau", "words"),
    [(40.0, 0.0, "lf_kfe_joint moves at 40"), (20.0, 140.0, "lf_kfe_joint takes 2800 W")],
)
def test_excess_stops_after_some_ticks_in_a_row(hyq, dq, tau, words):
    joint = hyq.joints[5]
    safety = Safety(hyq, SafetyParams(trip_ticks=3), DT)
    assert [safety.trip(Moving(dq, tau)) for _ in range(2)] == ["", ""]
    assert safety.trip(Moving(1.0, 1.0)) == ""
    assert [safety.trip(Moving(dq, tau)) for _ in range(2)] == ["", ""]
    assert safety.trip(Moving(dq, tau)).startswith(words.replace("lf_kfe_joint", joint))


def test_a_healthy_robot_never_trips(safety):
    assert not any(safety.trip(Moving(12.0, 120.0)) for _ in range(20))
