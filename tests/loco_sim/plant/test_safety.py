# SPDX-License-Identifier: Apache-2.0
"""Commands within the limits pass untouched; others come back to them; excess stops."""

import dataclasses
import xml.etree.ElementTree as ElementTree
from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.types import MotionCommand, TrunkTorque
from loco_sim.plant.safety import Safety, SafetyParams
from loco_sim.plant.simulation import Simulation
from loco_sim.robot import robot as robots

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
    counted = {kind: count for kind, count in safety.limited.items() if count}
    assert counted == {"position": 1, "velocity": 1, "rate": 1, "torque": 1}


def test_the_first_command_may_be_anywhere_and_after_a_stop_it_may_not(hyq):
    safety, far = Safety(hyq, SafetyParams(rate=1.0), DT), np.array(hyq.standing) + 0.2
    assert np.array_equal(safety.limit(command(far), None)[0].q, far)
    with Simulation(robot="hyq") as sim:
        state = sim.reset()
    safety.resume(state)
    moved = safety.limit(command(far), None)[0].q - state.q
    assert np.all(np.abs(moved) <= SPEED * DT + 1e-12)


def test_values_that_are_not_finite_are_left_to_the_plant(safety, hyq):
    q = np.array(hyq.standing)
    q[4] = np.nan
    got, _ = safety.limit(command(q), None)
    assert np.isnan(got.q[4])
    after, _ = safety.limit(command(hyq.standing), None)
    assert np.array_equal(after.q, hyq.standing)


