# SPDX-License-Identifier: Apache-2.0
"""Trials of a controller: speed and falls from their start on, with pushes and other bodies."""

import math

from loco_learning.reinforce.trials import TrialParams, judge
from loco_learning.runs.experiment import load


def test_trials_measure_speed_and_falls_from_the_start_on():
    p = TrialParams(start=1.5, length=2.0, count=2, push=0.0, spread=0.0)
    calm = judge(load("tigrillo_bound"), p)
    assert calm["calm"] == calm["pushed"] == calm["bodies"]  # nothing differs
    assert calm["calm"].falls == 0 and calm["calm"].count == 2 and calm["calm"].speed > 0.1
    hard = judge(load("tigrillo_bound"), p.replace(push=5.0, spread=0.1))
    assert hard["calm"] == calm["calm"]
    standing = judge(load("tigrillo_hold"), p)["calm"]
    assert abs(standing.speed) < 0.01 and standing.falls == 0 and math.isnan(standing.cost)
    assert hard["pushed"].falls == 2 and hard["bodies"] != calm["bodies"]
