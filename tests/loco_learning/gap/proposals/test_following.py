# SPDX-License-Identifier: Apache-2.0
"""An experiment is proposed for what closes a gap, and promises no more than recordings gave."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace as Some

import numpy as np
import pytest

from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import led
from loco_learning.gap.proposals import following, pool, propose
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.statistics import evidence
from loco_sim.plant.model import Model

NOISE = np.random.default_rng(2).standard_normal((400, 1))
SLOW = np.sin(np.arange(400) / 30.0)[:, None]


def model(name, size):
    """A model that leaves noise and a slow error of so many floors."""
    score = evidence.score([NOISE + size * SLOW])
    return Some(names=(name,), key=name, held=score, score=score, whole=score.residuals)


def judged(best, rivals, gap=100.0):
    """Models with the odds of the best one over each."""
    sizes = [1.0, *(1.0 / odds for _, odds in rivals)]
    values = np.array(sizes) / np.sum(sizes)
    pairs = [(rival, value) for (rival, _), value in zip(rivals, values[1:], strict=True)]
    return Some(base=model("", gap), best=best, rivals=pairs, probability=values[0])


def test_causes_that_close_next_to_nothing_are_not_told_apart():
    """Two causes of 3 % of a gap were to be told apart by the next experiment."""
    small, other = model("slope", 97.0), model("cable_force", 97.0)
    assert following.hypotheses(judged(small, [(other, 2.0)])) == []
    good = model("payload", 1.0)
    assert following.hypotheses(judged(good, [(other, 2.0)])) == [good]


def test_what_closes_a_gap_and_is_not_excluded_is_told_apart():
    best, near, out = model("payload", 1.0), model("com_offset", 3.0), model("slope", 5.0)
    both = following.hypotheses(judged(best, [(near, 3.0), (out, 2.0 * following.DECISIVE_RATIO)]))
    assert both == [best, near]


@pytest.mark.parametrize(("odds", "least", "most"), [(2.4, 1e-4, 0.05), (500.0, 0.5, 1.0)])
def test_a_promise_counts_for_what_recordings_kept_of_theirs(odds, least, most):
    """Chirps of 7 s that promised as much gave odds of 2.4: the next ones promise no billion."""
    size = 2.0 if odds < 10.0 else 0.6
    best, rival = model("payload", 0.0), model("com_offset", size)
    worth = following._expected_share(judged(best, [(rival, odds)]), [best, rival], 5.0)
    assert least < worth <= most


def test_a_promise_that_is_worth_little_is_small_and_keeps_its_order():
    floor, names = np.ones(1), ["payload", "com_offset"]
    said = {"calm": [0.0 * SLOW, 0.3 * SLOW], "lively": [0.0 * SLOW, 2.0 * SLOW]}
    sure, unsure = (propose.rank(said, names, floor, expected_share=w) for w in (1.0, 0.02))
    assert [p.experiment for p in sure] == [p.experiment for p in unsure] == ["lively", "calm"]
    assert sure[0].odds > 1e6 and unsure[0].odds < 100.0


def motion(shape, seconds=4.0, rate=100.0, lead=0.0, kind="position"):
    """A record of two joints that are told a motion, after a rest."""
    t = np.arange(round((seconds + lead) * rate)) / rate
    at = np.where(t < lead, 0.0, t - lead)
    told = 0.2 + np.column_stack([shape(at), 0.5 * shape(1.3 * at)])
    return Record("r", t, {kind: told}, ("a", "b"), {"q": told}, ("a", "b"))


def chirp(t):
    return np.sin(2.0 * np.pi * (0.3 + 0.4 * t) * t)


def steps(t):
    return np.sign(np.sin(5.0 * t))


@pytest.mark.parametrize(
    ("given", "same"),
    [
        (motion(chirp), True),
        (motion(chirp, rate=250.0, lead=1.5), True),
        (motion(chirp, kind="torque"), True),  # told otherwise, moved the same
        (motion(steps), False),
        (motion(lambda t: chirp(0.6 * t)), False),
        (motion(chirp, seconds=1.0), False),  # a quarter of it
    ],
)
def test_a_motion_that_was_given_is_known_whenever_and_however_it_was_recorded(given, same):
    assert pool.same_motion(motion(chirp), given) is same


def test_a_motion_of_other_joints_is_another():
    given = replace(motion(chirp), driven=("c", "d"), joints=("c", "d"))
    assert not pool.same_motion(motion(chirp), given)


def test_a_held_torque_is_simulated_in_the_steps_of_the_robot_where_torques_were_compared():
    """Rows of inverse dynamics, here of 6 ms, are no control periods."""
    t = 0.003 * np.arange(1000)
    q = np.sin(3.0 * t)[:, None]
    record = Record("swung", t, {"torque": 0.02 * q}, ("pivot",), {"q": q}, ("pivot",))
    forward = led.InverseDynamics(Model("pendulum"), [record])
    there = following.along(cases.prepare(forward, list(forward.records), []), [record])
    held = {"name": "torque_hold", "joint": "pivot", "period": 0.0125}
    (said,) = there.predicted([held], {}, [0], 1.0)
    assert len(said) == len(t) and np.isfinite(said[-1]).all()
