# SPDX-License-Identifier: Apache-2.0
"""Laws of the windowed error in both variants."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_learning.calibration import mawe

PERIOD = 3.0
POINTS = 150
BOTH = pytest.mark.parametrize("name", mawe.LOSSES)


def smooth(seed, channels=4):
    """A random periodic signal, (POINTS, channels)."""
    rng = np.random.default_rng(seed)
    phase = 2.0 * np.pi * np.arange(POINTS)[:, None] / POINTS
    return sum(
        rng.normal(size=channels) * np.sin(k * phase + rng.uniform(0, 6, channels))
        for k in (1, 2, 3)
    )


@BOTH
def test_equal_signals_have_no_error_and_no_shift(name):
    x = smooth(0)
    assert mawe.loss(name)(x, x, PERIOD) == (0.0, 0.0)


@BOTH
@pytest.mark.parametrize("shift", [-25, -7, 3, 25])
def test_a_common_shift_within_the_window_costs_nothing_and_is_reported(name, shift):
    x = smooth(1)
    error, lag = mawe.loss(name)(np.roll(x, shift, axis=0), x, PERIOD)
    assert error == pytest.approx(0.0, abs=1e-12)
    assert lag == pytest.approx(shift * PERIOD / POINTS)


@BOTH
def test_a_shift_beyond_the_window_costs(name):
    x = smooth(2)
    assert mawe.loss(name)(np.roll(x, 40, axis=0), x, PERIOD)[0] > 0.01


@BOTH
def test_shifts_that_differ_between_channels_cost(name):
    x = smooth(3)
    y = x.copy()
    y[:, 0] = np.roll(y[:, 0], 10)
    assert mawe.loss(name)(x, y, PERIOD)[0] > 0.001


def test_the_error_of_the_thesis_is_symmetric_and_the_lag_turns_round():
    x, y = smooth(4), smooth(5)
    there, back = mawe.thesis(x, y, PERIOD), mawe.thesis(y, x, PERIOD)
    assert there[0] == pytest.approx(back[0])
    assert there[1] == pytest.approx(-back[1])


def test_the_error_of_the_thesis_scales_with_the_signals_and_the_authors_does_not():
    x, y = smooth(6), smooth(7)
    assert mawe.thesis(3.0 * x, 3.0 * y, PERIOD)[0] == pytest.approx(
        3.0 * mawe.thesis(x, y, PERIOD)[0]
    )
    scale, offset = np.array([3.0, 0.5, 10.0, 1.0]), np.array([1.0, -2.0, 0.0, 5.0])
    assert mawe.author(scale * x + offset, scale * y + offset, PERIOD)[0] == pytest.approx(
        mawe.author(x, y, PERIOD)[0]
    )


@BOTH
def test_a_window_of_nothing_is_the_plain_mean_absolute_error(name):
    x, y = smooth(8), smooth(9)
    plain = np.mean(np.abs(x - y), axis=0)  # (J,)
    scaled = {"thesis": plain.sum(), "author": np.mean(plain / np.ptp(x, axis=0)) * PERIOD}
    assert mawe.loss(name)(x, y, PERIOD, 0.0) == (pytest.approx(scaled[name]), 0.0)


@BOTH
def test_a_wider_window_never_costs_more(name):
    x, y = smooth(10), smooth(11)
    errors = [mawe.loss(name)(x, y, PERIOD, w)[0] for w in (0.0, 0.1, 0.5, 1.5, 9.0)]
    assert errors == sorted(errors, reverse=True)


@BOTH
def test_a_short_period_is_searched_once_round(name):
    x = smooth(12)
    assert mawe.loss(name)(np.roll(x, 75, axis=0), x, 0.5)[0] == pytest.approx(0.0, abs=1e-12)


@BOTH
def test_periods_that_do_not_compare_are_refused(name):
    x = smooth(13)
    with pytest.raises(ParameterError, match="do not compare"):
        mawe.loss(name)(x, x[1:], PERIOD)
    bad = x.copy()
    bad[3, 1] = np.nan
    with pytest.raises(ParameterError, match="not finite"):
        mawe.loss(name)(x, bad, PERIOD)


def test_a_constant_sensor_has_no_range_and_an_unknown_loss_is_named():
    x = smooth(14)
    flat = x.copy()
    flat[:, 2] = 0.7
    with pytest.raises(ParameterError, match="constant"):
        mawe.author(flat, x, PERIOD)
    with pytest.raises(NameUnknownError, match="thesis"):
        mawe.loss("thesi")
