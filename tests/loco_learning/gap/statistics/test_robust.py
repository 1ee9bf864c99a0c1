# SPDX-License-Identifier: Apache-2.0
"""Intervals hold the truth although residuals hang together and the robot is not quite its file."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t as student

from loco_learning.gap.statistics import identify, robust

RECORDS, LONG, TRUTH = 4, 300, 0.0


def covered(seed: int, drift: float = 0.0, off: float = 0.0, told: bool = True) -> bool:
    """Whether the interval of a slope holds it.

    Each record pulls at the slope by itself (drift) and a doubt of one deviation times `off`
    does, unseen by the fit; `told` says whether the doubt takes part in the interval.
    """
    rng = np.random.default_rng(seed)
    x = np.sin(np.arange(RECORDS * LONG) * 0.05)[:, None]
    doubts = 0.3 * x + 0.05 * np.cos(np.arange(len(x)) * 0.031)[:, None]
    groups = np.repeat(np.arange(RECORDS), LONG)
    pulls = drift * rng.normal(size=RECORDS)[groups]
    y = pulls * x[:, 0] + rng.normal(size=len(x)) - off * rng.normal() * doubts[:, 0]
    slope = float(x[:, 0] @ y / (x[:, 0] @ x[:, 0]))
    some = doubts if told else doubts[:, :0]
    ones = np.ones(len(x))
    (half,) = robust.half_widths(x, some, slope * x[:, 0] - y, groups, ones)
    return abs(slope - TRUTH) <= half


@pytest.mark.parametrize(("drift", "off"), [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 1.0)])
def test_intervals_hold_the_truth_where_records_differ_and_values_are_off(drift, off):
    assert np.mean([covered(s, drift, off) for s in range(200)]) >= 0.9


def test_values_that_are_off_in_all_records_show_in_no_resampling():
    assert np.mean([covered(s, off=3.0, told=False) for s in range(200)]) < 0.7


def test_what_the_data_do_not_show_has_no_interval():
    rng = np.random.default_rng(0)
    small = np.where(np.arange(100) == 7, identify.DEAD, 0.0)
    columns = np.stack([rng.normal(size=100), np.zeros(100), small, 1.01 * small], axis=1)
    groups = np.repeat(np.arange(4), 25)
    half = robust.half_widths(columns, columns[:, :0], columns[:, 0], groups, np.ones(100))
    assert np.isfinite(half).tolist() == [True, False, False, True]
    one = robust.half_widths(columns, columns[:, :0], columns[:, 0], 0 * groups, np.ones(100))
    assert np.isinf(one).all()


def drawn(count=4):
    """Columns of two parameters and one doubt, residuals, clusters and uneven weights."""
    rng = np.random.default_rng(3)
    groups = np.repeat(np.arange(count), 40)
    columns, doubt = rng.normal(size=(len(groups), 2)), rng.normal(size=(len(groups), 1))
    return columns, doubt, rng.normal(size=len(groups)), groups, rng.uniform(0.2, 3.0, len(groups))


def test_a_row_of_a_weight_is_a_row_times_its_root():
    columns, doubt, r, groups, w = drawn()
    root, ones = np.sqrt(w), np.ones(len(w))
    scaled = root[:, None] * columns, root[:, None] * doubt, root * r
    np.testing.assert_allclose(
        robust.half_widths(columns, doubt, r, groups, w),
        robust.half_widths(*scaled, groups, ones),
    )


def test_rows_of_no_weight_and_rows_not_measured_change_nothing():
    columns, doubt, r, groups, w = drawn()
    found = robust.half_widths(columns, doubt, r, groups, w)
    for weight, value in ((0.0, 7.0), (1.0, np.nan)):
        more = [np.concatenate([x, x[:50]]) for x in (columns, doubt)]
        others = np.concatenate([groups, np.full(50, 9)])  # a cluster of these alone
        beside = robust.half_widths(
            *more, np.append(r, [value] * 50), others, np.append(w, [weight] * 50)
        )
        np.testing.assert_allclose(beside, found)


@pytest.mark.parametrize("count", [2, 3, 8])
def test_of_equal_records_it_is_the_interval_of_a_mean_of_what_each_says(count):
    """By Student's law of as many; noise adds its own variance."""
    said = np.random.default_rng(count).normal(size=count)
    x, groups = np.full((count * 25, 1), 2.0), np.repeat(np.arange(count), 25)
    r = (2.0 * (said.mean() - said))[groups]  # predicted minus measured, at the joint fit
    (half,) = robust.half_widths(x, x[:, :0], r, groups, np.ones(len(r)))
    mean, noise = said.var(ddof=1) / count, 1.0 / float(np.vdot(x, x))
    assert half == pytest.approx(student.ppf(0.975, count - 1) * np.sqrt(mean + noise))


@pytest.mark.parametrize("share", [0.0, 0.5, -3.0])
def test_a_doubt_that_acts_as_a_share_of_a_parameter_adds_that_share_of_its_deviation(share):
    x, groups = np.full((80, 1), 0.5), np.repeat(np.arange(4), 20)
    (half,) = robust.half_widths(x, share * x, np.zeros(80), groups, np.ones(80))
    assert half == pytest.approx(student.ppf(0.975, 3) * np.sqrt(1.0 / 20.0 + share**2))


def test_doubts_that_are_where_data_and_priors_want_them_do_not_widen_an_interval():
    columns, doubt, r, groups, _ = drawn()
    r -= columns @ np.linalg.lstsq(columns, r, rcond=None)[0]
    best, ones = -doubt.T @ r, np.ones(len(r))
    at = [robust.half_widths(columns, doubt, r, groups, ones, best + d) for d in (-1.0, 0.0, 1.0)]
    assert (at[1] < at[0]).all() and (at[1] < at[2]).all()
    np.testing.assert_allclose(at[0], at[2])
    nowhere = robust.half_widths(columns, doubt, r, groups, ones, np.zeros(1))
    np.testing.assert_array_equal(nowhere, robust.half_widths(columns, doubt, r, groups, ones))


def test_what_was_not_measured_is_no_cluster_and_a_piece_that_begins_after_it_none():
    r = np.where(np.arange(8)[:, None] < 6, 1.0, np.nan)
    whole = robust.clusters([r, r], [[3], [3]])
    for later in (6, 7):
        np.testing.assert_array_equal(robust.clusters([r, r], [[3, later], [3]]), whole)
    beside = robust.clusters([np.full((5, 1), np.nan), r, r], [[2], [3], [3]])
    assert beside.tolist() == [-1] * 5 + whole.tolist() and whole[6:8].tolist() == [-1, -1]


def test_each_record_pulls_once_and_few_are_divided_until_students_law_says_something():
    two = [np.zeros((4, 2)), np.zeros((2, 2))]
    assert robust.clusters(two, [[], []]).tolist() == [0] * 4 + [1] * 4 + [2] * 2 + [3] * 2
    for records, clusters in {1: 4, 2: 4, 3: 6, 4: 4, 5: 5}.items():
        found = robust.clusters([np.zeros((8, 1))] * records, [[]] * records)
        assert len(np.unique(found)) == clusters


def test_pieces_that_begin_anew_pull_by_themselves():
    records = [np.zeros((7, 2)), np.zeros((5, 1))]
    found = robust.clusters(records, [[2, 4], []])
    assert found.tolist() == [0] * 4 + [1] * 4 + [2] * 6 + [3] * 5
    assert robust.clusters(records[:1], [[3]])[::2].tolist() == [0, 0, 1, 2, 2, 3, 3]
