# SPDX-License-Identifier: Apache-2.0
"""When a fitted value is on its bound, and when it says that an effect is there."""

import math

import pytest

from loco_learning.gap.statistics.evidence import Comparison
from loco_learning.gap.verdict.candidates import Candidate, Estimate, Rival, on_bound

EVEN = Comparison(0.0, -1.0, 1.0, 0.5, 1.0, 9)


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


def test_what_nobody_said_speaks_neither_for_nor_against_a_candidate():
    plain = Estimate("size", 0.4, 0.3, 0.5)
    assert (plain.sign, plain.absent, plain.spread, plain.unit) == (0, 0.0, 0.0, "-")
    assert (plain.least, plain.most) == (-math.inf, math.inf)
    rival = Rival("delay", "", EVEN)
    assert (rival.trifle, rival.worse, rival.edge) == (False, 1.0, False)
    assert math.isnan(rival.closed)
    candidate = Candidate("lag", "knee", (plain,), EVEN, 0.5)
    assert (candidate.trifle, candidate.worse, candidate.elsewhere) == (False, 1.0, False)
    assert candidate.rivals == () == candidate.traded and candidate.total is None
