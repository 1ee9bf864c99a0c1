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


MIXING = 1.732  # [Hz], no period is a whole number of samples: no rounding repeats


def rounded(hertz: float, ratio: float, step: float, seed: int) -> np.ndarray:
    """Readings of a motion with noise of so many steps, (T,)."""
    noisy = motion(hertz) + ratio * step * np.random.default_rng(seed).normal(size=len(T))
    return step * np.round(noisy / step)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("ratio", [0.1, 0.2, 0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.5, 3.0])
def test_the_floor_of_rounded_readings_is_that_of_noise_and_rounding(ratio, seed):
    """The motion passes several steps between samples: errors of rounding are white."""
    step = 2e-3
    truth = step * np.hypot(ratio, 1.0 / np.sqrt(12.0))
    x = rounded(MIXING, ratio, step, seed)
    assert noise.floor([x[:, None]], step)[0] == pytest.approx(truth, rel=0.06)


@pytest.mark.parametrize("hertz", [0.0, 0.2])
@pytest.mark.parametrize("ratio", [0.5, 0.65, 0.8, 1.0, 3.0])
def test_noise_of_half_a_step_is_its_own_dither_where_a_robot_hardly_moves(ratio, hertz):
    step = 0.05
    truth = step * np.hypot(ratio, 1.0 / np.sqrt(12.0))
    x = rounded(hertz, ratio, step, 2)
    assert noise.floor([x[:, None]], step)[0] == pytest.approx(truth, rel=0.06)


@pytest.mark.parametrize("ratio", [0.4, 0.8, 3.0])
def test_shocks_do_not_raise_the_floor_of_rounded_readings(ratio):
    step = 2e-3
    truth = step * np.hypot(ratio, 1.0 / np.sqrt(12.0))
    x = rounded(MIXING, ratio, step, 5)
    x[::100] += step * np.round(np.random.default_rng(6).normal(size=len(T) // 100) / step)
    assert noise.floor([x[:, None]], step)[0] == pytest.approx(truth, rel=0.35)  # as unrounded


def test_the_floor_of_rounded_readings_does_not_depend_on_the_order_of_records():
    records = [rounded(MIXING, 0.4, 2e-3, seed)[:, None] for seed in range(2)]
    assert noise.floor(records, 2e-3) == noise.floor(records[::-1], 2e-3)


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
