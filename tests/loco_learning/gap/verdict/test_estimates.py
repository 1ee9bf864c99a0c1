# SPDX-License-Identifier: Apache-2.0
"""When a fitted value is on its bound, and when it says that an effect is there."""

import math
from dataclasses import replace

import pytest

from loco_learning.gap.probability.prices import on_bound
from loco_learning.gap.verdict.estimates import ALARMS, Estimate, absent, alarms

FRICTION = Estimate("coulomb", 0.4, 0.35, 0.45, "N·m", least=0.0, most=5.0, sign=1)


def told(*estimates):
    """Alarms about an effect with these parameters."""
    return alarms("friction knee", estimates)


@pytest.mark.parametrize(
    ("value", "bounds", "edge", "wanted"),
    [
        (5.0, (0.0, 5.0), 0.01, True),
        (4.96, (0.0, 5.0), 0.01, True),
        (4.94, (0.0, 5.0), 0.01, False),
        (5.04, (0.0, 5.0), 0.01, True),  # a little beyond it
        (0.0, (0.0, 5.0), 0.01, True),
        (1e-9, (0.0, 5.0), 0.01, False),  # nothing is near 0 by a share of itself
        (-3.0, (-3.01, 9.0), 0.01, True),
        (3.0, (-3.01, 9.0), 0.01, False),
        (1e9, (-math.inf, math.inf), 0.5, False),
        (2.0, (1.0, 3.0), 0.5, True),  # half of the larger of both
        (2.0, (1.0, 3.0), 0.3, False),
    ],
)
def test_on_a_bound_is_a_share_of_the_larger_of_value_and_bound(value, bounds, edge, wanted):
    assert on_bound(value, bounds, edge) is wanted
    assert on_bound(value, bounds[::-1], edge) is wanted


@pytest.mark.parametrize(
    ("low", "high", "absent", "there"),
    [
        (0.35, 0.45, 0.0, True),
        (-0.45, -0.35, 0.0, True),
        (-0.1, 0.9, 0.0, False),
        (0.0, 0.9, 0.0, False),
        (-0.9, 0.0, 0.0, False),
        (0.95, 1.05, 1.0, False),
        (0.35, 0.45, 1.0, True),
        (-math.inf, math.inf, 0.0, False),
    ],
)
def test_an_effect_is_there_where_its_interval_leaves_nothing_out(low, high, absent, there):
    assert Estimate("size", 0.5 * (low + high), low, high, absent=absent).excludes_absent is there


def test_a_shape_never_says_that_an_effect_is_there():
    assert not Estimate("speed", 0.4, 0.35, 0.45, absent=None).excludes_absent
    assert not Estimate("speed", 0.4, 0.35, 0.45, absent=None, with_shapes=0.01).excludes_absent


@pytest.mark.parametrize(
    ("value", "absent", "half", "there"),
    [(0.4, 0.0, 0.1, True), (0.4, 0.0, 0.5, False), (-0.4, 0.0, 0.1, True), (0.4, 0.4, 0.1, False),
     (0.4, -0.4, 0.5, True), (0.4, 0.0, 0.4, False)],
)  # fmt: skip
def test_with_all_shapes_as_they_are_a_size_may_be_sure_though_its_interval_is_not(
    value, absent, half, there
):
    wide = Estimate("size", value, -9.0, 9.0, absent=absent, with_shapes=half)
    assert wide.excludes_absent is there


def test_what_is_usual_raises_no_alarm():
    assert told(FRICTION) == ()
    plain = Estimate("size", 0.4, 0.3, 0.5)
    assert (plain.sign, plain.absent, plain.spread, plain.unit) == (0, 0.0, 0.0, "-")
    assert (plain.least, plain.most) == (-math.inf, math.inf)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"value": 5.0}, "is on the bound of its range 0 to 5"),
        ({"value": -0.4, "least": -9.0}, "is negative, which is not physical"),
        ({"low": -9.0, "high": math.inf}, "has no interval: the data do not determine it"),
        ({"spread": 0.2}, "differs by 0.2 between parts of the data"),
    ],
)
def test_each_implausible_value_is_told(change, words):
    (alarm,) = told(replace(FRICTION, **change))
    value = change.get("value", 0.4)
    assert alarm == f"friction knee: coulomb = {value:.3g} N·m {words}"


