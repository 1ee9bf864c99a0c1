# SPDX-License-Identifier: Apache-2.0
"""When what is left of a gap is little enough."""

import numpy as np
import pytest

from loco_learning.gap.statistics import evidence
from loco_learning.gap.statistics.leftover import LIMITS, adequate, explained, has_gap

ROWS = 400


def record(*levels: float) -> np.ndarray:
    """Residual whose channels have these rms values, (ROWS, C)."""
    signs = np.where(np.arange(ROWS) % 2, 1.0, -1.0)
    return signs[:, None] * np.array(levels)


def test_all_near_the_floor_is_explained():
    assert adequate([record(10.0, 1.0)], [record(1.1, 1.0)])


@pytest.mark.parametrize("level", np.linspace(1.0, 1.9, 19))
def test_a_record_is_explained_by_the_same_number_that_says_whether_there_is_a_gap(level):
    before, after = [record(2.0)], [record(level)]
    assert adequate(before, after) == (not has_gap(after)) == explained(after)[0]


def test_the_shorter_a_record_the_more_may_be_chance():
    short, long = ([np.resize(record(1.35), (rows, 1))] for rows in (300, 30000))
    assert explained(short).all() and not explained(long).any()


def test_most_of_a_large_gap_closed_is_explained():
    assert adequate([record(30.0, 1.0)], [record(3.0, 1.0)])


@pytest.mark.parametrize(("before", "after"), [(109.5, 24.5), (58.0, 8.2), (30.0, 5.0)])
def test_a_tenth_of_the_rms_is_what_may_be_left_not_a_third_of_it(before, after):
    """Names stood alone with 24.5 and 8.2 floors left: 90 % were of the energy."""
    assert evidence.closed(before, after) < 0.9
    assert not adequate([record(before, 1.0)], [record(after, 1.0)])


def test_a_channel_that_is_half_explained_is_not():
    assert not adequate([record(10.0, 10.0)], [record(1.0, 6.0)])


def test_one_bad_record_among_good_ones_shows():
    before, after = [record(10.0)] * 3, [record(1.0), record(1.0), record(6.0)]
    assert not adequate(before, after)


def test_an_accuracy_that_is_enough_counts_as_explained():
    before, after = [record(10.0)], [record(6.0)]
    assert not adequate(before, after)
    assert adequate(before, after, np.array([7.0]))


@pytest.mark.parametrize("channels", [1, 30])
def test_noise_at_the_limit_is_rarely_more_however_many_channels_there_are(channels):
    """The chance is that of a false alarm in any of them."""
    rng = np.random.default_rng(channels)
    level = LIMITS.explained
    draws = (level * rng.standard_normal((300, channels)) for _ in range(200))
    alarms = np.mean([not explained([r]).all() for r in draws])
    assert alarms <= 0.03


def test_a_channel_that_was_not_measured_leaves_nothing():
    r = record(3.0, 3.0)
    r[:, 0] = np.nan
    assert explained([r]).tolist() == [True, False]


def test_an_accuracy_of_one_channel_excuses_no_other():
    before, after = [record(10.0, 10.0)], [record(6.0, 6.0)]
    assert not adequate(before, after, np.array([7.0, 5.0]))
    assert adequate(before, after, np.array([7.0, 7.0]))


@pytest.mark.parametrize("alone", [1.6, 4.0])
def test_a_channel_that_the_model_does_not_change_is_not_explained(alone):
    """A lag of one leg, 4 floors, was no gap beside a rotor of another one, 16 floors."""
    assert not adequate([record(16.0, alone)], [record(1.0, alone)])
    assert adequate([record(16.0, 1.0)], [record(1.0, 1.0)])


def test_one_channel_of_many_is_a_gap():
    r = np.random.default_rng(1).normal(size=(800, 20))
    assert not has_gap([r])
    r[:, 7] *= 1.5
    assert has_gap([r])


def test_noise_alone_is_rarely_a_gap():
    rng = np.random.default_rng(2)
    hits = [has_gap([1.05 * rng.normal(size=(500, 8))]) for _ in range(60)]
    assert np.mean(hits) <= 0.05


def test_a_short_gap_is_one():
    r = np.random.default_rng(3).normal(size=(400, 1))
    r[50:60] += 30.0
    assert has_gap([r])
