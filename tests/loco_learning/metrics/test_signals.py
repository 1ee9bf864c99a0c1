# SPDX-License-Identifier: Apache-2.0
"""Laws of the metrics on signals whose answer is known."""

import numpy as np
import pytest

from loco_learning.metrics import signals

DT = 0.004
T = np.arange(0, 20.0, DT)


def rhythm(frequency=1.7, lag=0.0, amplitude=1.0):
    """Eight channels with a second harmonic, `lag` strides late."""
    angle = 2.0 * np.pi * (frequency * T[:, None] - lag)
    offset = np.arange(8)
    return amplitude * (np.sin(angle + offset) + 0.3 * np.sin(2.0 * angle + offset))


def test_power_counts_negative_work_or_loses_it():
    dq, tau = np.array([[1.0, -1.0], [2.0, 1.0]]), np.array([[3.0, 1.0], [1.0, -5.0]])
    assert signals.mechanical_power(dq, tau) == pytest.approx((3 - 1 + 2 - 5) / 2)
    assert signals.positive_power(dq, tau) == pytest.approx((3 + 2) / 2)


def test_a_passive_joint_takes_no_net_power():
    q = np.sin(2.0 * np.pi * T)[:, None]
    dq = np.gradient(q, DT, axis=0)
    power = signals.mechanical_power(dq, -100.0 * q)
    assert abs(power) < 1e-3 * signals.positive_power(dq, -100.0 * q)


def test_speed_and_cost_of_transport():
    speed = signals.mean_speed(0.25 * T, DT)
    assert speed == pytest.approx(0.25)
    cost = signals.cost_of_transport(60.0, speed, 80.0)
    assert cost == pytest.approx(60.0 / (80.0 * 9.81 * 0.25))
    assert signals.cost_of_transport(60.0, -speed, 80.0) == pytest.approx(cost)
    assert signals.cost_of_transport(60.0, 0.0, 80.0) == np.inf


def test_saturated_score_is_proportional_to_speed_at_low_power_and_falls_with_power():
    scores = [signals.saturated_score(p, 0.25, 80.0, 100.0) for p in (0.0, 1e-3, 50.0, 500.0)]
    assert scores[0] == pytest.approx(scores[1])
    assert scores[1] > scores[2] > scores[3] > 0.0
    assert signals.saturated_score(1e6, 0.25, 80.0, 1.0) == pytest.approx(0.25 / 80.0 * 1e-6)


def test_peak_force_takes_the_normal_component_of_any_foot():
    grf = np.zeros((5, 4, 3))
    grf[2, 1] = [900.0, 0.0, 400.0]
    grf[4, 3, 2] = -500.0
    assert signals.peak_force(grf) == 500.0


def test_prediction_errors_of_a_constant_offset():
    target = rhythm()
    actual = target + 0.1
    assert signals.mse(target, actual) == pytest.approx(0.01)
    assert signals.mae(target, actual) == pytest.approx(0.1)
    width = np.mean(np.ptp(target, axis=0))
    assert signals.nrmse(target, actual) == pytest.approx(0.1 / width)
    assert signals.accuracy(target, actual) == pytest.approx(width / 0.1)


def test_nrmse_does_not_depend_on_the_unit_but_the_global_one_on_the_widest_channel():
    target, actual = rhythm(), rhythm(lag=0.05)
    value = signals.nrmse(target, actual)
    assert signals.nrmse(1000.0 * target, 1000.0 * actual) == pytest.approx(value)
    wide, wider = target.copy(), actual.copy()
    wide[:, 0] *= 100.0
    wider[:, 0] *= 100.0
    both = signals.nrmse_global(wide, wider)
    assert both == pytest.approx(signals.nrmse_global(1000.0 * wide, 1000.0 * wider))
    assert both < signals.nrmse_global(target, actual)


def test_a_lagging_sine_has_the_nrmse_that_the_criterion_says():
    target = np.sin(2.0 * np.pi * 1.7 * T)[:, None]
    for degrees in (10.0, 50.0, 90.0):
        actual = np.sin(2.0 * np.pi * 1.7 * T - np.radians(degrees))[:, None]
        expected = np.sin(np.radians(degrees) / 2.0) / np.sqrt(2.0)
        assert signals.nrmse(target, actual) == pytest.approx(expected, rel=0.01)


def test_smoothed_nrmse_of_a_steady_error_is_steady_and_equals_the_nrmse():
    target = rhythm()
    smooth = signals.smoothed_nrmse(target, target + 0.2, 147)
    assert smooth.shape == (len(T),)
    np.testing.assert_allclose(smooth, signals.nrmse(target, target + 0.2), rtol=1e-9)


def test_moving_mean_averages_the_last_samples_only():
    x = np.random.default_rng(0).normal(size=(50, 3))
    mean = signals.moving_mean(x, 7)
    for k in range(50):
        np.testing.assert_allclose(mean[k], x[max(0, k - 6) : k + 1].mean(axis=0), atol=1e-12)


