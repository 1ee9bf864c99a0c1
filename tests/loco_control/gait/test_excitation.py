# SPDX-License-Identifier: Apache-2.0
"""Motions that excite a robot: derivatives, bounds, levels, what the oscillators make of them."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.gait import excitation
from loco_control.gait.oscillators import Cpg, CpgParams

PHASE = np.array([0.0, 0.3, -0.2])
MOTIONS = {
    "chirp": lambda t: excitation.chirp(t, PHASE, 0.3, 6.0, 4.0),
    "triangle": lambda t: excitation.triangle(t, PHASE, 0.4),
    "steps": lambda t: excitation.steps(t, np.abs(PHASE), 0.5, (1.0, -0.5, 0.2), 0.4),
}


def sampled(motion, dt=1e-3, seconds=20.0):
    t = np.arange(round(seconds / dt)) * dt
    x, dx = zip(*(motion(time) for time in t), strict=True)
    return t, np.array(x), np.array(dx)


@pytest.mark.parametrize("kind", excitation.WAVEFORMS)
def test_values_stay_between_one_and_minus_one_and_use_the_room(kind):
    _, x, _ = sampled(MOTIONS[kind])
    assert np.abs(x).max() <= 1.0 + 1e-9
    assert np.abs(x).max(axis=0) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("kind", excitation.WAVEFORMS)
def test_the_derivative_integrates_to_the_values(kind):
    t, x, dx = sampled(MOTIONS[kind], dt=2e-4, seconds=9.0)
    summed = np.concatenate(
        [x[:1], x[0] + np.cumsum(0.5 * (dx[1:] + dx[:-1]) * np.diff(t)[:, None], axis=0)]
    )
    np.testing.assert_allclose(summed, x, atol=2e-3)


def test_a_chirp_sweeps_up_and_back_without_a_jump():
    turns = np.array([excitation.swept(t, 0.5, 8.0, 3.0) for t in np.arange(0.0, 12.0, 1e-3)])
    assert turns[:, 1].min() == pytest.approx(0.5, rel=0.01)
    assert turns[:, 1].max() == pytest.approx(8.0, rel=0.01)
    np.testing.assert_allclose(np.gradient(turns[:, 0], 1e-3)[1:-1], turns[1:-1, 1], rtol=0.01)


def test_a_chirp_between_equal_frequencies_is_a_sine():
    for t in (0.1, 2.0, 7.3):
        x, dx = excitation.chirp(t, np.zeros(1), 1.5, 1.5, 2.0)
        assert x[0] == pytest.approx(np.sin(2 * np.pi * 1.5 * t), abs=1e-9)
        assert dx[0] == pytest.approx(3 * np.pi * np.cos(2 * np.pi * 1.5 * t), abs=1e-6)


def test_steps_hold_each_level_and_move_smoothly_between():
    levels = (1.0, -0.5, 0.2)
    for index, level in enumerate(levels * 2):
        x, dx = excitation.steps(2.0 * index + 1.9, np.zeros(1), 0.5, levels, 0.4)
        assert (x[0], dx[0]) == (pytest.approx(level), 0.0)


def test_steps_without_rise_jump():
    x, dx = excitation.steps(2.0, np.zeros(1), 0.5, (1.0, -0.5), 0.0)
    assert (x[0], dx[0]) == (-0.5, 0.0)


def test_a_rise_longer_than_the_level_still_meets_it():
    before, _ = excitation.steps(1.999, np.zeros(1), 0.5, (1.0, -1.0), 50.0)
    after, _ = excitation.steps(2.001, np.zeros(1), 0.5, (1.0, -1.0), 50.0)
    assert after[0] == pytest.approx(before[0], abs=0.01)


@pytest.mark.parametrize("kind", excitation.WAVEFORMS)
def test_oscillators_of_these_kinds_swing_about_the_offset(kind):
    params = CpgParams(
        kind=kind, amplitude=(0.3, 0.1), offset=(0.5, -0.5), ramp=0.0, start_time=0.5,
        frequency=0.5, levels=(1.0, -1.0), rise=0.1, end_frequency=4.0, sweep=3.0,
    )  # fmt: skip
    cpg = Cpg(params, 2, 0.01)
    q = np.array([cpg.step(0.01 * k)[0] for k in range(1000)])
    np.testing.assert_array_equal(q[:50], np.tile([0.5, -0.5], (50, 1)))
    assert np.abs(q - [0.5, -0.5]).max(axis=0) == pytest.approx([0.3, 0.1], rel=0.02)


def test_a_bias_grows_with_the_movement_and_stays():
    cpg = Cpg(
        CpgParams(kind="sine", amplitude=(0.0,), bias=(0.4,), offset=(0.1,), ramp=1.0), 1, 0.01
    )
    q, dq = (np.array(x)[:, 0] for x in zip(*(cpg.step(0.01 * k) for k in range(200)), strict=True))
    assert (q[0], q[-1], dq[-1]) == (0.1, pytest.approx(0.5), 0.0)
    np.testing.assert_allclose(np.gradient(q, 0.01)[1:-1], dq[1:-1], atol=0.01)
