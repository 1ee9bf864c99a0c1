# SPDX-License-Identifier: Apache-2.0
"""Laws of what is offered as a cause."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.hypotheses.hints import distinct, interval
from loco_learning.gap.hypotheses.hypotheses import Hypothesis, offer, omitted, separable
from loco_sim import effects
from loco_sim.effects.catalogue.compliance import rest
from loco_sim.effects.offers import Motion
from loco_sim.effects.places import chains, common, groups, links, members
from loco_sim.robot import robot

ROBOTS = ("servo_pendulum", "linear_axis", "hyq_leg", "tigrillo")
SIGNALS = ("q", "dq", "tau", "gyro", "acceleration", "grf")


def all_of(name):
    made = robot.load(name)
    n = len(made.joints)
    hints = Motion(np.full(n, -0.5), np.full(n, 0.5), ((1.0, 1.4),), ripples=((9.0, 40.0),) * n)
    return made, offer(made, SIGNALS, hints)


@pytest.mark.parametrize("name", ROBOTS)
def test_every_hypothesis_is_absent_at_strength_zero(name):
    for h in all_of(name)[1]:
        x = h.starts()[0]
        at = [0.0 if c.strength else v for c, v in zip(h.coordinates, x, strict=True)]
        effect = effects.from_list([h.term(at).spec])[0]
        if h.effect == "end_stop":  # a stop is absent without an angle, or without stiffness
            assert effect.stiffness <= 1e-3
        else:
            assert effect.absent(), h.key


@pytest.mark.parametrize("name", ROBOTS)
def test_every_start_is_a_possible_effect_and_keys_are_unique(name):
    hypotheses = all_of(name)[1]
    for h in hypotheses:
        for start in h.starts():
            assert not effects.from_list([h.term(start).spec])[0].absent(), h.key
    keys = [h.key for h in hypotheses]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("travel", [0.5, 2.5, 3.5, 100.0])
def test_the_whole_range_of_a_hypothesis_is_possible_however_far_a_joint_went(name, travel):
    """A joint that goes 2.5 rad had stops tried beyond the range that a stop may have."""
    made = robot.load(name)
    n = len(made.joints)
    hints = Motion(np.full(n, -travel), np.full(n, travel), ((1.0, 1.4),))
    for h in offer(made, SIGNALS, hints):
        ends = [[-1e9] * len(h.coordinates), [1e9] * len(h.coordinates), *h.starts()]
        for x in ends:
            effects.from_list([h.term(x).spec])


@pytest.mark.parametrize("name", ROBOTS)
def test_every_applicable_effect_is_offered_or_listed_as_not_tried_with_the_reason(name):
    made, hypotheses = all_of(name)
    offered = {h.effect for h in hypotheses}
    left = dict(omitted(made, hypotheses, SIGNALS))
    assert not offered & set(left)
    assert offered | set(left) == set(effects.applicable(made))
    assert all(left.values())
    said = {n for n in effects.applicable(made) if effects.EFFECTS[n].identity.untried}
    assert set(left) == said  # what was measured here says something of all others


def test_effects_of_readings_are_not_tried_along_the_measured_motion_and_that_is_the_reason():
    left = dict(omitted(robot.load("linear_axis"), (), ("tau",)))
    assert {"changes readings" in left[name] for name in ("sensor_gain", "sensor_latency")} == {
        True
    }
    assert "no place, time or signal" in left["push"]


@pytest.mark.parametrize(("height", "base"), [(0.0, 0.0), (1.3, 1.3), (None, 0.5)])
def test_a_cable_hangs_from_where_the_base_is(height, base):
    """A height of 0 is one; without any the robot stands on its feet."""
    made = replace(robot.load("servo_pendulum"), height=height)
    hints = Motion(np.full(1, -0.5), np.full(1, 0.5))
    offered = effects.EFFECTS["cable_force"].offers(made, ("q",), hints)
    every = [Hypothesis("cable_force", *one) for one in offered]
    assert {h.term(h.starts()[0]).params["anchor"][2] for h in every} == {base + 0.3, base + 1.0}


def test_the_end_of_a_cable_may_be_anywhere_near():
    """Of three places that were fixed none was that of a cable, and a constant force was named."""
    made = robot.load("servo_pendulum")
    motion = Motion(np.full(1, -0.5), np.full(1, 0.5))
    for one in effects.EFFECTS["cable_force"].offers(made, ("q",), motion):
        h = Hypothesis("cable_force", *one)
        start, first = h.starts()[0], len(h.coordinates) - 3
        at = np.array(h.term(start).params["anchor"])
        for axis in range(3):
            moved = [x + (i == first + axis) for i, x in enumerate(start)]
            change = np.array(h.term(moved).params["anchor"]) - at
            assert change[axis] > 0.1 and np.count_nonzero(change) == 1


def test_a_cable_is_tried_however_fast_the_physics():
    made = robot.load("linear_axis", {"sim.physics_rate": 20_000.0})
    offered = offer(made, SIGNALS, Motion(np.zeros(1), np.ones(1)))
    assert "cable_force" in {h.effect for h in offered}
    left = dict(omitted(made, offered, SIGNALS))
    assert "no place, time or signal" in left["push"]  # no time at which the residual is loud


def test_what_all_joints_share_is_one_hypothesis():
    """A supply sags for all drives: joint by joint it would take three names to explain it."""
    for name in ROBOTS:
        assert [h.place for h in all_of(name)[1] if h.effect == "supply_sag"] == [""]


@pytest.mark.parametrize("name", ["hyq_leg", "tigrillo"])
def test_stops_are_sought_at_either_end_of_the_way_that_a_joint_went(name):
    """Angles of a stop count from the joint's rest, which is not where its sensor says 0."""
    made = robot.load(name)
    slack = rest(made, np.arange(len(made.joints)))
    hints = Motion(slack - 0.4, slack + 0.3)
    for joint in made.joints:
        stops = [h for h in offer(made, ("q",), hints) if h.key.endswith(f" {joint}")]
        angles = {
            h.variant: [dict(h.term(x).params)["angle"] for x in h.starts()]
            for h in stops
            if h.effect == "end_stop"
        }
        assert set(angles) == {"above", "below"}
        assert max(angles["above"]) == pytest.approx(0.294)
        assert min(angles["below"]) == pytest.approx(-0.392)


