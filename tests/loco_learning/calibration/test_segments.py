# SPDX-License-Identifier: Apache-2.0
"""Periods are found where the actuation rises through its middle, and averaged."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.calibration import segments

DT = 0.01


def sine(frequency=0.5, duration=10.0, offset=0.3, phase=0.2):
    t = np.arange(round(duration / DT)) * DT
    return t, offset + 0.8 * np.sin(2.0 * np.pi * (frequency * t + phase))


@pytest.mark.parametrize("frequency", [0.318, 0.5, 1.0])
@pytest.mark.parametrize("phase", [0.0, 0.1, 0.7])
def test_crossings_are_one_period_apart_and_where_the_sine_rises(frequency, phase):
    t, x = sine(frequency, 15.0, phase=phase)
    at = segments.crossings(t, x)
    np.testing.assert_allclose(np.diff(at), 1.0 / frequency, rtol=0.03)
    inside = at[1:-1]  # the filter has no past at the first and no future at the last
    np.testing.assert_allclose(np.diff(inside), 1.0 / frequency, rtol=2e-3)
    np.testing.assert_allclose((frequency * inside + phase + 0.5) % 1.0, 0.5, atol=0.02)


def test_noise_on_the_actuation_does_not_multiply_crossings():
    t, x = sine(0.5, 20.0)
    noisy = x + 0.1 * np.random.default_rng(0).standard_normal(len(x))
    assert len(segments.crossings(t, noisy)) == len(segments.crossings(t, x))


def test_the_average_of_a_periodic_signal_is_its_period():
    t, x = sine(0.5, 12.0)
    signals = np.stack([np.cos(np.pi * t), np.cos(2.0 * np.pi * t)], axis=1)
    at = segments.crossings(t, x)[1:-1]
    made = segments.cut(t, signals, at, points=100)
    when = at[0] + np.arange(100) / 100 * made.period
    expected = np.stack([np.cos(np.pi * when), np.cos(2.0 * np.pi * when)], axis=1)
    np.testing.assert_allclose(made.mean, expected, atol=5e-3)
    assert made.period == pytest.approx(2.0, abs=1e-3)
    assert made.spread.max() < 5e-3


def test_averaging_removes_noise_that_does_not_repeat():
    t, x = sine(1.0, 60.0)
    noise = 0.1 * np.random.default_rng(1).standard_normal((len(t), 1))
    at = segments.crossings(t, x)
    made = segments.cut(t, np.sin(2.0 * np.pi * t)[:, None] + noise, at)
    clean = segments.cut(t, np.sin(2.0 * np.pi * t)[:, None], at)
    assert np.std(made.mean - clean.mean) < 0.1 / np.sqrt(len(at) - 1) * 1.5
    assert made.periods.shape == (len(at) - 1, segments.POINTS, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda x: np.where(np.arange(len(x)) == 7, np.nan, x), "not finite"),
        (lambda x: np.full(len(x), 0.4), "constant"),
        (lambda x: x[:250], "whole periods in 2.5 s, at least 2"),
        (lambda x: x[:10], "too short"),
        (lambda x: x[:0], "no samples are left"),
    ],
)
def test_an_actuation_without_periods_is_refused(change, message):
    t, x = sine()
    x = change(x)
    with pytest.raises(ParameterError, match=message):
        segments.crossings(t[: len(x)], x)


def test_an_actuation_of_changing_rhythm_is_refused():
    t, _ = sine(0.5, 20.0)
    with pytest.raises(ParameterError, match="not periodic"):
        segments.crossings(t, np.sin(0.15 * np.pi * t**1.6))


def test_signals_that_are_not_finite_or_too_short_are_refused():
    t, x = sine()
    at = segments.crossings(t, x)
    bad = x[:, None].copy()
    bad[50] = np.inf
    with pytest.raises(ParameterError, match="not finite"):
        segments.cut(t, bad, at)
    with pytest.raises(ParameterError, match="outside the signal"):
        segments.cut(t[:500], x[:500, None], at)
