# SPDX-License-Identifier: Apache-2.0
"""Jitter of the times of readings is told from noise by the speed."""

import numpy as np
import pytest

from loco_learning.gap.statistics.jitter import jitter


def moved(seed, dt, share):
    """Positions of three joints, (T, 3), read beside even times by a share of the period."""
    rng = np.random.default_rng(seed)
    even = np.arange(round(12.0 / dt)) * dt
    t = even + share * dt * rng.normal(size=len(even))
    tones = [zip(rng.uniform(0.1, 2.5, 4), rng.uniform(0.05, 0.3, 4), strict=True) for _ in "123"]
    q = [sum(a * np.sin(2.0 * np.pi * f * t + a) for f, a in each) for each in tones]
    return np.stack(q, axis=1) + rng.normal(0.0, rng.choice([2e-5, 1e-3]), (len(t), 3))


@pytest.mark.parametrize("dt", [0.002, 0.01, 0.02])
@pytest.mark.parametrize("seed", range(3))
def test_it_is_found_at_any_rate_and_noise(dt, seed):
    assert jitter([(moved(seed, dt, 0.2), dt)]) == pytest.approx(0.2 * dt, rel=0.25)


@pytest.mark.parametrize("dt", [0.002, 0.01, 0.02])
def test_readings_at_even_times_have_none_nor_joints_at_rest(dt):
    assert [jitter([(moved(seed, dt, 0.0), dt)]) for seed in range(5)] == [0.0] * 5
    still = np.random.default_rng(0).normal(0.0, 1e-4, (500, 2))
    assert jitter([(still, dt)]) == 0.0
    assert jitter([(np.full((500, 2), 0.3), dt)]) == 0.0
    assert jitter([(still[:9], dt)]) == 0.0
