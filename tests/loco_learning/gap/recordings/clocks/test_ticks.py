# SPDX-License-Identifier: Apache-2.0
"""Uneven readings come to even times without a change of their motion or of their noise."""

import numpy as np
import pytest

from loco_learning.gap.importing import align
from loco_learning.gap.recordings.clocks import ticks
from loco_learning.gap.recordings.tracks import Track

RATE, NOISE = 250.0, 1e-4


def motion(t):
    return 0.3 * np.sin(2.0 * np.pi * 3.0 * t) + 0.1 * np.cos(2.0 * np.pi * 5.0 * t)


def uneven(every=1, noise=NOISE, seed=1):
    """Readings of the motion each `every` periods, by a clock that is a tenth of them off."""
    rng = np.random.default_rng(seed)
    even = np.arange(0.0, 4.0, every / RATE)
    t = np.maximum(even + 0.1 * every / RATE * rng.standard_normal(len(even)), 0.0)
    return Track("q", "hinge", t, motion(t) + noise * rng.standard_normal(len(t)), "q")


@pytest.mark.parametrize("every", [1, 2, 4])
def test_a_motion_read_unevenly_is_that_at_the_even_times(every):
    times = np.arange(1000) / RATE
    off = ticks.sample(uneven(every, noise=0.0), times) - motion(times)
    assert np.isfinite(off).sum() > 0.98 * len(times) / every
    assert np.sqrt(np.nanmean(off**2)) < 2e-5 * every**4


@pytest.mark.parametrize("every", [1, 2])
def test_white_noise_stays_white_and_as_large(every):
    times = np.arange(1000) / RATE
    found = ticks.sample(uneven(every), times)[::every] - motion(times)[::every]
    left = found[np.isfinite(found)]
    assert np.std(left) == pytest.approx(NOISE, rel=0.08)
    assert abs(np.corrcoef(left[1:], left[:-1])[0, 1]) < 0.1


def test_readings_on_the_times_and_signals_that_jump_are_not_moved():
    times = np.arange(1000) / RATE
    steps = np.sign(motion(times))
    assert np.array_equal(ticks.sample(Track("q", "hinge", times, steps, "q"), times), steps)
    t = np.clip(times + 3e-4 * np.sin(np.arange(1000)), 0.0, None)
    moved = ticks.sample(Track("tau", "hinge", t, steps, "tau"), times)
    assert np.nanmax(np.abs(moved)) <= 1.0


def test_times_without_a_reading_of_their_own_are_marked_as_lost():
    times, track = np.arange(1000) / RATE, uneven()
    kept = np.random.default_rng(3).random(len(track.t)) > 0.05
    fewer = Track("q", "hinge", track.t[kept], track.x[kept], "q")
    flags = ticks.lost(fewer, times) > 0.0
    off = ticks.sample(fewer, times) - motion(times)
    assert np.sum(~kept) <= flags.sum() < 1.3 * np.sum(~kept) and np.isfinite(off[flags]).any()
    assert np.nanstd(off[~flags]) == pytest.approx(NOISE, rel=0.1)


def test_the_times_of_a_record_are_those_of_even_commands(hinge):
    """A held command acts from its stamp on, however late the first reading is."""
    t = np.arange(1000) / RATE
    track = uneven()
    read = Track("q", "hinge", track.t[1:] + 1e-3, motion(track.t[1:]), "q")
    command = np.random.default_rng(2).standard_normal(len(t))
    made = align.record(
        "run", [read, Track("command_position", "hinge", t, command, "c")], hinge, trust_units=True
    )
    count = len(made.t)
    assert np.array_equal(made.command["position"][:, 0], command[1 : count + 1])
    off = made.signals["q"][:, 0] - motion(made.t + t[1] - 1e-3)
    assert np.nanstd(off) < 1e-4


@pytest.mark.parametrize("jitter", [0.0, 0.05])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.05, 0.2, 0.4])
def test_dropped_readings_leave_the_period_as_it_was(share, jitter):
    rng = np.random.default_rng(7)
    even = (np.arange(4000) + jitter * rng.standard_normal(4000)) / RATE
    stays = rng.random(len(even)) >= share
    assert ticks.period(even[stays]) == pytest.approx(1.0 / RATE, rel=2e-3)


def test_the_period_of_readings_at_any_times_is_their_mean():
    t = np.cumsum(np.random.default_rng(7).uniform(0.2, 1.8, 4000)) / RATE
    assert ticks.period(t) == pytest.approx(float(np.mean(np.diff(t))), rel=1e-9)


@pytest.mark.parametrize("behind", [-0.45, -1e-3, 0.0, 1e-6, 0.02, 0.45])
def test_a_command_acts_from_the_time_closest_to_its_stamp(behind):
    """A clock a hair behind the axis delays no command by a whole step."""
    axis, x = 0.002 * np.arange(500), np.arange(500.0)
    track = Track("command_position", "hinge", axis + 0.002 * behind, x, "made")
    assert np.array_equal(ticks.hold(track, axis), x)
    rng = np.random.default_rng(0)
    slow = axis[::7] + 0.002 * rng.uniform(-0.49, 0.49, len(axis[::7]))  # rare, and uneven
    held = ticks.hold(Track("command_position", "hinge", slow, x[::7], "made"), axis)
    assert np.array_equal(held, 7.0 * np.floor(x / 7.0))
