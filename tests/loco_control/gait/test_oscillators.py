# SPDX-License-Identifier: Apache-2.0
"""Oscillators: locked phases, duty factor, period, smooth output, the author's slip."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.gait import oscillator_kernels as kernels
from loco_control.gait.oscillators import EQUATIONS, PATTERNS, Cpg, CpgParams, pattern

DT = 0.01
OSCILLATORS = ("amplitude_phase", "righetti")
GAIT = {
    "amplitude": (0.6, 0.6, 0.4, 0.4),
    "offset": (0.3, 0.3, -0.1, -0.1),
    "duty_factor": (0.8, 0.8, 0.45, 0.45),
    "ramp": 0.0,
}


def run(cpg, seconds, start=0.0):
    """Angles and speeds over time, (T, m) each."""
    ticks = np.arange(round(seconds / cpg.dt))
    q, dq = zip(*(cpg.step(start + k * cpg.dt) for k in ticks), strict=True)
    return np.array(q), np.array(dq)


def lead(phase):
    """Phase of each joint ahead of the first [strides], in [-0.5, 0.5)."""
    return (phase - phase[0] + 0.5) % 1.0 - 0.5


def apart(one, two):
    """Distance of phases on the circle [strides]."""
    return np.abs((one - two + 0.5) % 1.0 - 0.5)


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("kind", OSCILLATORS)
def test_phases_lock_to_the_pattern_from_any_start(kind, name):
    params = CpgParams(kind=kind, phase=pattern(name), **GAIT)
    cpg = Cpg(params, 4, DT)
    rng = np.random.default_rng(1)
    for _ in range(10):
        cpg.reset(rng.uniform(0.0, 2.0 * np.pi, 4), rng.uniform(0.05, 2.0, 4))
        run(cpg, 5.0)
        assert apart(cpg.phase - cpg.phase[0], np.array(pattern(name))).max() < 0.01


@pytest.mark.parametrize("kind", OSCILLATORS)
def test_any_number_of_joints_locks_to_any_phases(kind):
    rng = np.random.default_rng(2)
    for count in (1, 2, 8):
        wanted = rng.uniform(0.0, 1.0, count)
        cpg = Cpg(CpgParams(kind=kind, phase=wanted), count, DT)
        cpg.reset(cpg._offsets + rng.uniform(-1.5, 1.5, count))
        run(cpg, 6.0)
        assert apart(lead(cpg.phase), lead(wanted)).max() < 0.01


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("kind", OSCILLATORS)
def test_period_duty_factor_and_amplitude_are_as_asked(kind, name):
    cpg = Cpg(CpgParams(kind=kind, phase=pattern(name), **GAIT), 4, 1e-3)
    run(cpg, 2.0)
    q, dq = run(cpg, 4.0, start=2.0)
    np.testing.assert_allclose(q[1000:], q[:-1000], atol=0.02)  # 1 Hz
    np.testing.assert_allclose(np.mean(dq < 0.0, axis=0), GAIT["duty_factor"], atol=0.01)
    middle, half = (q.max(0) + q.min(0)) / 2.0, (q.max(0) - q.min(0)) / 2.0
    np.testing.assert_allclose(middle, GAIT["offset"], atol=0.01)
    np.testing.assert_allclose(half, GAIT["amplitude"], atol=0.01)


def test_the_walk_moves_diagonal_legs_together_and_the_bound_pairs():
    for name, together in (("walk", ((0, 3), (1, 2))), ("bound", ((0, 1), (2, 3)))):
        q, _ = run(Cpg(CpgParams(phase=pattern(name), ramp=0.0), 4, DT), 3.0)
        for one, two in together:
            np.testing.assert_allclose(q[:, one], q[:, two], atol=1e-9)
        np.testing.assert_allclose(q[:, together[0][0]], -q[:, together[1][0]], atol=1e-9)


@pytest.mark.parametrize("kind", (*OSCILLATORS, "sine", "chirp"))
def test_speed_is_the_derivative_of_the_angle(kind):
    cpg = Cpg(CpgParams(kind=kind, phase=(0.0, 0.1, 0.6, 0.3), start_time=0.2), 4, 1e-3)
    if kind in OSCILLATORS:
        cpg.reset(np.array([3.0, 0.1, 5.0, 1.0]), np.array([0.3, 1.5, 1.0, 0.8]))
    q, dq = run(cpg, 3.0)
    np.testing.assert_allclose(np.gradient(q, 1e-3, axis=0)[1:-1], dq[1:-1], atol=0.02)
    assert np.abs(np.diff(q, axis=0)).max() < 0.01  # no jump, also at the start
    np.testing.assert_array_equal(q[:200], 0.0)


@pytest.mark.parametrize("kind", OSCILLATORS)
def test_the_control_rate_does_not_change_the_motion(kind):
    slow = Cpg(CpgParams(kind=kind, phase=pattern("walk"), **GAIT), 4, 0.02)
    fast = Cpg(CpgParams(kind=kind, phase=pattern("walk"), **GAIT), 4, 0.005)
    start = np.array([0.0, 2.0, 1.0, 4.0])
    slow.reset(start)
    fast.reset(start)
    np.testing.assert_allclose(run(slow, 4.0)[0], run(fast, 4.0)[0][::4], atol=0.01)


def test_a_sine_is_the_law_of_its_parameters():
    params = CpgParams(kind="sine", frequency=0.3, amplitude=(0.8,), offset=(0.35,), ramp=0.0)
    q, _ = run(Cpg(params.replace(phase=(0.25,)), 2, DT), 5.0)
    t = np.arange(500) * DT
    np.testing.assert_allclose(q[:, 1], 0.35 + 0.8 * np.cos(2.0 * np.pi * 0.3 * t), atol=1e-12)


@pytest.mark.parametrize("kind", EQUATIONS)
def test_reset_starts_the_same_motion_again(kind):
    cpg = Cpg(CpgParams(kind=kind, phase=(0.0, 0.3)), 2, DT)
    first = run(cpg, 2.0)
    cpg.reset()
    np.testing.assert_array_equal(first, run(cpg, 2.0))


def test_warp_and_unwarp_are_inverse_and_keep_whole_turns():
    for duty in (0.1, 0.5, 0.85):
        for phase in np.linspace(-20.0, 20.0, 101):
            assert kernels.unwarp(kernels.warp(phase, duty), duty) == pytest.approx(phase)
        assert kernels.warp(4.0 * np.pi, duty) == pytest.approx(4.0 * np.pi)
        assert kernels.warp(2.0 * np.pi * duty, duty) == pytest.approx(np.pi)


@pytest.mark.parametrize(
    ("offsets", "locked"),
    [
        ((4.0352, 0.34754, 3.27335), (0.0, 0.536, 0.081, 0.599)),  # walking_gait
        ((4.30808, 1.7454, 2.84278), (0.0, 0.851, 0.300, 0.189)),  # bounding_gait
    ],
)
def test_the_authors_matrix_locks_elsewhere_and_ours_where_it_should(offsets, locked):
    """psi_0k = off_k but psi_jk = off_j - off_k; facts 4.7 lists where that ends."""
    nominal = np.array([0.0, *offsets])
    his = nominal[:, None] - nominal[None, :]
    his[0], his[:, 0] = nominal, -nominal
    heard = np.full((4, 4), 5.0)
    heard[3] = 0.0  # his last leg hears nobody
    state = np.stack([np.ones(4), np.zeros(4)], axis=1)
    shape, duty = np.array([1.0, 50.0, 50.0]), np.full(4, 0.5)
    kernels.advance(0, state, duty, heard, his, shape, 20.0, 5000)
    turns = (state[:, 1] - state[0, 1]) / (2.0 * np.pi)
    assert apart(turns, np.array(locked)).max() < 0.003
    assert apart(turns, nominal / (2.0 * np.pi)).max() > 0.05
    cpg = Cpg(CpgParams(phase=nominal / (2.0 * np.pi)), 4, DT)
    cpg.reset(np.zeros(4))
    run(cpg, 10.0)
    assert apart(lead(cpg.phase), nominal / (2.0 * np.pi)).max() < 1e-3


def test_mistakes_get_one_clear_message():
    with pytest.raises(
        ParameterError, match="amplitude must have 1 value or one for each of the 4"
    ):
        Cpg(CpgParams(amplitude=(0.1, 0.2)), 4, DT)
    with pytest.raises(ParameterError, match="list of one or more numbers"):
        CpgParams(phase=())
    with pytest.raises(ParameterError, match=r"duty_factor\[1\] must be in \[0.02, 0.98\]"):
        CpgParams(duty_factor=(0.5, 1.0))
    with pytest.raises(NameUnknownError, match="did you mean 'righetti'"):
        CpgParams(kind="rigetti")
    with pytest.raises(NameUnknownError, match="available: bound, walk"):
        pattern("trot")
