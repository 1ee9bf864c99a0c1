# SPDX-License-Identifier: Apache-2.0
"""The floor is that of the noise, whatever the robot does."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap.statistics import noise

T = np.arange(4000) / 500.0  # [s]


def motion(hertz: float) -> np.ndarray:
    return 0.5 * np.sin(2 * np.pi * hertz * T) + 0.1 * T


@pytest.mark.parametrize("hertz", [0.0, 1.0, 10.0, 40.0])
@pytest.mark.parametrize("deviation", [1e-3, 1e-2])
def test_noise_is_found_under_any_motion(hertz, deviation):
    rng = np.random.default_rng(1)
    x = motion(hertz) + deviation * rng.normal(size=len(T))
    assert noise.floor([x[:, None]])[0] == pytest.approx(deviation, rel=0.15)


def test_shocks_do_not_raise_it():
    rng = np.random.default_rng(2)
    x = motion(1.0) + 1e-3 * rng.normal(size=len(T))
    x[::100] += rng.normal(size=len(T) // 100)
    assert noise.floor([x[:, None]])[0] == pytest.approx(1e-3, rel=0.35)


def test_a_quantised_channel_has_at_least_the_noise_of_its_step():
    step = 0.01
    x = np.round(motion(0.5) / step) * step
    assert noise.floor([x[:, None]], step)[0] >= step / np.sqrt(12)


def test_without_noise_a_share_of_the_motion_remains():
    x = motion(1.0)
    assert noise.floor([x[:, None]])[0] == pytest.approx(noise.RELATIVE * x.std())
    assert noise.floor([np.zeros((50, 1))])[0] > 0.0


def test_a_torque_is_never_known_well():
    x = np.stack([motion(1.0), motion(1.0)], axis=1)
    found = noise.floor([x], signals=["q", "tau"])
    np.testing.assert_allclose(found / x.std(0), [noise.RELATIVE, noise.EFFORT])


def test_a_torque_that_hardly_changes_is_known_no_better_than_those_of_other_joints():
    x = np.stack([motion(1.0), 0.08 + 1e-5 * motion(7.0)], axis=1)
    torques, angles = noise.floor([x], signals=["tau", "tau"]), noise.floor([x])
    assert torques[1] == pytest.approx(noise.BUSIEST_SHARE * x[:, 0].std())
    assert angles[1] == pytest.approx(noise.RELATIVE * x[:, 1].std())


def test_gaps_and_slower_channels_change_nothing():
    rng = np.random.default_rng(3)
    x = motion(2.0) + 1e-3 * rng.normal(size=len(T))
    x[500:900] = np.nan
    rare = np.full_like(x, np.nan)
    rare[::3] = x[::3]
    found = noise.floor([np.stack([x, rare], axis=1)])
    np.testing.assert_allclose(found, 1e-3, rtol=0.15)


def test_records_are_pooled_and_never_joined():
    rng = np.random.default_rng(4)
    x = 1e-3 * rng.normal(size=(2000, 2))
    halves = [x[:1000] + 5.0, x[1000:] - 5.0]
    np.testing.assert_allclose(noise.floor(halves), 1e-3, rtol=0.15)


def test_a_channel_never_measured_gets_a_floor_too():
    assert noise.floor([np.full((100, 1), np.nan)])[0] > 0.0


def test_the_total_adds_powers():
    np.testing.assert_allclose(noise.total(np.array([3.0, 0.0]), 4.0), [5.0, 4.0])
