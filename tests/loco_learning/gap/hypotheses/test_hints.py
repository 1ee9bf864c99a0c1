# SPDX-License-Identifier: Apache-2.0
"""Hints of the data: how fast joints went, and when the residual is large."""

import numpy as np
import pytest

from loco_learning.gap.hypotheses import hints

DT = 0.01


def test_a_step_of_an_encoder_is_no_speed():
    """A ramp of 0.5 rad/s is one, in steps of 2 mrad, with readings that are missing."""
    t = DT * np.arange(300)
    q = np.stack([0.002 * np.round(0.5 * t / 0.002), np.full(300, np.nan), 0.0 * t], axis=1)
    q[40:60, 0] = np.nan
    q[7, 2] += 0.002  # a reading that flickers
    found = hints.fastest(q, DT)
    assert found[0] == pytest.approx(0.5, rel=0.1)
    assert np.isnan(found[1])
    assert found[2] == pytest.approx(0.04)


@pytest.mark.parametrize("every", [2, 3, 4, 7])
def test_a_slow_log_has_speeds_and_bends_where_it_was_read(every):
    t = DT * np.arange(600)
    q = np.stack([np.sin(3.0 * t), 0.5 * np.cos(5.0 * t)], axis=1)
    slow = np.full(q.shape, np.nan)
    slow[::every] = q[::every]
    assert hints.fastest(slow, DT) == pytest.approx(hints.fastest(q, DT), rel=0.05)
    bends = hints.bend(slow, DT)
    assert np.isfinite(bends[::every]).mean() > 0.9
    known = np.isfinite(bends[:, 0])
    assert np.corrcoef(bends[known, 0], -q[known, 0])[0, 1] > 0.99


def loud(*intervals, count=400, channels=2):
    """A residual of noise that is large between times."""
    rng, t = np.random.default_rng(1), DT * np.arange(count)
    r = rng.normal(size=(count, channels))
    for start, stop in intervals:
        r[(t >= start) & (t < stop)] *= 20.0
    return r


def test_the_time_in_which_a_residual_is_large_is_found():
    start, stop = hints.interval([loud((1.0, 1.6)), loud((1.05, 1.6))], [DT, DT])
    assert start == pytest.approx(1.0, abs=0.1) and stop == pytest.approx(1.6, abs=0.1)


def test_little_that_is_large_elsewhere_does_not_hide_an_interval():
    """A refitted mass takes a part of a push and leaves a little in every fast motion."""
    r = loud((0.5, 1.1))
    for at in (1.8, 2.6, 3.8):
        r += 0.4 * (loud((at, at + 0.1)) - loud())
    start, stop = hints.interval([r], [DT])
    assert start == pytest.approx(0.5, abs=0.1) and stop == pytest.approx(1.1, abs=0.1)


@pytest.mark.parametrize(
    "residuals",
    [
        [loud(), loud()],  # nowhere
        [loud((0.0, 1.0))],  # from the start on: nothing begins there
        [loud((0.4, 3.9))],  # nearly always
        [loud((1.0, 1.5)), loud(), loud()],  # in one record of three
    ],
)
def test_what_is_not_an_interval_is_none(residuals):
    assert hints.interval(residuals, [DT] * len(residuals)) is None


def test_one_channel_alone_must_agree_on_when_it_begins():
    apart = [loud((1.0, 1.5)), loud((2.0, 2.5))]
    assert hints.interval(apart, [DT, DT]) is not None
    assert hints.interval(apart, [DT, DT], sync=True) is None


def test_intervals_that_begin_and_end_together_are_one():
    same, other = (1.0, 1.6), (2.5, 3.0)
    assert hints.distinct([same, (1.05, 1.65), other]) == (same, other)
    assert len(hints.distinct([(float(k), k + 0.5) for k in range(9)])) == hints.MOST_INTERVALS