@pytest.mark.parametrize(
    ("low", "high", "at"), [(0.2, 0.7, (0.21, 0.686)), (-0.7, -0.2, (-0.686, -0.21))]
)
def test_a_stop_on_the_side_of_the_rest_is_offered_with_its_side(low, high, at):
    """A finger or a knee whose range is all on one side of 0 has stops at either end."""
    made = robot.load("servo_pendulum")
    stops = {h.variant: h for h in offer(made, ("q",), Motion(np.full(1, low), np.full(1, high)))
             if h.effect == "end_stop"}  # fmt: skip
    assert set(stops) == {"above", "below"}
    for (variant, way), angle in zip((("below", -1.0), ("above", 1.0)), at, strict=True):
        first = stops[variant]
        angles = [first.term(x).params["angle"] for x in first.starts()]
        assert way * max(way * a for a in angles) == pytest.approx(angle)
        made_effect = effects.from_list([first.term(first.starts()[0]).spec])[0]
        turned = made_effect.constants(SimpleNamespace(robot=made), np.arange(1))
        assert turned[1] == way and low < turned[0][0] < high


def test_late_sensors_are_tried_where_data_could_tell_them_from_a_late_command():
    made = robot.load("hyq_leg")
    hints = Motion(np.full(3, -0.5), np.full(3, 0.5))

    def tried(signals, *effects):
        some = [h for h in offer(made, signals, hints) if h.effect in effects]
        return {h.key for h in separable(some)[0]}

    both = "command_delay", "sensor_latency"
    assert tried(("q",), *both) == {"command_delay"}
    assert tried(("q",), "sensor_latency") == {"sensor_latency"}
    apart = {"command_delay", "sensor_latency q", "sensor_latency tau"}
    assert tried(("q", "tau"), *both) == apart


def test_a_sensor_that_was_not_read_is_not_blamed():
    made = robot.load("tigrillo")
    hints = Motion(np.full(8, -0.5), np.full(8, 0.5))
    variants = {h.variant for h in offer(made, ("q",), hints) if h.effect == "sensor_bias"}
    assert variants == {"q"}


