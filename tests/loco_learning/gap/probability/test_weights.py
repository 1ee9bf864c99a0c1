# SPDX-License-Identifier: Apache-2.0
"""Laws of the probabilities: they sum to 1, twins share, effects pay, and half is half."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.probability.weights import CRITERION, NO_EFFECT, Weights, smallest, weigh
from loco_learning.gap.statistics import evidence
from loco_sim.effects import EFFECTS
from loco_sim.effects.coordinates import Coordinate

from .models import fitted, law, left

RUBS, VISCOUS, LAGS, PLAY = "coulomb_friction", "viscous_friction", "actuator_lag", "backlash"
BASE = fitted(rms=5.0)


def test_the_model_that_explains_the_data_is_certain_and_its_effect_with_it():
    found = weigh([BASE, fitted(RUBS), fitted(LAGS, rms=3.0)], 0)
    assert found.best.names == (RUBS,) and found.values.sum() == pytest.approx(1.0)
    assert found.effect(RUBS) == found.effect(RUBS, "knee") == pytest.approx(1.0, abs=0.01)
    assert found.effect(RUBS, "hip") == 0.0 and found.effect(LAGS) < 0.01
    assert found.kind("friction") > 0.99 and found.place("knee") > 0.99


def test_the_order_of_models_and_of_records_does_not_matter():
    models = [BASE, fitted(RUBS), fitted(LAGS, rms=0.4), fitted(PLAY, rms=1.0)]
    first = weigh(models, 0)
    for order in itertools.permutations(models):
        again = weigh(order, 0)
        assert [m.key for m in again.models] == [m.key for m in first.models]
        assert np.allclose(again.values, first.values)
    turned = [replace(m, whole=m.whole[::-1]) for m in models]
    assert weigh(turned, 0).effect(RUBS) == pytest.approx(first.effect(RUBS), abs=0.02)


def test_places_of_equal_probability_are_in_the_order_of_their_names():
    models = [fitted(law(RUBS, place)) for place in ("knee", "hip", "toe")]
    for order in itertools.permutations(models):
        found = Weights(tuple(order), np.array([0.25, 0.25, 0.25])).places_of(RUBS)
        assert list(found.items()) == [("hip", 0.25), ("knee", 0.25), ("toe", 0.25)]


def test_models_that_leave_the_same_share_the_probability():
    found = weigh([BASE, fitted(RUBS), fitted(VISCOUS)], 0)
    assert found.effect(RUBS) == pytest.approx(found.effect(VISCOUS), abs=1e-6)
    assert found.effect(RUBS) == pytest.approx(0.5, abs=0.01)
    assert found.kind("friction") == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("name", "twin"),
    [(name, twin) for name, cls in EFFECTS.items() for twin in cls.identity.twins],
)
def test_exact_twins_share_the_probability_of_the_one_that_was_fitted(name, twin):
    found = weigh([BASE, fitted(law(name, ""))], 0)
    assert found.effect(name) == found.effect(twin) == pytest.approx(0.5, abs=0.01)
    assert set(smallest(found.alternatives(found.best, 0), 0.95)) == {name, twin}


def test_an_effect_that_explains_nothing_more_is_as_improbable_as_its_price():
    found = weigh([BASE, fitted(RUBS), fitted(RUBS, LAGS)], 0)
    n_eff = fitted(RUBS).score.n_eff
    price = np.exp(CRITERION.price) * np.sqrt(n_eff)  # one effect with one parameter
    assert 1.0 / found.effect(LAGS) - 1.0 == pytest.approx(price, rel=0.02)
    assert found.supported(CRITERION.confidence).names == (RUBS,)


def test_an_effect_without_which_more_than_noise_is_left_stays():
    """Dry friction alone, 1.75 times too large: most of a large gap was closed without viscous."""
    for rest in (1.6, 3.0, 5.0):
        found = weigh([fitted(rms=54.0), fitted(RUBS, rms=rest), fitted(RUBS, VISCOUS)], 0)
        assert found.effect(VISCOUS) > 0.99
        assert set(found.supported(CRITERION.confidence).names) == {RUBS, VISCOUS}


def test_a_model_that_leaves_many_times_as_much_is_out_however_short_the_data():
    few = [r[:120] for r in left(0.0)], [r[:120] for r in left(8.0)]
    found = weigh([fitted(whole=2 * few[1]), fitted(RUBS, whole=2 * few[0])], 0)
    assert found.effect(RUBS) > CRITERION.confidence


@pytest.mark.parametrize("pairs", [400])
def test_a_probability_is_right_as_often_as_it_says(pairs):
    """Two models that are equally wrong: no more than a twentieth of the names is sure."""
    sure, right, told = 0, 0, []
    for seed in range(pairs // 2):
        rng = np.random.default_rng([seed, 5])
        a, b = 0.6 + 0.3 * rng.random(2)
        whole = [left(size, size, seed=seed, shift=s) for size, s in ((a, 0.0), (b, 1.5))]
        found = weigh([fitted(RUBS, whole=whole[0]), fitted(LAGS, whole=whole[1])], seed)
        best = found.best.names
        told.append(found.values[0])
        right += best == ((RUBS,) if a < b else (LAGS,))
        sure += found.values[0] > CRITERION.confidence and (best == (RUBS,)) != (a < b)
    assert sure <= 0.05 * len(told)
    assert np.mean(told) <= right / len(told) + 0.1


def test_a_law_in_several_joints_acts_in_each_of_them():
    family = law(RUBS, "hip knee", ("hip", "knee"))
    found = weigh([BASE, fitted(family), fitted(law(RUBS, "knee"))], 0)
    assert found.effect(RUBS, "knee") == pytest.approx(1.0, abs=0.01)
    assert found.effect(RUBS, "hip knee") == found.effect(RUBS, "hip") < 0.5


def test_nothing_may_be_in_the_place_of_an_effect_that_is_not_needed():
    found = weigh([BASE, fitted(RUBS), fitted(RUBS, LAGS, rms=0.0), fitted(RUBS, PLAY)], 0)
    model = next(m for m in found.models if m.names == (LAGS, RUBS) or LAGS in m.names)
    index = [h.effect for h, _ in model.parts].index(LAGS)
    instead = found.alternatives(model, index)
    assert next(iter(instead)) == NO_EFFECT and sum(instead.values()) == pytest.approx(1.0)
    assert found.supported(CRITERION.confidence).names == (RUBS,)


def test_a_law_on_the_bound_of_its_shape_has_no_weight():
    speed = Coordinate("velocity", 0.1, (0.0,), 0.001, 10.0, "rad/s", logarithmic=True)
    other = law("stribeck_friction")
    other = replace(other, coordinates=(*other.coordinates, speed))
    for x, present in ((speed.inverse(10.0), False), (0.0, True)):
        model = replace(fitted(other), parts=((other, (1.0, x)),))
        found = weigh([BASE, fitted(RUBS, rms=3.0), model], 0)
        assert (model in found.models) is present


@pytest.mark.parametrize(
    ("found", "names"),
    [({"a": 0.96, "b": 0.04}, ("a",)), ({"a": 0.95, "b": 0.05}, ("a",)),
     ({"a": 0.94, "b": 0.06}, ("a", "b")), ({"a": 0.5, "b": 0.3, "c": 0.2}, ("a", "b", "c")),
     ({"a": 0.3, "b": 0.1}, ("a", "b"))],
)  # fmt: skip
def test_the_smallest_set_ends_where_it_is_sure(found, names):
    assert smallest(found, 0.95) == names


def test_weights_of_models_are_those_of_each_bootstrap_sample():
    """Two equal models lose against a third one together, not one after the other."""
    scores = [fitted(rms=r).score for r in (0.0, 0.5, 0.5)]
    rng = np.random.default_rng(0)
    logs = evidence.log_weights(scores, 0, [0.0, 0.0, 2.0], rng)
    assert logs[1] - logs[2] == pytest.approx(2.0, abs=1e-6) and logs[1] < logs[0] == 0.0
