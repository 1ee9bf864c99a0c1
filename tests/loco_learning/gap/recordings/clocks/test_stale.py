# SPDX-License-Identifier: Apache-2.0
"""Readings that a faster log repeats are kept once; coarse or resting signals are not touched."""

import numpy as np
import pytest

from loco_learning.gap.recordings.clocks import stale
from loco_learning.gap.recordings.tracks import Track


def motion(t):
    return 0.4 * np.sin(3.0 * t) + 0.2 * np.sin(7.1 * t + 1.0)


def tracks(rows, step=0.0, joints=("hip", "knee")):
    """Positions and velocities in rows of 500 Hz, and a command; row k has reading `rows[k]`."""
    t, made = 0.002 * np.arange(len(rows)), []
    for k, joint in enumerate(joints):
        q = motion(t + k)
        q = step * np.round(q / step) if step else q
        made += [Track("q", joint, t, q[rows], "q"), Track("command_position", joint, t, q, "c")]
        if not step:
            made.append(Track("dq", joint, t, np.gradient(motion(t + k), t)[rows], "dq"))
    return made


@pytest.mark.parametrize("every", [2, 5, 10, 8.4])
def test_each_reading_is_kept_once_with_the_stamp_of_its_first_row(every):
    rows = (np.floor(np.arange(2000) / every) * every).astype(int)
    notes = []
    before, after = tracks(rows), stale.fresh(tracks(rows), notes)
    assert len(notes) == 1 and "q, dq: readings of" in notes[0] and "of 500 Hz" in notes[0]
    for old, new in zip(before, after, strict=True):
        if old.role.startswith("command"):
            assert np.array_equal(old.x, new.x)
            continue
        first = np.flatnonzero(np.diff(rows)) + 1
        assert np.array_equal(new.t, old.t[first]) and np.array_equal(new.x, old.x[first])


@pytest.mark.parametrize("step", [0.0, 1e-3, 0.02])
def test_signals_that_are_read_in_each_row_stay(step):
    rows, notes = np.arange(2000), []
    before = tracks(rows, step)
    after = stale.fresh(before, notes)
    assert notes == [] and all(a is b for a, b in zip(before, after, strict=True))


def test_a_joint_that_turns_by_one_step_of_its_encoder_at_a_time_stays():
    t = 0.002 * np.arange(2000)
    turning, notes = Track("q", "wheel", t, 0.01 * np.floor(t / 0.006), "q"), []
    assert stale.fresh([turning], notes) == [turning] and notes == []


def test_a_joint_that_rests_between_its_motions_stays():
    t = 0.002 * np.arange(3000)
    x = np.where(np.sin(2.0 * t) > 0.0, motion(t), 0.0)
    resting, notes = Track("q", "knee", t, x, "q"), []
    assert stale.fresh([resting], notes) == [resting] and notes == []


def test_rows_that_are_repeated_with_their_stamps_are_left_to_their_stamps():
    t = np.repeat(0.002 * np.arange(1000), 2)
    track, notes = Track("q", "knee", t, motion(t), "q"), []
    assert stale.fresh([track], notes) == [track] and notes == []
