# SPDX-License-Identifier: Apache-2.0
"""Intervals hold the truth although residuals hang together and the robot is not quite its file."""

from __future__ import annotations

import numpy as np
import pytest

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
