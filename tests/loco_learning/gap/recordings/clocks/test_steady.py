# SPDX-License-Identifier: Apache-2.0
"""Stamps of arrival go back to the clock of the readings, and to no rounder one than theirs."""

import numpy as np
import pytest

from loco_learning.gap.recordings.clocks import steady
from loco_learning.gap.recordings.tracks import Track


def late(seed=0, period=0.005, size=0.4):
    """Readings of an even clock, and stamps that are late by up to a part of a period."""
    rng = np.random.default_rng(seed)
    even = 3.0 + period * np.arange(1200)
    ways = size * period * rng.exponential(0.3, len(even)).clip(0.0, 0.9)
    return even, even + ways


def test_stamps_of_arrival_are_those_of_readings_again_for_every_signal_with_them():
    even, stamps = late()
    x = np.sin(9.0 * even) + 0.3 * np.sin(31.0 * even)
    tracks = [Track(role, "hinge", stamps, x, "made") for role in ("q", "dq", "command_position")]
    tracks.append(Track("gyro", "x", even, x, "imu"))  # a clock of its own, and right
    told = []
    q, dq, command, gyro = steady.steadied(tracks, told)
    assert np.ptp(q.t - even) < 1e-5 and np.array_equal(q.t, dq.t)
    assert np.array_equal(command.t, q.t) and gyro is tracks[3]
    said, of_command = told
    assert of_command.startswith("command_position: stamps are up to")
    ways = 1e3 * (stamps - even)
    assert said.startswith("q, dq: stamps are up to") and "readings 5 ms apart" in said
    assert f"{ways.max():.2f} ms late" in said


@pytest.mark.parametrize("share", [0.005, 0.02, 0.1])
def test_stamps_of_arrival_are_put_back_beside_readings_that_were_dropped(share):
    """A reading that lacks is counted, so that those behind it are not a period early."""
    even, stamps = late()
    here = np.random.default_rng(1).random(len(even)) >= share
    x = np.sin(9.0 * even) + 0.3 * np.sin(31.0 * even)
    told: list[str] = []
    (q,) = steady.steadied([Track("q", "hinge", stamps[here], x[here], "made")], told)
    assert np.ptp(q.t - even[here]) < 1e-4 * 0.005 and "readings 5 ms apart" in told[0]
    read = np.sin(9.0 * stamps) + 0.3 * np.sin(31.0 * stamps)  # at once, and rightly stamped
    track = Track("q", "hinge", stamps[here], read[here], "made")
    assert steady.steadied([track], []) == [track]


def test_who_reads_unevenly_and_stamps_at_once_is_believed():
    _, stamps = late()
    q = Track("q", "hinge", stamps, np.sin(9.0 * stamps) + 0.3 * np.sin(31.0 * stamps), "made")
    told = []
    assert steady.steadied([q], told) == [q] and told == []


@pytest.mark.parametrize("rows", [slice(0, 39), slice(None, None, -1), slice(0, 0)])
def test_stamps_that_are_few_or_fall_have_no_clock(rows):
    _, stamps = late()
    assert steady.even_clock(stamps[rows]) is None
    assert steady.even_clock(np.full(100, 3.0)) is None


def test_a_drift_of_the_clock_leaves_stamps_as_they_are():
    """Late by more and more: no line has all parts of the record near it."""
    even, _ = late()
    assert steady.even_clock(even + 0.01 * np.sin(even)) is None
    assert steady.even_clock(np.delete(even, slice(500, 520))) is None  # even, though some lack


@pytest.mark.parametrize("role", ["q", "command_position", "gyro"])
@pytest.mark.parametrize("off", [2e-4, -5e-4, 1e-5])
def test_a_clock_a_little_off_a_round_period_is_not_made_round(off, role):
    """At 0.02 % the ends of a record of a minute are 12 ms apart from those of a round clock."""
    even, stamps = late(period=0.005 * (1.0 + off))
    x = np.sin(9.0 * even) + 0.3 * np.sin(31.0 * even)
    (found,) = steady.steadied([Track(role, "hinge", stamps, x, "made")], told := [])
    assert len(told) == 1 and np.ptp(found.t - even) < 0.002 * 0.005
    assert np.mean(np.diff(found.t)) == pytest.approx(0.005 * (1.0 + off), rel=2e-6)


def test_a_clock_that_is_round_within_the_error_of_its_line_is_round():
    even, stamps = late()
    assert np.ptp(steady.even_clock(stamps) - even) < 1e-9


def test_a_command_that_is_given_when_it_is_stamped_stays_beside_readings_that_move():
    even, stamps = late()
    q, command = (np.sin(9.0 * t) + 0.3 * np.sin(31.0 * t) for t in (even, stamps))
    tracks = [Track("q", "hinge", stamps, q, "made"),
              Track("command_position", "hinge", stamps, command, "made")]  # fmt: skip
    first, second = steady.steadied(tracks, [])
    assert np.ptp(first.t - even) < 1e-5 and second is tracks[1]


@pytest.mark.parametrize("step", [1e-4, 1e-3, 0.003, 0.01, 0.05])
def test_a_coarse_encoder_does_not_make_uneven_readings_even(step):
    """Between two of its steps the motion lies as far as its jitter; rounding hides that."""
    _, stamps = late(size=0.2)
    q = np.round((np.sin(3.0 * stamps) + 0.3 * np.sin(11.0 * stamps)) / step) * step
    track = Track("q", "hinge", stamps, q, "made")
    assert steady.steadied([track], []) == [track]
