# SPDX-License-Identifier: Apache-2.0
"""Intervals of strengths follow the cost, not its derivatives at the best value."""

from __future__ import annotations

import math

import pytest

from loco_learning.gap.statistics.profile import FURTHER, HOLDS, STEPS, interval

PROMISED = 2.0  # cost at the end of a 95 % interval [nat]


def test_where_derivatives_tell_the_truth_the_interval_is_theirs():
    asked = []

    def cost(x):
        asked.append(x)
        return PROMISED * ((x - 5.0) / 0.4) ** 2

    assert interval(cost, 5.0, 0.4, PROMISED, True) == (4.6, 5.4)
    assert asked == [4.6, 5.4]  # two simulations


def test_a_stop_that_is_harder_than_can_be_seen_has_a_lower_end_alone():
    """The motion tells one over the stiffness: a symmetric interval held nothing at all."""

    def cost(x):
        return PROMISED * ((1.0 / max(x, 1e-9) - 0.2) / 0.3) ** 2

    low, high = interval(cost, 5.0, 7.5, PROMISED, True)
    assert 0.0 < low <= 2.0 and high == math.inf


@pytest.mark.parametrize("width", [0.5, 1.0, 3.0])
def test_an_interval_is_longer_where_the_cost_stays_flat(width):
    """Play that moves nothing for a while: both intervals excluded the truth."""

    def cost(x):
        return 10.0 * PROMISED * max(abs(x - 10.0) - width, 0.0) ** 2

    low, high = interval(cost, 10.0, 0.2, PROMISED, True)
    edge = width + math.sqrt(0.1)
    assert 10.0 - FURTHER * edge <= low <= 10.0 - width
    assert 10.0 + width <= high <= 10.0 + FURTHER * edge


@pytest.mark.parametrize("one_sided", [True, False])
def test_what_the_data_do_not_show_may_be_nothing_or_anything(one_sided):
    low, high = interval(lambda x: 0.0, 1.0, 3.0, PROMISED, one_sided)
    assert low == (0.0 if one_sided else -math.inf) and high == math.inf


@pytest.mark.parametrize("edge", [0.45, 0.2, 0.07, 0.031])
@pytest.mark.parametrize("radius", [1.0, 2.0])
def test_a_lower_end_is_the_first_that_costs_enough_below_the_value(edge, radius):
    """Although the cost rises above the value as well."""

    def cost(x):
        return PROMISED * (x < edge or x > 1.0)

    low, high = interval(cost, 1.0, radius, PROMISED, True)
    assert 0.4 * edge <= low < edge and high == 1.0 + radius


@pytest.mark.parametrize("unit", [1.0 / 64.0, 0.25, 1024.0])
@pytest.mark.parametrize("radius", [0.25, 0.75, 2.0])
@pytest.mark.parametrize("one_sided", [True, False])
def test_in_another_unit_the_interval_is_the_same(unit, radius, one_sided):
    def cost(x):
        return PROMISED * (math.log(max(x, 1e-9) / 0.5) / 0.9) ** 2

    at = interval(cost, 0.5, radius, PROMISED, one_sided)
    scaled = interval(lambda x: cost(x / unit), 0.5 * unit, radius * unit, PROMISED, one_sided)
    assert scaled == tuple(unit * end for end in at)


@pytest.mark.parametrize(("share", "steps"), [(HOLDS, 1.0), (1.0, FURTHER), (1.0, FURTHER**2)])
def test_an_end_may_cost_no_more_than_it_has_to(share, steps):
    """A cost that jumps to just what an end needs, at the first step or at a further one."""
    low, high = interval(
        lambda x: share * PROMISED * (abs(x - 8.0) >= 0.25 * steps), 8.0, 0.25, PROMISED, True
    )
    assert (low, high) == (8.0 - 0.25 * steps, 8.0 + 0.25 * steps)


def test_a_size_of_either_sign_keeps_its_two_sides():
    def cost(x):
        return PROMISED * ((x + 2.0) / 1.5) ** 2

    assert interval(cost, -2.0, 1.5, PROMISED, False) == (-3.5, -0.5)
    assert STEPS > 2


def test_an_end_costs_at_least_what_derivatives_promise():
    """Towards 0 the first share that costs it, on a side that they put beyond 0."""

    def cost(x):
        return PROMISED * ((x - 1.0) / 0.5) ** 2

    assert interval(cost, 1.0, 1.5, PROMISED, True)[0] == 0.5
    assert interval(lambda x: 0.99 * cost(x), 1.0, 1.5, PROMISED, True)[0] == 0.25
