# SPDX-License-Identifier: Apache-2.0
"""Sizes over days: what is absent, always there, or begins on a day, and what spreads."""

import numpy as np
import pytest

from loco_learning.gap.fleet import pooling
from loco_learning.gap.fleet.course import ALWAYS, APPEARS, CHANGES, DISAPPEARS, course
from loco_learning.gap.probability.weights import CRITERION

NOISE, LITTLE = 0.05, 0.02


def of(levels, seed=0, noise=NOISE):
    """Course of sizes with noise about levels, one for each day."""
    levels = np.asarray(levels, dtype=float)
    sizes = levels + noise * np.random.default_rng(seed).standard_normal(len(levels))
    return course(sizes, np.full(len(levels), noise**2), 1.0, LITTLE, 0.5)


@pytest.mark.parametrize("onset", range(1, 8))
def test_an_onset_is_dated_at_its_day(onset):
    found = of([0.0] * onset + [1.0] * (8 - onset), seed=onset)
    assert (found.kind, found.change) == (APPEARS, onset)
    assert found.present > 0.99 and found.date > 0.9
    assert np.all(found.sizes[:onset] == 0.0)
    assert np.allclose(found.sizes[onset:], 1.0, atol=4.0 * NOISE)


def test_days_in_the_other_direction_end_what_began():
    sizes = np.array([0.0, 0.01, -0.02, 1.0, 0.98])
    options = np.full(5, NOISE**2), 1.0, LITTLE, 0.5
    begins, ends = course(sizes, *options), course(sizes[::-1], *options)
    assert (begins.kind, ends.kind) == (APPEARS, DISAPPEARS)
    assert begins.change + ends.change == 5
    assert begins.present == pytest.approx(ends.present)


def test_a_sign_is_no_matter_and_a_second_size_is_a_change():
    assert of([-1.0] * 5).kind == of([1.0] * 5).kind == ALWAYS
    assert of([1.0, 1.0, 1.0, 2.0, 2.0]).kind == CHANGES


@pytest.mark.parametrize("days", [1, 2, 10, 100])
def test_nothing_is_absent_however_often_it_is_measured(days):
    """Small errors of the model are on every day the same, and no effect."""
    for seed in range(20):
        found = of(np.full(days, LITTLE), seed)
        assert found.present < CRITERION.confidence


def test_vague_sizes_keep_what_was_believed_before():
    vague = course(np.array([0.3, 0.2]), np.full(2, 1e6), 1.0, LITTLE, 0.5)
    assert vague.present == pytest.approx(0.5, abs=0.01)


def test_the_spread_of_true_sizes_is_found_and_does_not_depend_on_order():
    rng = np.random.default_rng(1)
    groups = np.repeat(np.arange(40), 5)
    v = rng.uniform(0.01, 0.05, 200) ** 2
    true = 3.0 * groups + 0.1 * rng.standard_normal(200)
    y = true + np.sqrt(v) * rng.standard_normal(200)
    assert pooling.between(y, v, groups) == pytest.approx(0.01, rel=0.3)
    assert pooling.between(3.0 * groups + np.sqrt(v) * rng.standard_normal(200), v, groups) < 2e-4
    order = rng.permutation(200)
    again = pooling.between(y[order], v[order], groups[order])
    assert again == pytest.approx(pooling.between(y, v, groups))


def test_a_mean_is_between_its_members_and_surer_than_each():
    one = pooling.mean(np.array([1.0, 2.0]), np.array([0.01, 0.01]))
    wide = pooling.mean(np.array([1.0, 2.0]), np.array([0.01, 0.01]), 0.5)
    assert one.value == wide.value == pytest.approx(1.5)
    assert one.variance == pytest.approx(0.005) and wide.variance > 0.2
