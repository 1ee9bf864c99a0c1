# SPDX-License-Identifier: Apache-2.0
"""Prices of parameters, laws at the bound of a shape, and effects too small to matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.probability import prices
from loco_sim.effects import EFFECTS, offers
from loco_sim.effects.coordinates import Coordinate

from ..laws import COMMAND_DELAY, COULOMB, SPEED, STRIBECK, fitted, hypothesis


@pytest.mark.parametrize(
    ("law", "x", "edge"),
    [
        (STRIBECK, (1.0, 0.0), False),
        (STRIBECK, (1.0, SPEED.inverse(10.0)), True),
        (STRIBECK, (1.0, SPEED.inverse(9.95)), True),  # less than a hundredth below
        (STRIBECK, (1.0, 99.0), True),  # values are forced into their bounds
        (STRIBECK, (1.0, SPEED.inverse(0.001)), True),
        (STRIBECK, (0.0, 0.0), False),  # a strength of nothing is no shape
        (COULOMB, (0.0,), False),
        (COMMAND_DELAY, (50.0,), False),
    ],
)
def test_a_shape_on_its_bound_makes_another_law(law, x, edge):
    assert prices.on_edge(law, x, 0.01) is edge


@pytest.mark.parametrize("bound", [-3.0, 0.0, 3.0])
def test_a_value_at_its_bound_is_on_it_whatever_the_margin_and_the_side(bound):
    for bounds in ((bound, bound + 1.0), (bound - 1.0, bound), (-np.inf, bound)):
        assert prices.on_bound(bound, bounds, 0.0) and prices.on_bound(bound, bounds, 0.1)
        assert not prices.on_bound(bound + 0.5, bounds, 0.05)
    assert not prices.on_bound(bound, (-np.inf, np.inf), 0.5)


def test_a_parameter_more_costs_and_one_less_pays():
    simple, rich = fitted(COULOMB), fitted(STRIBECK)
    assert prices.occam(simple, simple) == 0.0
    assert prices.occam(rich, simple) == pytest.approx(-prices.occam(simple, rich))
    assert prices.occam(rich, simple) == pytest.approx(0.5 * np.log(1000.0), rel=0.1)


@pytest.mark.parametrize("shape", [0.0, 0.7, -1.4])
@pytest.mark.parametrize("other", [0.0, 1.0])
def test_what_a_model_costs_over_another_one_the_other_saves(shape, other):
    a, b = fitted(STRIBECK, shape), fitted(STRIBECK, other)
    assert prices.occam(a, b) == pytest.approx(-prices.occam(b, a))
    assert prices.occam(a, b) == pytest.approx(0.5 * ((shape / 0.7) ** 2 - (other / 0.7) ** 2))


def test_a_single_sample_is_no_reason_to_save_a_parameter():
    some = [np.ones((1, 1))]
    simple, rich = (replace(fitted(h), whole=some) for h in (COULOMB, STRIBECK))
    assert prices.occam(rich, simple) == 0.0


def test_a_shape_that_no_robot_has_costs_as_its_prior_says():
    usual, odd = fitted(STRIBECK), fitted(STRIBECK, 2.1)
    assert prices.occam(odd, usual) == pytest.approx(0.5 * (2.1 / 0.7) ** 2)
    assert prices.occam(fitted(STRIBECK, 70.0), usual) == pytest.approx(np.log(prices.MOST_PRICE))


def test_a_trifle_is_told_only_where_sizes_compare():
    assert prices.is_tiny(COMMAND_DELAY, [0.01])
    assert not prices.is_tiny(COMMAND_DELAY, [0.5])
    assert not prices.is_tiny(COULOMB, [1e-9])


def test_a_length_is_no_trifle_but_on_a_joint_that_turns():
    """A quarter of a millimetre is five floors of a slide's encoder (battery 10606: 76)."""
    zero = Coordinate("q", 1e-3, (1.0,), -0.1, 0.1, "rad", strength=True)
    law = hypothesis("sensor_bias", zero)
    assert prices.is_tiny(law, [0.26]) and prices.is_tiny(law, [0.26], {"another"})
    assert not prices.is_tiny(law, [0.26], {law.place})
    family = replace(law, place="*_joint", joints=("a_joint", "b_joint"))
    assert not prices.is_tiny(family, [0.26], {"b_joint"})


STRENGTHS = [(name, key) for name, cls in EFFECTS.items() for key in cls.identity.strengths]


@pytest.mark.parametrize(("name", "key"), STRENGTHS)
def test_a_trifle_is_far_below_what_any_robot_has(name, key):
    size = replace(offers.coordinate(EFFECTS[name], key), size=1.0, logarithmic=False)
    prior = EFFECTS[name].identity.priors[key]
    law, compares = hypothesis(name, size), size.unit in prices.COMPARABLE
    assert not prices.is_tiny(law, [prior.high])
    assert not prices.is_tiny(law, [0.5 * prior.low if prior.low > 0.0 else 0.1 * prior.high])
    for small in (0.0, 0.01 * (prior.low if prior.low > 0.0 else prior.high)):
        assert (
            prices.is_tiny(law, [small]) is compares and prices.is_tiny(law, [-small]) is compares
        )


def test_one_strength_that_matters_is_no_trifle_whatever_the_others_and_the_shapes():
    tilt = [Coordinate(a, 1.0, (1.0,), -1.0, 1.0, "rad", strength=True) for a in ("roll", "pitch")]
    law = hypothesis("imu_tilt", *tilt, SPEED)
    assert prices.is_tiny(law, [1e-6, 1e-6, 1.0])
    assert not prices.is_tiny(law, [1e-6, 0.2, 1.0]) and not prices.is_tiny(law, [0.2, 1e-6, 1.0])