def test_fmse_forgives_a_shift_but_not_a_change_of_amplitude():
    whole = T < 10.0  # 17 strides
    target, late, small = rhythm()[whole], rhythm(lag=0.3)[whole], rhythm(amplitude=0.5)[whole]
    assert signals.fmse(target, late) < 1e-6 * signals.fmse(target, small)
    assert signals.mse(target, late) > 1.0


def test_mawe_forgives_shifts_up_to_its_window():
    target, late = rhythm(), rhythm(lag=8 * DT * 1.7)
    assert signals.mawe(target, late, 8) < 1e-9
    assert signals.mawe(late, target, 8) < 1e-9
    assert signals.mawe(target, late, 4) > 0.1
    assert signals.mawe(target, late, 0) == pytest.approx(signals.mae(target, late))


@pytest.mark.parametrize("frequency", [0.61, 1.0, 1.6934, 1.7, 2.33])
def test_stride_frequency_is_finer_than_the_bins(frequency):
    x = rhythm(frequency) + 3.0
    assert signals.stride_frequency(x, DT) == pytest.approx(frequency, abs=0.004)


def test_stride_frequency_of_silence_and_of_a_blink_is_not_a_number():
    assert np.isnan(signals.stride_frequency(np.ones((5000, 2)), DT))
    assert np.isnan(signals.stride_frequency(np.ones((100, 2)), DT))


@pytest.mark.parametrize("lag", [0.0, 0.1, -0.2])
def test_phase_lag_is_positive_when_behind(lag):
    found = signals.phase_lag(rhythm(), rhythm(lag=lag), 1.7 * T % 1.0, 147)
    np.testing.assert_allclose(found[300:], lag, atol=0.02)


def test_phase_lag_counts_the_strides_that_a_slow_rhythm_loses():
    found = signals.phase_lag(rhythm(), rhythm(frequency=1.6), 1.7 * T % 1.0, 147)
    assert found[-1] - found[147] == pytest.approx(0.1 * (20.0 - 147 * DT), abs=0.05)
    slope = np.polyfit(T[147:], found[147:], 1)[0]
    assert slope == pytest.approx(1.7 - 1.6, abs=0.003)


def test_stride_amplitude_sees_a_freeze():
    x = rhythm() * np.where(T < 10.0, 1.0, 0.05)[:, None]
    amplitude = signals.stride_amplitude(x, 294)
    assert np.isnan(amplitude[:293]).all()
    whole = amplitude[2000]
    assert amplitude[-1] == pytest.approx(0.05 * whole, rel=0.01)
    assert np.isnan(signals.stride_amplitude(x[:100], 294)).all()


def test_limit_cycle_of_the_target_is_a_closed_loop_and_a_small_one_stays_inside():
    target = np.concatenate([rhythm(), rhythm(lag=0.25)], axis=1)
    loop, same = signals.limit_cycle(target, target)
    np.testing.assert_array_equal(loop, same)
    np.testing.assert_allclose(loop[0], loop[2500], atol=1e-9)  # 17 strides later
    radius = np.linalg.norm(loop, axis=1)
    assert radius.min() > 0.5 * radius.max()
    middle = target.mean(axis=0)
    _, half = signals.limit_cycle(target, middle + 0.5 * (target - middle))
    np.testing.assert_allclose(half, 0.5 * loop, atol=1e-9)


def test_limit_cycle_does_not_depend_on_units():
    target = rhythm() + 1.0
    loop, _ = signals.limit_cycle(target, target)
    scaled, _ = signals.limit_cycle(target * 7.0 - 2.0, target)
    np.testing.assert_allclose(np.abs(loop), np.abs(scaled), atol=1e-9)


def test_snr_of_noise_about_a_mean():
    x = np.random.default_rng(0).normal(5.0, 1.0, (10000, 3))
    assert signals.snr(x) == pytest.approx(5.0, rel=0.05)


def test_angles_of_a_full_turn_are_unwrapped():
    yaw = np.linspace(0.0, 4.0 * np.pi, 500)
    zero = np.zeros_like(yaw)
    quaternions = np.stack([zero, zero, np.sin(yaw / 2.0), np.cos(yaw / 2.0)], axis=1)
    angles = signals.roll_pitch_yaw(quaternions)
    np.testing.assert_allclose(angles[:, 2], yaw, atol=1e-9)
    np.testing.assert_allclose(angles[:, :2], 0.0, atol=1e-9)


@pytest.mark.parametrize(("axis", "column"), [(0, 0), (1, 1), (2, 2)])
def test_each_angle_turns_about_its_axis(axis, column):
    quaternion = np.zeros((1, 4))
    quaternion[0, axis], quaternion[0, 3] = np.sin(0.15), np.cos(0.15)
    expected = np.zeros((1, 3))
    expected[0, column] = 0.3
    np.testing.assert_allclose(signals.roll_pitch_yaw(quaternion), expected, atol=1e-12)