def test_a_value_that_changes_nothing_may_drift_to_its_bound():
    """As the place of a load along the axis of the only joint, beside a mass that is known."""
    place = Estimate("y", 5.0, -math.inf, math.inf, "m", least=-5.0, most=5.0, absent=None)
    assert told(FRICTION, place) == ()
    assert len(told(FRICTION, replace(place, low=4.0, high=5.5))) == 1


def test_absence_is_no_bound():
    assert told(FRICTION, Estimate("viscous", 0.0, -0.01, 0.01, least=0.0, most=1.0)) == ()


@pytest.mark.parametrize(
    ("sign", "value", "word"), [(1, -0.4, "negative"), (-1, 0.4, "positive"), (0, -0.4, None)]
)
def test_a_sign_that_physics_forbids_is_told(sign, value, word):
    e = Estimate("size", value, value - 0.1, value + 0.1, "N", sign=sign)
    said = (f"friction knee: size = {value} N is {word}, which is not physical",) if word else ()
    assert told(e) == said


def test_a_spread_is_compared_to_the_distance_from_absence():
    """A gain of 1.1 is 0.1 away from none: parts of the data that differ by 0.05 differ by half."""
    gain = Estimate("gain", 1.1, 1.05, 1.15, absent=1.0, spread=0.05)
    assert told(gain) == ("friction knee: gain = 1.1 differs by 0.05 between parts of the data",)
    assert told(replace(gain, absent=0.0)) == () == told(replace(gain, absent=None))
    at = replace(gain, spread=ALARMS.spread * (1.1 - 1.0) * 0.999)
    assert told(at) == () != told(replace(gain, spread=ALARMS.spread * (1.1 - 1.0) * 1.001))


@pytest.mark.parametrize(("unit", "count"), [("N·m", 0), ("rad", 1)])
def test_a_component_near_zero_is_compared_to_the_whole_vector(unit, count):
    """The cosine of a ripple that is a sine; but what has another unit is no part of it."""
    sine = Estimate("sine", 0.05, 0.049, 0.051, "N·m")
    cosine = Estimate("cosine", -7e-5, -2e-4, 1e-4, unit, spread=1.6e-4)
    assert len(told(sine, cosine)) == count


def test_a_strength_must_be_known_and_a_shape_or_a_second_one_need_not():
    open_end = replace(FRICTION, low=-9.0, high=math.inf)
    shape = Estimate("speed", 0.1, -math.inf, math.inf, absent=None)
    known = replace(FRICTION, name="other")
    for estimates, count in (((open_end, shape), 2), ((open_end, known), 0), ((known, shape), 0)):
        assert sum("no interval" in alarm for alarm in told(*estimates)) == count


@pytest.mark.parametrize(
    ("low", "high", "known"),
    [(2.0, math.inf, True), (0.0, math.inf, False), (-math.inf, math.inf, False),
     (-math.inf, -1.0, True), (-math.inf, 0.0, False)],
)  # fmt: skip
def test_a_strength_without_one_end_has_a_size_where_absence_is_outside(low, high, known):
    """A stop that is harder than can be seen was unknown at 94 % closed."""
    value = 5.0 if low > -math.inf or high > 0.0 else -5.0
    stop = Estimate("stiffness", value, low, high, "N·m/rad")
    assert any("has no interval" in line for line in told(stop)) is not known
    assert stop.excludes_absent is known and absent([stop]) is not known


def test_an_effect_may_be_absent_only_if_all_its_strengths_may_be():
    may_be = replace(FRICTION, low=-0.1)
    shape = Estimate("speed", 0.1, -0.1, 0.3, absent=None)
    assert absent([may_be]) and absent([may_be, shape])
    assert not absent([may_be, FRICTION]) and not absent([FRICTION])
    assert not absent([shape]) and not absent([])
