# SPDX-License-Identifier: Apache-2.0
"""The schedule of networks: phases follow each other, learning fades, files are never changed."""

import numpy as np
import pytest

from loco_learning.params import PHASES, JointLearnerParams, LearnerParams
from loco_learning.reflex.schedule import CLOSING, STAND, TEST, TRAIN, Schedule

TIMES = {"stand": 0.2, "train": 1.0, "closing": 2.0, "test": 1.0, "enabled": True}


@pytest.mark.parametrize("params", [LearnerParams, JointLearnerParams])
def test_all_networks_share_the_schedule(params):
    schedule = Schedule(params(**TIMES), 0.01)
    phases = [schedule.phase_of(tick) for tick in range(500)]
    np.testing.assert_array_equal(np.flatnonzero(np.diff(phases)) + 1, [20, 120, 320])
    assert [schedule.phase_at(t) for t in (0.0, 0.2, 1.2, 3.2)] == [STAND, TRAIN, CLOSING, TEST]
    learns = [schedule.learns(tick, phase) for tick, phase in enumerate(phases)]
    assert not any(learns[:20])
    assert all(learns[20:120])
    shares = np.reshape(learns[120:320], (-1, 10)).mean(axis=1)
    assert np.all(np.diff(shares) <= 0)
    assert shares.mean() == pytest.approx(0.55, abs=0.03)
    assert not any(learns[320:])
    assert schedule.params.duration == pytest.approx(4.2)
    assert list(schedule.params.durations) == list(PHASES)


@pytest.mark.parametrize("change", [{"enabled": False}, {"weights": "net.npz"}])
def test_nothing_learns_when_switched_off_or_when_weights_are_given(change):
    schedule = Schedule(LearnerParams(**{**TIMES, **change}), 0.01)
    assert not any(schedule.learns(tick, schedule.phase_of(tick)) for tick in range(400))
