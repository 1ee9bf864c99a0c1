# SPDX-License-Identifier: Apache-2.0
"""Fits leave the minimum next to their start for a deeper one."""

import pytest

from loco_learning.gap.fitting.fit import Setting, beyond, fit, weigh
from loco_learning.gap.params import GapParams

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
    assert usual.strain < 0.5 < 5.0 < odd.strain
