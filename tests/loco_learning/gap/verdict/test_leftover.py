# SPDX-License-Identifier: Apache-2.0
"""When what is left of a gap is little enough."""

import numpy as np
import pytest

from loco_learning.gap.verdict.decide import LIMITS, has_gap
from loco_learning.gap.verdict.leftover import adequate, explained

ROWS = 400


def record(*levels: float) -> np.ndarray:
    """Residual whose channels have these rms values, (ROWS, C)."""
    signs = np.where(np.arange(ROWS) % 2, 1.0, -1.0)
    return signs[:, None] * np.array(levels)


def test_all_near_the_floor_is_explained():
    assert adequate([record(10.0, 1.0)], [record(1.1, 1.0)], LIMITS)


@pytest.mark.parametrize("level", np.linspace(1.0, 1.9, 19))
def test_a_record_is_explained_by_the_same_number_that_says_whether_there_is_a_gap(level):
    before, after = [record(2.0)], [record(level)]
    assert adequate(before, after, LIMITS) == (not has_gap(after)) == explained(after, LIMITS)[0]


def test_the_shorter_a_record_the_more_may_be_chance():
    short, long = ([np.resize(record(1.35), (rows, 1))] for rows in (300, 30000))
    assert explained(short, LIMITS).all() and not explained(long, LIMITS).any()


def test_most_of_a_large_gap_closed_is_explained():
    assert adequate([record(30.0, 1.0)], [record(5.0, 1.0)], LIMITS)


def test_a_channel_that_is_half_explained_is_not():
    assert not adequate([record(10.0, 10.0)], [record(1.0, 6.0)], LIMITS)


@pytest.mark.parametrize(("alone", "explained"), [(2.0, True), (3.0, True), (8.0, False)])
def test_a_small_part_may_be_left_where_the_model_changes_nothing(alone, explained):
    before, after = record(12.0, alone), record(1.0, alone)
    assert adequate([before], [after], LIMITS) == explained


def test_one_bad_record_among_good_ones_shows():
    before, after = [record(10.0)] * 3, [record(1.0), record(1.0), record(6.0)]
    assert not adequate(before, after, LIMITS)


def test_an_accuracy_that_is_enough_counts_as_explained():
    before, after = [record(10.0)], [record(6.0)]
    assert not adequate(before, after, LIMITS)
    assert adequate(before, after, LIMITS, np.array([7.0]))
