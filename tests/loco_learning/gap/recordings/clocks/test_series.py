# SPDX-License-Identifier: Apache-2.0
"""Two motions in one signal are told, whatever both are; one motion is left alone."""

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.importing import align
from loco_learning.gap.recordings.clocks import series

T = np.arange(1600) / 100.0
NOISE = np.random.default_rng(0).standard_normal(1600)


def motion(late=0.0):
    return 0.5 * np.sin(3.0 * (T - late)) + 0.2 * np.sin(7.7 * (T - late) + 1.0)


def mixed(other, each):
    """The motion with each so manieth reading of another, and the flags of those."""
    rows = np.arange(1600) % each == 0
    return np.where(rows, other, motion()), rows


# Steps of a leg, by an encoder of 5 mrad: five readings of one value are passed through.
STEPS = 0.00506 * np.cumsum([
    57, 0, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1, -2, -32, -36, -22, 16, 11, 3, -5,
    -5, 2, 1, 1, 0, -1, 0, 0, 1, -1, 0, 1, 0, -1, 0, 1, -1, 0, 0, 1, -1, 0, 1, -1, 0, 11, 38, 19,
    -4, -8, -4, -5, 7, 1, 0, -2, 0, 1, 0, 0, -1, 1, 0, 0, -1, 1, 0, 0, -16, -38, -34, -17, 20, 9,
    1, -6, -4, 3, 1, 1, -1, -1, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1, 0, -1, 1, 0,
    -1, 0, 1, 1, 27, 41, 31, -2, -11, -4, -7, 7, 2, 0, -1, -1, 1, 0, 0, -1, 1, 0, 0, -3, -31,
    -28, -14, 18, 7, 1, -7, -1, 1, 2, 0, -1, 0, 0, 1, -1, 0, 0, 1, -1, 0, 1, 0, -1, 0, 1, -1, 0,
    0, 1, 0, 27, 41, 42, 9, -10, -8, -3, -2, 6, 0, 1, -2, 0, 0, 1, 0, -1, 0, 0, 1, -1, -15, -39,
    -43, -36, 12, 17, 5, -4, -6, 0, 2, 1, 0, -1, 0, 0,
])  # fmt: skip


@pytest.mark.parametrize("value", [0.0, 0.4, -1.5707])
@pytest.mark.parametrize("each", [2, 10, 60])
def test_a_value_between_readings_is_found_to_the_row(value, each):
    x, rows = mixed(value, each)
    assert np.array_equal(series.other_motion(x + 1e-3 * np.where(rows, 0.0, NOISE)), rows)


def test_readings_between_a_value_are_found_as_well():
    rows = np.arange(1600) % 4 > 0  # the publisher of zeros is the faster one
    assert np.array_equal(series.other_motion(np.where(rows, 0.0, motion())), rows)


@pytest.mark.parametrize("each", [2, 3, 7])
@pytest.mark.parametrize("other", [motion(0.4), 0.6 * motion(-0.5) + 0.2, motion() + 0.4])
def test_two_motions_are_found(other, each):
    assert series.other_motion(mixed(other, each)[0]) is not None


def test_a_publisher_that_loses_a_third_of_its_messages_is_found():
    lost = np.random.default_rng(3).random(1600) < 1.0 / 3.0
    rows = (np.arange(1600) % 5 == 0) & ~lost
    assert series.other_motion(np.where(rows, motion() + 0.4, motion())) is not None


@pytest.mark.parametrize(
    "x",
    [
        motion(),
        motion() + 0.05 * NOISE,
        NOISE,
        np.cumsum(NOISE),
        np.round(motion() / 0.05),
        np.round(0.01 * np.arange(1600) + 0.5 * NOISE),  # rounded, and noise of half a step
        np.round(0.5 + 0.3 * NOISE),
        np.sign(np.sin(2.0 * T)),
        (9.0 * T) % (2.0 * np.pi),
        np.where(T < 8.0, motion(), 0.0),
        np.where(np.abs(NOISE) > 2.6, 0.5 * NOISE[::-1], motion()),  # single faults, each another value
        0.001 * NOISE + np.where(np.abs(NOISE[::-1]) > 1.9, 0.03, 0.0),  # a spring that flicks
        STEPS,
        np.zeros(0),
        np.zeros(5),
    ],
)
def test_one_motion_is_one(x):
    assert series.other_motion(x) is None


def test_it_is_said_with_the_count_and_rate_and_the_user_may_keep_it(signals, hinge, change):
    def zeros(track):
        return change(track, x=np.where(np.arange(400) % 10 == 3, 0.0, track.x))

    words = r"q of hinge: 40 of 400 readings are 0, at 10 Hz, .*missing: 0 in the mapping"
    with pytest.raises(ParameterError, match=words):
        align.record("run", signals(q=zeros, dq=lambda k: None), hinge)
    made = align.record("run", signals(q=zeros, dq=lambda k: None), hinge, trust_units=True)
    assert np.sum(made.signals["q"] == 0.0) >= 40


def chatter(track):
    """Each second reading 0.1 ahead: a drive that is unstable at its own rate."""
    rows = np.where(np.arange(len(track.x)) > 100, 0.1 * (-1.0) ** np.arange(len(track.x)), 0.0)
    return rows if track.role == "q" else 100.0 * rows


@pytest.mark.parametrize("size", [0.4, 1.0, 3.0])
def test_a_joint_that_goes_to_and_fro_by_its_own_velocity_is_one_motion(
    signals, hinge, change, size
):
    def faster(track):
        return change(track, x=0.1 * track.x + size * chatter(track))

    tracks = signals(q=faster, dq=faster)
    assert series.other_motion(tracks[1].x) is not None
    made = align.record("run", tracks, hinge)
    assert np.ptp(made.signals["q"]) > 0.2 * size


def test_a_second_publisher_that_sends_velocities_too_is_told(signals, hinge, change):
    def still(track):
        rows = np.arange(len(track.x)) % 2 == 1
        return change(track, x=np.where(rows, 0.3 if track.role == "q" else 0.0, track.x))

    with pytest.raises(ParameterError, match="second"):
        align.record("run", signals(q=still, dq=still), hinge)
