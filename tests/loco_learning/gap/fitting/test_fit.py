# SPDX-License-Identifier: Apache-2.0
"""Fits leave the minimum next to their start for a deeper one."""

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Setting, beyond, fit, jointly, weigh
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_learning.gap.params import GapParams
from loco_learning.gap.prediction.case import Case
from loco_learning.gap.statistics.solve import guided
from loco_sim.effects.offers import Hints

STRIBECK = {"name": "stribeck_friction", "torque": 4.3, "velocity": 0.085}


def setting(**params):
    return Setting(GapParams(**params), {}, {}, 100.0, ())


def at(hypothesis, **values):
    """A hypothesis at values of its parameters."""
    return hypothesis, tuple(c.inverse(values[c.name]) for c in hypothesis.coordinates)


def test_a_wrong_shape_is_left_behind(bench):
    case, offered = bench([STRIBECK])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    near = fit(case, [at(hypothesis, torque=0.5, velocity=1.0)], setting(evaluations=4))
    far = beyond(case, near, setting())
    assert far.fit_rms < 0.5 * near.fit_rms
    (spec,) = far.specs
    assert spec["velocity"] == pytest.approx(STRIBECK["velocity"], rel=0.1)


def test_the_right_one_stays(bench):
    case, offered = bench([STRIBECK])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    right = fit(case, [at(hypothesis, torque=4.3, velocity=0.085)], setting())
    assert beyond(case, right, setting()).fit_rms <= right.fit_rms


def test_a_strength_alone_has_one_minimum(bench):
    case, offered = bench([{"name": "coulomb_friction", "torque": 3.0}])
    (hypothesis,) = offered["coulomb_friction"].hypotheses
    model = fit(case, [at(hypothesis, torque=1.0)], setting())
    before = case.count
    assert beyond(case, model, setting()) is model
    assert case.count == before


def test_unusual_shapes_strain_a_model(bench):
    case, offered = bench([])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    usual, odd = (weigh(case, [at(hypothesis, torque=1.0, velocity=v)], {}) for v in (0.1, 40.0))
    assert usual.strain - usual.pull < 0.5 < 5.0 < odd.strain - odd.pull  # but for clocks


def test_a_stop_and_a_weak_drive_are_fitted_together(servo):
    """A stop by itself ended at a rod 5 % too heavy, and a payload got a name for the rest."""
    stop = {"name": "end_stop", "joint": "pivot", "angle": 0.55, "stiffness": 0.5, "damping": 0.03}
    case = servo([stop])
    robot = case.forward.robot(0)
    offered = offer(robot, case.signals, Hints(np.full(1, -0.9), np.full(1, 0.9)))
    (hypothesis,) = [h for h in offered if h.effect == "end_stop" and "above" in h.key]
    apart = weigh(case, [at(hypothesis, angle=0.5, stiffness=0.4, damping=0.03)], {})
    together = jointly(case, apart, setting())
    assert together.fit_rms < 1.1 < 1.4 < apart.fit_rms
    (spec,) = together.specs
    assert spec["angle"] == pytest.approx(0.55, rel=0.02)
    assert spec["stiffness"] == pytest.approx(0.5, rel=0.1)
    for name, value in servo.truth.items():
        assert together.loose[name] == pytest.approx(value, rel=0.01)


def test_each_value_is_changed_only_where_straight_lines_lead_nowhere(servo, monkeypatch):
    """A cost of nothing is one that no fit reaches: there each value is changed in a simulation."""
    stop = {"name": "end_stop", "joint": "pivot", "angle": 0.55, "stiffness": 0.5, "damping": 0.03}
    case = servo([stop])
    offered = offer(case.forward.robot(0), case.signals, Hints(np.full(1, -0.9), np.full(1, 0.9)))
    (hypothesis,) = [h for h in offered if h.effect == "end_stop" and "above" in h.key]
    apart = weigh(case, [at(hypothesis, angle=0.5, stiffness=0.4, damping=0.03)], {})
    runs, searched, bare = [], [], Case.bare

    def counted(self, *args, **kwargs):
        runs.append(args)
        return bare(self, *args, **kwargs)

    def search(*args):  # what comes before and after is the same for both
        before = len(runs)
        found = guided(*args)
        searched.append(len(runs) - before)
        return found

    monkeypatch.setattr(Case, "bare", counted)
    monkeypatch.setattr("loco_learning.gap.fitting.fit.guided", search)
    costs = [
        jointly(case, replace(apart, cost=promised), setting()).cost for promised in (np.inf, 0.0)
    ]
    assert searched[0] < 0.75 * searched[1]
    assert costs[0] < 1.02 * costs[1]


def test_where_straight_lines_are_true_nothing_is_fitted_again(bench):
    case, offered = bench([STRIBECK])
    (hypothesis,) = offered["stribeck_friction"].hypotheses
    model = weigh(case, [at(hypothesis, torque=4.3, velocity=0.085)], {})
    assert jointly(case, model, setting()) is model
