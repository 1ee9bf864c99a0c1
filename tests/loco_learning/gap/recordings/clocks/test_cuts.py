# SPDX-License-Identifier: Apache-2.0
"""A stray stamp is put between its neighbours, and a clock that was set back divides a record."""

import numpy as np
import pytest

from loco_learning.gap.recordings.clocks import cuts
from loco_learning.gap.recordings.tracks import Track

T = 24.754 + 0.005 * np.arange(900) + 0.0003 * np.sin(7.0 * np.arange(900))


def wave(t):
    """A position and its command in the rows of a log, with the stamps `t`."""
    x = 0.5 * np.sin(3.0 * T)
    return [Track("q", "pivot", t, x, "made"), Track("command_position", "pivot", t, x + 0.1, "m")]


def test_seconds_that_were_read_before_the_milliseconds_divide_nothing():
    late = np.flatnonzero(T % 1.0 < 0.004)
    stray = T.copy()
    stray[late] -= 1.0
    assert len(late) > 2
    (part,), notes = cuts.parts("log", wave(stray), 50, 0.25)
    for track in part:
        assert np.max(np.abs(track.t - T)) < 0.003 and np.all(np.diff(track.t) > 0.0)
        assert np.delete(track.t, late) == pytest.approx(np.delete(T, late), abs=0.0)
    assert len(notes) == 1 and f"{len(late)} stamps of q of pivot go back, by up to 0.99" in notes[0]


def test_a_clock_that_was_set_back_and_stays_there_divides():
    back = T - np.where(np.arange(900) >= 400, 1.5, 0.0)
    parts, notes = cuts.parts("log", wave(back), 50, 0.25)
    assert [len(part[0].t) for part in parts] == [400, 500] and "jumps back by" in notes[0]


@pytest.mark.parametrize(("rows", "told"), [(40, "has 40 readings"), (55, "lasts 0.27 s")])
def test_a_short_part_is_left_out_by_its_readings_or_its_time(rows, told):
    back = T - np.where(np.arange(900) >= rows, 1.5, 0.0)
    (part,), notes = cuts.parts("log", wave(back), 50, 0.3)
    assert len(part[0].t) == 900 - rows
    assert any(note.startswith(f"part 1 {told}") and "left out" in note for note in notes)
