# SPDX-License-Identifier: Apache-2.0
"""Counts of a ripple are found in a residual over the angle, and none where there is none."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap.hypotheses.hints import MOST_RIPPLES, ripples

T = np.arange(4000) / 500.0


def turned(rng, travel=1.0):
    """Angle of a joint that is driven by a few sines [rad], (T,)."""
    return travel * sum(np.sin(2 * np.pi * f * T + rng.uniform(0, 6)) for f in (0.3, 0.7, 1.1))


@pytest.mark.parametrize("count", [7.0, 16.3, 48.0])
def test_a_ripple_is_found_at_its_count(count):
    rng = np.random.default_rng(int(count))
    angles = [turned(rng), turned(rng)]
    residuals = [(0.7 * np.cos(count * q + 0.4) + rng.normal(size=len(q)))[:, None] for q in angles]
    found = ripples(angles, residuals)
    assert 1 <= len(found) <= MOST_RIPPLES
    assert found[0] == pytest.approx(count, abs=0.3)


def test_a_ripple_is_found_in_the_channel_that_shows_it():
    """A controller answers a ripple by a torque that lags by a speed-dependent phase."""
    rng = np.random.default_rng(2)
    q = turned(rng)
    answer = 100.0 * rng.normal(size=len(q))
    moved = 0.7 * np.cos(16.3 * q) + rng.normal(size=len(q))
    assert ripples([q], [np.column_stack([answer, moved])])[0] == pytest.approx(16.3, abs=0.3)


@pytest.mark.parametrize("seed", range(4))
def test_noise_has_no_count(seed):
    rng = np.random.default_rng(seed)
    q = turned(rng)
    assert ripples([q], [rng.normal(size=(len(q), 2))]) == ()


@pytest.mark.parametrize("angle", [np.full(400, np.nan), np.zeros(400)])
def test_a_joint_that_is_not_known_or_stands_still_has_none(angle):
    assert ripples([angle], [np.ones((400, 1))]) == ()
