# SPDX-License-Identifier: Apache-2.0
"""Quantisation steps and saturation of raw signals."""

import numpy as np
import pytest

from loco_learning.gap.recordings import lags, observe
from loco_learning.gap.recordings.tracks import Track

T = np.arange(2000) * 0.005


def track(x, role="dq") -> Track:
    return Track(role, "hinge", T, np.asarray(x), "made")


@pytest.mark.parametrize("step", [0.00506, 0.1, 2 * np.pi / 4096])
@pytest.mark.parametrize("offset", [0.0, 0.037])
def test_the_step_is_found(step, offset):
    x = step * np.round(np.sin(3.0 * T) * np.exp(0.1 * T) / step) + offset
    assert observe.steps([track(x)])["dq", "hinge"] == pytest.approx(step, rel=1e-6)


def test_smooth_signals_have_no_step():
    noise = np.random.default_rng(0).normal(size=len(T))
    for x in (np.sin(T), np.sin(T) + 1e-3 * noise, noise, np.sin(T).round(9)):
        assert observe.steps([track(x)])["dq", "hinge"] == 0.0


def test_what_does_not_move_says_nothing_of_its_step():
    assert observe.steps([track(0.0 * T)]) == {}


def test_cut_off_signals_are_told():
    wave = np.sin(3.0 * T) + 0.01 * np.random.default_rng(0).normal(size=len(T))
    notes = observe.notes([track(wave.clip(-0.8, 2.0), "tau")], 200.0, 4.5)
    assert len(notes) == 1 and "tau of hinge is at its smallest value -0.8 for" in notes[0]
    assert observe.notes([track(wave, "tau")], 200.0, 4.5) == []


@pytest.mark.parametrize("shift", [0.0, 0.0113, 0.05])
def test_lags_are_continuous(shift):
    rng = np.random.default_rng(0)
    pitch, phase = rng.uniform(2.0, 40.0, 20), rng.uniform(0.0, 6.0, 20)

    def wave(t):
        return np.sum(np.sin(np.outer(t, pitch) + phase), axis=1)

    found, alike = lags.lag(wave(T), wave(T - shift), 0.005)
    assert found == pytest.approx(shift, abs=5e-4)
    assert shift == 0.0 or alike > 0.95


def test_strangers_have_no_lag():
    rng = np.random.default_rng(0)
    _, alike = lags.lag(rng.normal(size=2000), rng.normal(size=2000), 0.005)
    assert alike < 0.2
    assert lags.lag(np.zeros(2000), np.ones(2000), 0.005) == (0.0, 0.0)
