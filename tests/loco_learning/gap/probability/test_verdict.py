# SPDX-License-Identifier: Apache-2.0
"""The verdict by probabilities: the finest statement that is probable enough."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.probability.verdict import statement
from loco_learning.gap.probability.weights import weigh
from loco_learning.gap.verdict.decide import AMBIGUOUS, MORE, NAMED, NO_GAP, UNKNOWN
from loco_sim.effects import EFFECTS
from loco_sim.effects.coordinates import Coordinate

from .models import fitted, law

RUBS, VISCOUS, PLAY, LAGS = "coulomb_friction", "viscous_friction", "backlash", "actuator_lag"


def said(*models, gap=10.0, **kwargs):
    """Statement about models, given as effects with the error that they leave, beside none."""
    base = fitted(rms=gap)
    models = [fitted(*laws, rms=rms) for rms, *laws in models]
    return statement(weigh([base, *models], 0), base, base, set(), **kwargs)


@pytest.mark.parametrize(
    ("models", "verdict", "names", "groups"),
    [
        ([(0.0, RUBS)], NAMED, [RUBS], []),
        ([(0.0, RUBS), (3.0, PLAY)], NAMED, [RUBS], []),
        ([(0.0, RUBS), (0.0, PLAY)], AMBIGUOUS, [], [[PLAY, RUBS]]),
        ([(0.0, RUBS), (0.0, RUBS, PLAY)], NAMED, [RUBS], []),
        ([(3.0, RUBS), (0.0, RUBS, PLAY)], NAMED, [PLAY, RUBS], []),
        ([(3.0, RUBS), (0.0, RUBS, PLAY), (0.0, RUBS, LAGS)], AMBIGUOUS, [RUBS], [[LAGS, PLAY]]),
        ([(2.5, RUBS)], MORE, [RUBS], []),
        ([(7.5, RUBS)], UNKNOWN, [], []),  # too little of the gap
        ([(10.0, RUBS)], UNKNOWN, [], []),
        ([], UNKNOWN, [], []),
    ],
)
def test_what_is_probable_enough_is_said(models, verdict, names, groups):
    result = said(*models)
    assert (result["verdict"], result["names"]) == (verdict, names)
    assert [sorted(g) for g in result["ambiguous"]] == groups


def test_without_a_gap_there_is_none_and_without_an_effect_the_cause_is_unknown():
    assert said(gap=0.0)["verdict"] == NO_GAP
    assert said((0.0, RUBS), gap=0.0)["verdict"] == NO_GAP  # the effect is not needed
    assert said((9.99, RUBS))["verdict"] == UNKNOWN


def test_exact_twins_are_told_together():
    (name, twin), *_ = [(n, t) for n, cls in EFFECTS.items() for t in cls.identity.twins]
    result = said((0.0, law(name, "")))
    assert (result["verdict"], result["ambiguous"]) == (AMBIGUOUS, [sorted((name, twin))])
    assert result["effects"][name] == pytest.approx(0.5, abs=0.01)
    assert result["kinds"][EFFECTS[name].identity.kind] > 0.95


def test_an_accuracy_that_was_asked_for_is_enough():
    assert said((2.5, RUBS))["verdict"] == MORE
    assert said((2.5, RUBS), enough=np.array([3.0]))["verdict"] == NAMED


@pytest.mark.parametrize(
    ("delay", "gap", "verdict"), [(1e-5, 2.0, NO_GAP), (0.1, 2.0, NAMED), (1e-5, 10.0, NAMED)]
)
def test_a_small_gap_that_something_negligible_explains_is_none(delay, gap, verdict):
    size = Coordinate("delay", 1.0, (1.0,), 0.0, 1.0, "s", strength=True)
    late = Hypothesis("actuation_delay", "knee", (), (size,))
    model = replace(fitted(late), parts=((late, (delay,)),))
    base = fitted(rms=gap)
    assert statement(weigh([base, model], 0), base, base, set())["verdict"] == verdict


def test_kinds_and_places_are_surer_than_laws():
    result = said((0.0, RUBS), (0.0, VISCOUS), (0.0, law(VISCOUS, "hip")))
    (p,), (kind,) = result["effects"].values(), result["kinds"].values()
    assert p < 0.7 < 0.95 < kind and result["places"]["knee"] == pytest.approx(2 / 3, abs=0.02)