def test_a_value_that_is_no_number_does_not_free_the_command_after_it(hyq):
    safety, q = Safety(hyq, SafetyParams(rate=1.0), DT), np.array(hyq.standing)
    for sent in (q, np.where(np.arange(12) == 4, np.nan, q), q + 0.5):
        got, _ = safety.limit(command(sent), None)
    assert np.all(np.abs(got.q - q) <= SPEED * DT + 1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("joint", [0, 7, 11])
def test_each_joint_is_limited_alone_and_in_both_directions(hyq, joint, sign):
    one = np.where(np.arange(12) == joint, sign, 0.0)
    params = SafetyParams(velocity=1.0, rate=1.0, torque=1.0)
    safety, q = Safety(hyq, params, DT), np.array(hyq.standing)
    safety.limit(command(q), torque(0.0))
    got, trunk = safety.limit(command(q), dataclasses.replace(torque(0.0), tau=2 * EFFORT * one))
    np.testing.assert_allclose(trunk.tau, EFFORT * one)
    got, _ = safety.limit(dataclasses.replace(command(q), dq=2 * SPEED * one), torque(0.0))
    np.testing.assert_allclose(got.dq, SPEED * one)
    got, _ = safety.limit(command(q + one), torque(0.0))
    np.testing.assert_allclose(got.q - q, SPEED * DT * one, atol=1e-12)


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


def moving(joint, dq, tau=0.0):
    state = Moving(0.0, 0.0)
    state.dq[joint], state.tau[joint] = dq, tau
    return state


def ticks_to_trip(safety, state, most=20):
    """Ticks until the robot is stopped, None if it is not, and why."""
    for tick in range(1, most + 1):
        if why := safety.trip(state):
            return tick, why
    return None, ""


@pytest.mark.parametrize("joint", range(12))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize(("dq", "tau", "words"), [(31.0, 0.0, "moves at"), (19.0, 148.0, "takes")])
def test_every_joint_trips_in_both_directions_after_the_default_ticks(
    hyq, joint, sign, dq, tau, words
):
    safety = Safety(hyq, SafetyParams(), DT)
    ticks, why = ticks_to_trip(safety, moving(joint, sign * dq, -sign * tau))
    assert ticks == SafetyParams().trip_ticks == 5
    assert why.startswith(f"{hyq.joints[joint]} {words}")


@pytest.mark.parametrize("ticks", [1, 2, 7])
def test_trip_ticks_are_those_in_a_row(hyq, ticks):
    safety = Safety(hyq, SafetyParams(trip_ticks=ticks), DT)
    assert ticks_to_trip(safety, moving(0, 40.0))[0] == ticks
    safety.reset()
    assert ticks_to_trip(safety, moving(0, 40.0))[0] == ticks  # a reset begins to count anew
    safety.resume(SimpleNamespace(q=np.zeros(12)))
    assert ticks_to_trip(safety, moving(0, 40.0))[0] == ticks  # and so does the end of a stop


@pytest.mark.parametrize(
    ("just_within", "just_beyond"),
    [
        (moving(3, 2.5 * SPEED * 0.999), moving(3, 2.5 * SPEED * 1.001)),
        (moving(3, 20.0, 1.5 * EFFORT * SPEED / 20.0 * 0.999), moving(3, 20.0, 136.0)),
    ],
)
def test_by_default_joints_trip_at_these_multiples_of_the_urdf(hyq, just_within, just_beyond):
    assert ticks_to_trip(Safety(hyq, SafetyParams(), DT), just_within)[0] is None
    assert ticks_to_trip(Safety(hyq, SafetyParams(), DT), just_beyond)[0] == 5


def test_by_default_commands_are_limited_at_these_multiples_of_the_urdf(hyq):
    assert SafetyParams().enabled
    safety, q = Safety(hyq, SafetyParams(), DT), np.array(hyq.standing)
    got, trunk = safety.limit(command(q, 1e4), torque(1e4))
    np.testing.assert_allclose(got.dq, 4.0 * SPEED)
    np.testing.assert_allclose(trunk.tau, 2.0 * EFFORT)
    far = safety.limit(command(np.full(12, 1e4)), None)[0].q
    assert np.all(far - q <= 20.0 * SPEED * DT + 1e-9) and np.any(far - q > 0.5 * 20.0 * SPEED * DT)
    for _ in range(100):
        far = safety.limit(command(np.full(12, 1e4)), None)[0].q
    ends = far.copy()
    for _ in range(100):
        far = safety.limit(command(np.full(12, -1e4)), None)[0].q
    for joint, low, high in zip(hyq.joints, far, ends, strict=True):
        node = next(j for j in ElementTree.fromstring(hyq.urdf).iter("joint")
                    if j.get("name") == joint)  # fmt: skip
        limit = node.find("limit").attrib
        assert (low, high) == (float(limit["lower"]), float(limit["upper"])), joint


@pytest.mark.parametrize("joint", [0, 5, 11])
@pytest.mark.parametrize(
    ("dq", "tau"), [(np.nan, 0.0), (1.0, np.nan), (np.inf, 1.0), (-np.inf, 0.0), (0.0, np.inf)]
)
def test_a_reading_that_is_no_number_stops_the_robot_with_a_word(hyq, joint, dq, tau):
    ticks, why = ticks_to_trip(Safety(hyq, SafetyParams(), DT), moving(joint, dq, tau))
    assert ticks == 5
    assert why.startswith(f"{hyq.joints[joint]} measures ")
    assert ("nan" in why) or ("inf" in why)


def test_joints_without_limits_trip_only_on_what_is_no_number():
    robot = robots.load("tigrillo")
    passive = next(i for i in range(len(robot.joints)) if i not in robot.driven)
    state = Moving(0.0, 0.0)
    state.dq, state.tau = np.zeros(len(robot.joints)), np.zeros(len(robot.joints))
    state.dq[passive] = 1e6
    assert ticks_to_trip(Safety(robot, SafetyParams(), DT), state)[0] is None
    state.dq[passive] = np.nan
    assert ticks_to_trip(Safety(robot, SafetyParams(), DT), state)[0] == 5


@pytest.mark.parametrize("seed", range(3))
def test_references_bend_no_faster_than_allowed(hyq, seed):
    """Second and third differences of whatever is sent stay within acceleration and jerk."""
    most, fastest = 200.0, 2e4
    safety = Safety(hyq, SafetyParams(acceleration=most, jerk=fastest, position=10.0), DT)
    safety.limit(command(hyq.standing), None)
    rng, sent = np.random.default_rng(seed), [np.array(hyq.standing)] * 3
    for _ in range(100):
        wanted = command(hyq.standing + rng.normal(0.0, 0.3, 12))
        sent.append(safety.limit(wanted, None)[0].q)
    bend = np.diff(sent, 2, axis=0) / DT**2
    assert np.abs(bend).max() <= most * (1.0 + 1e-6)
    assert np.abs(bend).max() > 0.5 * most  # the limit is used
    assert safety.limited["acceleration"] + safety.limited["jerk"] > 0
    within = np.all(np.abs(bend[1:]) < most * (1.0 - 1e-6), axis=1)
    assert np.abs(np.diff(bend, axis=0)[within[: len(bend) - 1]]).max() <= fastest * DT * (1 + 1e-6)


def test_a_step_is_reached_under_acceleration_limits(hyq):
    safety = Safety(hyq, SafetyParams(acceleration=200.0), DT)
    safety.limit(command(hyq.standing), None)
    for _ in range(500):
        got = safety.limit(command(hyq.standing + 0.1), None)[0].q
    assert np.abs(got - hyq.standing - 0.1).max() < 0.05


def test_what_is_at_its_limit_is_within(hyq):
    params = SafetyParams(velocity=1.0, torque=1.0)
    safety = Safety(hyq, params, DT)
    for end in (safety._low, safety._high):
        safety.reset()
        sent = command(end, SPEED), torque(EFFORT)
        assert safety.limit(*sent) == sent
        safety.limit(command(end, 2.0 * SPEED), None)  # only its velocity is too much
    assert safety.limited == {**dict.fromkeys(safety.limited, 0), "velocity": 2}


def test_a_limit_of_jerk_alone_leaves_the_acceleration_free(hyq):
    safety = Safety(hyq, SafetyParams(jerk=1e9), DT)
    safety.limit(command(hyq.standing), None)
    got, _ = safety.limit(command(hyq.standing + 0.5), None)
    assert np.allclose(got.q, hyq.standing + 0.5)
    assert not any(safety.limited.values())


@pytest.mark.parametrize(("kind", "order"), [("acceleration", 2), ("jerk", 3)])
def test_each_limit_of_smoothness_holds_alone(hyq, kind, order):
    """From rest, the first command moves by one step of the difference that is limited."""
    most = 200.0
    safety = Safety(hyq, SafetyParams(**{kind: most}), DT)
    safety.limit(command(hyq.standing), None)
    moved = safety.limit(command(hyq.standing + 0.1), None)[0].q - hyq.standing
    np.testing.assert_allclose(moved, most * DT**order, rtol=1e-6)
    assert {k: n for k, n in safety.limited.items() if n} == {kind: 1}


def test_at_the_limit_of_speed_the_power_is_the_reason(hyq):
    _, why = ticks_to_trip(Safety(hyq, SafetyParams(), DT), moving(2, 2.5 * SPEED, EFFORT))
    assert "takes 4500 W, more than 2700" in why