@pytest.mark.parametrize("name", ROBOTS)
def test_branches_hold_every_joint_once(name):
    made = robot.load(name)
    held = [joint for chain in chains(made) for joint in chain]
    assert sorted(held) == sorted(made.joints)
    assert sorted(j for group in groups(made) for j in group) == sorted(made.joints)


def test_patterns_name_exactly_their_joints():
    made = robot.load("tigrillo")
    for group in groups(made):
        assert members(made, common(group, made.joints)) == group


def test_links_of_a_bolted_base_do_not_move():
    made = robot.load("servo_pendulum")
    assert [name for name, _ in links(made)] == ["rod"]
    assert dict(links(made))["rod"] == (0.0, 0.0, -0.2)


@pytest.mark.parametrize("effect", ["push", "cable_force"])
def test_something_outside_may_pull_at_every_link_of_a_bolted_robot_else_at_the_base(effect):
    for name in ("hyq_leg", "tigrillo"):
        made, hypotheses = all_of(name)
        places = {h.place for h in hypotheses if h.effect == effect}
        moving = [link for link, _ in links(made)]
        assert places == set(moving if made.fixed_base else moving[:1])


def test_a_push_may_end_long_before_the_robot_is_calm():
    """A rod that was let go after 0.6 s rang for another second: a push of 1.6 s was sought."""
    made = robot.load("servo_pendulum")
    hints = Motion(np.full(1, -0.5), np.full(1, 0.5), ((1.07, 2.67),))
    for push in (h for h in offer(made, SIGNALS, hints) if h.effect == "push"):
        (stop,) = (c for c in push.coordinates if c.name == "stop")
        assert stop.low <= 1.07 and stop.high > 2.67
        tried = [stop.value(x) for x in stop.start]
        assert all(min(abs(t - end) for t in tried) < 0.45 for end in np.linspace(1.5, 2.67, 20))


def test_an_interval_is_found_where_the_residual_is_large_only_there():
    rng = np.random.default_rng(1)
    quiet = [rng.normal(size=(400, 2)) for _ in range(3)]
    pushed = [r.copy() for r in quiet]
    for r in pushed:
        r[150:220] += 12.0
    start, stop = interval(pushed, [0.01] * 3)
    assert start == pytest.approx(1.5, abs=0.1)
    assert stop == pytest.approx(2.2, abs=0.1)
    assert interval(quiet, [0.01] * 3) is None
    assert interval([r + 12.0 for r in quiet], [0.01] * 3) is None


def test_a_push_that_one_channel_of_many_feels_is_found_by_that_channel():
    rng = np.random.default_rng(1)
    records = [rng.normal(size=(400, 8)) for _ in range(3)]
    for r in records:
        r[150:220, 5] += 3.0
    alone = [[r[:, [c]] for r in records] for c in range(8)]
    assert interval(records, [0.01] * 3, sync=True) is None
    found = [interval(one, [0.01] * 3, sync=True) for one in alone]
    assert [i for i, each in enumerate(found) if each] == [5]
    assert found[5] == pytest.approx((1.5, 2.2), abs=0.1)
    records[0][:, 5] = np.roll(records[0][:, 5], 100)  # not at the same time
    assert interval(alone[5], [0.01] * 3) is not None
    alone[5][0] = records[0][:, [5]]
    assert interval(alone[5], [0.01] * 3, sync=True) is None


def test_intervals_that_differ_little_are_one():
    assert distinct([(1.0, 2.0), (1.1, 2.1), (1.0, 1.4)]) == ((1.0, 2.0), (1.0, 1.4))


def test_a_limited_rate_is_tried_from_the_speed_at_which_the_joint_was_seen_to_move():
    made = robot.load("hyq_leg")
    fast = np.array([0.5, 2.0, np.nan])
    hints = Motion(np.full(3, -0.5), np.full(3, 0.5), fast=fast)
    rates = [h for h in offer(made, SIGNALS, hints) if h.effect == "command_rate_limit"]
    sizes = {h.place: h.term(h.starts()[0]).params["slowness"] for h in rates}
    joints = made.joints
    assert [1.0 / sizes[j] for j in joints[:2]] == pytest.approx(fast[:2])
    assert sizes[joints[2]] == effects.EFFECTS["command_rate_limit"].identity.priors[
        "slowness"
    ].typical  # fmt: skip
