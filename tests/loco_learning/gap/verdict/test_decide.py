# SPDX-License-Identifier: Apache-2.0
"""The verdict: what is said of the cause of a gap follows from probabilities alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.probability.weights import CRITERION, weigh
from loco_learning.gap.verdict.decide import (
    AMBIGUOUS,
    NAMED,
    NO_GAP,
    PARTLY,
    UNKNOWN,
    References,
    decide,
)
from loco_sim.effects import EFFECTS
from loco_sim.effects.coordinates import Coordinate

from ..probability.models import fitted, law

RUBS, VISCOUS, PLAY, LAGS = "coulomb_friction", "viscous_friction", "backlash", "actuator_lag"


def decided(base, models, persistence=(), **kwargs):
    """Decision on the most probable of some models."""
    weights, references = weigh([base, *models], 0), References(base, base, persistence)
    return decide(weights, weights.supported(CRITERION.confidence), references, **kwargs)


def said(*models, gap=10.0, **kwargs):
    """Decision about models, given as effects with the error that they leave, beside none."""
    return decided(fitted(rms=gap), [fitted(*laws, rms=rms) for rms, *laws in models], **kwargs)


@pytest.mark.parametrize(
    ("models", "verdict", "names", "groups"),
    [
        ([(0.0, RUBS)], NAMED, (RUBS,), ()),
        ([(0.0, RUBS), (3.0, PLAY)], NAMED, (RUBS,), ()),
        ([(0.0, RUBS), (0.0, PLAY)], AMBIGUOUS, (), ((PLAY, RUBS),)),
        ([(0.0, RUBS), (0.0, RUBS, PLAY)], NAMED, (RUBS,), ()),
        ([(3.0, RUBS), (0.0, RUBS, PLAY)], NAMED, (PLAY, RUBS), ()),
        (
            [(3.0, RUBS), (0.0, RUBS, PLAY), (0.0, RUBS, LAGS)],
            AMBIGUOUS, (RUBS,), ((LAGS, PLAY),),
        ),
        ([(2.5, RUBS)], PARTLY, (RUBS,), ()),
        ([(7.5, RUBS)], UNKNOWN, (), ()),  # too little of the gap
        ([(10.0, RUBS)], UNKNOWN, (), ()),
        ([], UNKNOWN, (), ()),
    ],
)  # fmt: skip
def test_what_is_probable_enough_is_said(models, verdict, names, groups):
    found = said(*models)
    assert (found.verdict, found.names, found.ambiguous) == (verdict, names, groups)


def test_without_a_gap_there_is_none_and_without_an_effect_the_cause_is_unknown():
    assert said(gap=0.0).verdict == NO_GAP and said(gap=0.0).adequate
    assert said((0.0, RUBS), gap=0.0).verdict == NO_GAP  # the effect is not needed
    unknown = said((9.99, RUBS))
    assert unknown.verdict == UNKNOWN and not unknown.adequate


@pytest.mark.parametrize(
    ("name", "twin"),
    [(name, twin) for name, cls in EFFECTS.items() for twin in cls.identity.twins],
)
def test_exact_twins_are_told_together(name, twin):
    found = said((0.0, law(name, "")))
    (ruling,) = found.rulings
    assert found.verdict == AMBIGUOUS and {name, twin} <= {ruling.name, *ruling.look_alikes}
    others = len(EFFECTS[name].identity.twins) + 1
    assert ruling.probability == pytest.approx(1.0 / others, abs=0.01)


def test_an_accuracy_that_was_asked_for_is_enough():
    assert said((2.5, RUBS)).verdict == PARTLY
    assert said((2.5, RUBS), levels=np.array([3.0])).verdict == NAMED


@pytest.mark.parametrize(
    ("delay", "gap", "verdict"), [(1e-5, 2.0, NO_GAP), (0.1, 2.0, NAMED), (1e-5, 10.0, NAMED)]
)
def test_a_small_gap_that_something_negligible_explains_is_none(delay, gap, verdict):
    size = Coordinate("delay", 1.0, (1.0,), 0.0, 1.0, "s", strength=True)
    late = Hypothesis("actuation_delay", "knee", (), (size,))
    model = replace(fitted(late), parts=((late, (delay,)),))
    found = decided(fitted(rms=gap), [model])
    assert found.verdict == verdict
    assert ("too small to matter" in found.evidence) == (verdict == NO_GAP)


@pytest.mark.parametrize(("loudest", "verdict"), [(1.0, NO_GAP), (1.01, NAMED)])
def test_a_gap_is_small_up_to_the_rms_of_the_criterion(loudest, verdict):
    size = Coordinate("delay", 1.0, (1.0,), 0.0, 1.0, "s", strength=True)
    late = Hypothesis("actuation_delay", "knee", (), (size,))
    sign = np.where(np.arange(500) % 2, 1.0, -1.0)[:, None]
    base = fitted(whole=[loudest * CRITERION.trifle * sign] * 3)
    found = decided(base, [replace(fitted(late, whole=[0.9 * sign] * 3), parts=((late, (1e-5,)),))])
    assert found.verdict == verdict


@pytest.mark.parametrize("effects", [(), (RUBS,)])
@pytest.mark.parametrize(("loudest", "verdict"), [(0.99, NO_GAP), (1.01, UNKNOWN)])
def test_a_slight_gap_that_nothing_explains_is_none(effects, loudest, verdict):
    """A true model whose masses are 2 % off left 1.34 floors, and was *unknown*."""
    sign = np.where(np.arange(50000) % 2, 1.0, -1.0)[:, None]
    whole = [loudest * CRITERION.unexplained * sign] * 3
    models = [fitted(one, whole=[0.95 * each for each in whole]) for one in effects]
    found = decided(fitted(whole=whole), models)
    assert found.verdict == verdict
    assert ("no effect tried explains" in found.evidence) == (verdict == NO_GAP)


def test_laws_of_one_kind_that_cannot_be_told_apart_have_that_kind():
    found = said((0.0, RUBS), (0.0, VISCOUS))
    assert found.rulings[0].kind == EFFECTS[RUBS].identity.kind != ""
    assert said((0.0, RUBS), (0.0, PLAY)).rulings[0].kind == ""
    assert said((0.0, RUBS)).rulings[0].kind == ""  # the law is told


def test_places_that_cannot_be_excluded_are_told_and_the_name_stays():
    found = said((0.0, law(RUBS, "knee")), (0.0, law(RUBS, "hip")), (5.0, law(RUBS, "toe")))
    (ruling,) = found.rulings
    assert found.verdict == NAMED and {ruling.place, *ruling.places} == {"knee", "hip"}
    assert said((0.0, RUBS)).rulings[0].places == ()


def test_an_effect_whose_size_may_be_zero_is_not_established():
    base, both = fitted(rms=10.0), fitted(RUBS, PLAY)
    models = [fitted(RUBS, rms=3.0), both]
    doubtful = next(h.key for h, _ in both.parts if h.effect == PLAY)
    assert decided(base, models).verdict == NAMED
    found = decided(base, models, uncertain={doubtful})
    assert (found.verdict, found.names) == (UNKNOWN, ())
    assert [r.verdict for r in found.rulings if r.name == PLAY] == [UNKNOWN]
    assert f"only beside {PLAY}" in found.evidence


def test_the_sentence_tells_what_is_left():
    assert "the gap falls from" in said((0.0, RUBS)).evidence
    more = said((2.5, RUBS)).evidence
    assert more.startswith(f"With {RUBS} the gap falls") and "more is missing: " in more
    assert "cannot tell {" in said((0.0, RUBS), (0.0, PLAY)).evidence
    part = said((7.5, RUBS)).evidence
    assert f"{RUBS} would close part of it" in part and "No effect tried" in part
    assert "No effect tried explains the gap of" in said().evidence
    assert "noise floors" in said(gap=0.0).evidence


@pytest.mark.parametrize(("fit", "told"), [(10.0, False), (200.0, True)])
def test_a_gap_that_is_elsewhere_than_in_the_held_out_record_is_told(fit, told):
    """Steps saturate the motor, the held-out sweep does not: 34 of the 440 floors were told."""
    sign = np.where(np.arange(500) % 2, 1.0, -1.0)[:, None]
    base = fitted(rms=10.0)
    base = replace(base, whole=[fit * sign, fit * sign, 10.0 * sign])
    evidence = decide(weigh([base], 0), base, References(base, base)).evidence
    assert f"the gap of {base.held.rms:.3g} noise floors" in evidence
    assert ("on all)" in evidence) == told


def test_a_gap_without_a_cause_is_that_of_the_users_model_as_in_the_headline():
    given, base = fitted(rms=12.0), fitted(rms=10.0)
    found = decide(weigh([base], 0), base, References(given, base))
    assert f"the gap of {given.held.rms:.3g} noise" in found.evidence
    assert f"refitted values of the robot leave {base.held.rms:.3g}" in found.evidence
    assert "refitted" not in said().evidence


def test_what_leaves_more_is_never_said_to_close_part_of_it():
    """A try that is no better on held-out data is no answer."""
    base = fitted(rms=5.0)
    worse = replace(fitted(RUBS, rms=7.0), fit_rms=1.0)
    weights = weigh([base, worse], 0)
    found = decide(weights, worse, References(base, base))
    assert found.verdict == UNKNOWN and "or lowers it" in found.evidence


def test_a_share_of_the_gap_is_that_of_the_better_of_the_given_model_and_one_that_does_not_move():
    """A model that diverges makes any gap large, of which whatever rests closes most."""
    still = fitted(rms=3.0).whole
    assert said((2.5, RUBS)).verdict == PARTLY
    assert said((2.5, RUBS), persistence=fitted(rms=50.0).whole) == said((2.5, RUBS))
    found = said((2.5, RUBS), persistence=still)
    assert found.verdict == UNKNOWN and "keep their first value instead, 2." in found.evidence
    assert said((2.5, RUBS), gap=1000.0).verdict == NAMED
    assert said((2.5, RUBS), gap=1000.0, persistence=still).verdict == UNKNOWN
    assert said((0.0, RUBS), gap=1000.0, persistence=still).verdict == NAMED
