# SPDX-License-Identifier: Apache-2.0
"""Prices, trifles, intervals and plain values: the parts of judging that need no simulation."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import rivals, sensitivity
from loco_sim.effects.coordinates import Coordinate

TORQUE = Coordinate("torque", 0.05, (1.0,), 0.0, 10.0, "N·m", strength=True)
DELAY = Coordinate("delay", 0.02, (1.0,), 0.0, 1.0, "s", strength=True)
SPEED = Coordinate("velocity", 0.1, (0.0,), 0.001, 10.0, "rad/s", logarithmic=True)


def hypothesis(effect: str, *coordinates: Coordinate) -> Hypothesis:
    return Hypothesis(effect, "knee", (("joint", "knee"),), coordinates)


COULOMB = hypothesis("coulomb_friction", TORQUE)
STRIBECK = hypothesis("stribeck_friction", TORQUE, SPEED)
COMMAND_DELAY = hypothesis("command_delay", DELAY)


def fitted(h: Hypothesis, shape: float = 0.0) -> Fitted:
    r = np.random.default_rng(0).normal(size=(500, 2))
    x = (1.0, shape)[: len(h.coordinates)]
    return Fitted(((h, x),), {}, 1.0, evidence.score([r]), (r,), 0.0)


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
    assert rivals.on_edge(law, x, 0.01) is edge


def test_a_parameter_more_costs_and_one_less_pays():
    simple, rich = fitted(COULOMB), fitted(STRIBECK)
    assert rivals.occam(simple, simple) == 0.0
    assert rivals.occam(rich, simple) == pytest.approx(-rivals.occam(simple, rich))
    assert rivals.occam(rich, simple) == pytest.approx(0.5 * np.log(1000.0), rel=0.1)


def test_a_shape_that_no_robot_has_costs_as_its_prior_says():
    usual, odd = fitted(STRIBECK), fitted(STRIBECK, 2.1)
    assert rivals.occam(odd, usual) == pytest.approx(0.5 * (2.1 / 0.7) ** 2)
    assert rivals.occam(fitted(STRIBECK, 70.0), usual) == pytest.approx(np.log(rivals.MOST_PRICE))


def test_a_trifle_is_told_only_where_sizes_compare():
    assert rivals.trifle(COMMAND_DELAY, [0.01])
    assert not rivals.trifle(COMMAND_DELAY, [0.5])
    assert not rivals.trifle(COULOMB, [1e-9])


def test_intervals_are_in_the_unit_and_may_pass_zero():
    strength, shape = sensitivity.estimates(
        STRIBECK, [1.0, 0.0], np.array([2.0, 0.98]), np.array([0.2, 0.2]), np.array([2.0, np.nan])
    )
    assert strength.value == pytest.approx(0.05)
    assert strength.low == pytest.approx(0.05 - 2.0 * 0.05)
    assert not strength.excludes_absent
    surer, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], np.array([0.5, 0.98]), *np.zeros((2, 2)))
    assert surer.low == pytest.approx(0.5 * 0.05) and surer.excludes_absent
    assert (strength.absent, strength.sign) == (0.0, 1)
    assert strength.spread == pytest.approx(0.01)
    assert shape.absent is None
    assert shape.low == pytest.approx(0.1 * np.exp(-0.98))
    wide = np.array([np.inf, 1.0])
    unknown, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), wide)
    assert (unknown.low, unknown.high) == (-np.inf, np.inf) and not unknown.excludes_absent


def test_an_effect_of_which_size_and_shape_show_together_is_there():
    """A cable's stiffness and free length may show as one force: neither is known by itself."""
    wide, sure = np.array([9.0, 9.0]), np.array([0.1, np.nan])
    strength, shape = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), sure)
    assert strength.low < 0.0 < strength.high
    assert strength.excludes_absent and not shape.excludes_absent


def test_halves_follow_flat():
    whole = [np.zeros((4, 2)), np.zeros((2, 2))]
    assert sensitivity.halves(whole).tolist() == [0] * 4 + [1] * 4 + [2] * 2 + [3] * 2
