# SPDX-License-Identifier: Apache-2.0
"""Signals of robots that run are cut and compared as those of recordings are."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.calibration.live import GapMeter, Signals

RATE, FREQUENCY = 100.0, 0.5
JOINTS, DRIVEN = ("hip", "knee", "ankle"), ("hip",)


def signals(span=10.0):
    return Signals("/robot", JOINTS, DRIVEN, span)


def feed(kept, start, stop, scale=1.0, lag=0.0):
    """A robot whose passive joints swing with the actuation, `scale` times as far."""
    for tick in range(round(start * RATE), round(stop * RATE)):
        t = tick / RATE
        angle = np.sin(2 * np.pi * FREQUENCY * t)
        delayed = np.sin(2 * np.pi * FREQUENCY * (t - lag))
        kept.add_state(t, np.array([angle, scale * delayed, 2 * scale * delayed]))
        kept.add_command(t, np.array([angle]))


def meter(measured, model):
    return GapMeter(measured, model, JOINTS[1:], RATE)


def test_only_the_newest_seconds_are_kept():
    kept = signals(span=3.0)
    feed(kept, 0.0, 8.0)
    recording = kept.recording(RATE)
    assert kept.now == pytest.approx(7.99)
    assert recording.t[0] == pytest.approx(4.99)
    assert kept.length == pytest.approx(3.0)
    assert recording.driven == DRIVEN
    assert recording.joints == JOINTS


def test_a_robot_that_begins_anew_is_heard_from_its_new_start():
    kept = signals()
    feed(kept, 0.0, 8.0)
    feed(kept, 0.0, 2.0)
    assert kept.length == pytest.approx(1.99)
    assert kept.recording(RATE).t[0] == 0.0


def test_nothing_heard_is_said_in_one_line():
    kept = signals()
    assert kept.length == 0.0
    with pytest.raises(ParameterError, match="/robot has sent no joint states"):
        kept.recording(RATE)
    assert meter(kept, signals()).update() is None


def test_equal_robots_have_no_gap_whatever_their_clocks_say():
    ours, theirs = signals(), signals()
    feed(ours, 0.0, 9.0)
    feed(theirs, 100.0, 109.0)
    found = meter(ours, theirs).update()
    assert found.gap < 1e-3
    assert found.period == pytest.approx(1.0 / FREQUENCY, rel=1e-3)
    assert found.t == pytest.approx(8.0, abs=0.01)
    assert found.since == pytest.approx(106.0, abs=0.01)


def test_a_lag_of_all_joints_is_found_and_costs_nothing():
    ours, theirs = signals(), signals()
    feed(ours, 0.0, 9.0, lag=0.1)
    feed(theirs, 0.0, 9.0)
    found = meter(ours, theirs).update()
    assert found.lag == pytest.approx(0.1, abs=0.01)
    assert found.gap < 0.02


@pytest.mark.parametrize("scale", [0.5, 1.5])
def test_the_gap_is_the_sum_over_the_joints_of_the_mean_difference(scale):
    ours, theirs = signals(), signals()
    feed(ours, 0.0, 9.0)
    feed(theirs, 0.0, 9.0, scale=scale)
    found = meter(ours, theirs).update()
    mean = 0.5 * 2 / np.pi  # of |0.5 sin|
    np.testing.assert_allclose(found.joints, [mean, 2 * mean], rtol=0.01)
    assert found.gap == pytest.approx(found.joints.sum(), rel=1e-6)


def test_the_gap_is_told_once_per_period():
    ours, theirs = signals(), signals()
    one, told = meter(ours, theirs), []
    for t in np.arange(0.0, 20.0, 0.1):
        feed(ours, t, t + 0.1)
        feed(theirs, t, t + 0.1)
        found = one.update()
        if found:
            told.append(found)
    assert [g.number for g in told] == list(range(len(told)))
    np.testing.assert_allclose(np.diff([g.t for g in told]), 1.0 / FREQUENCY, atol=0.03)
    assert len(told) >= 8


def test_lost_messages_make_it_listen_anew():
    kept = signals()
    feed(kept, 0.0, 4.0)
    feed(kept, 4.5, 6.0)
    assert kept.length == pytest.approx(1.49)
    assert kept.recording(RATE).t[0] == 4.5
