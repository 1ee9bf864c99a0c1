# SPDX-License-Identifier: Apache-2.0
"""Each rule alone takes the name away, and the sentence says which."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import decide
from loco_learning.gap.verdict.candidates import Candidate, Estimate, Rival
from loco_learning.gap.verdict.decide import AMBIGUOUS, MORE, NAMED, NO_GAP, UNKNOWN
from loco_sim.effects import EFFECTS

STRONG = evidence.Comparison(80.0, 50.0, 110.0, 0.95, 1e6, 30)
CLOSE = dataclasses.replace(STRONG, gain=1.0, low=-3.0, high=5.0, odds=2.0)
FRICTION = Estimate("coulomb", 0.4, 0.35, 0.45, "N·m", least=0.0, most=5.0, sign=1)
GOOD = Candidate("friction", "knee", (FRICTION,), STRONG, 0.9, (Rival("backlash", "knee", STRONG),))


def score(size: float) -> evidence.Score:
    rng = np.random.default_rng(0)
    return evidence.score([size * rng.normal(size=(800, 2))])


BEFORE, AFTER = score(10.0), score(1.0)
LIMITS = decide.LIMITS


def verdict(*candidates: Candidate, after=AFTER, before=BEFORE) -> decide.Decision:
    return decide.decide(candidates, before, after)


def test_all_rules_kept_gives_the_name():
    found = verdict(GOOD)
    assert found.verdict == NAMED
    assert found.names == ("friction",)
    assert found.alarms == ()
    assert "backlash" in found.rulings[0].evidence
    assert "friction" in found.evidence


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"gain": dataclasses.replace(STRONG, low=-1.0)}, "chance"),
        ({"gain": dataclasses.replace(STRONG, blocks_improved=0.6)}, "blocks"),
        ({"closed": 0.1}, "closes only"),
        ({"estimates": (dataclasses.replace(FRICTION, low=-0.1),)}, "absent"),
        ({"estimates": (dataclasses.replace(FRICTION, value=5.0),)}, "bound"),
        ({"estimates": (dataclasses.replace(FRICTION, value=-0.4, least=-9),)}, "not physical"),
        ({"estimates": (dataclasses.replace(FRICTION, low=-9.0, high=np.inf),)}, "no interval"),
        ({"estimates": (dataclasses.replace(FRICTION, spread=0.2),)}, "parts of the data"),
    ],
)
def test_each_rule_alone_takes_the_name_away(change, word):
    found = verdict(dataclasses.replace(GOOD, **change))
    assert found.verdict == UNKNOWN
    assert found.names == ()
    assert word in found.rulings[0].evidence


def test_a_rival_within_the_odds_makes_it_ambiguous():
    rivals = (Rival("backlash", "knee", CLOSE), Rival("delay", "", STRONG))
    found = verdict(dataclasses.replace(GOOD, rivals=rivals))
    assert found.verdict == AMBIGUOUS
    assert found.ambiguous == (("backlash", "friction"),)
    assert found.rulings[0].odds == 2.0
    assert found.names == ()


def test_the_same_name_elsewhere_is_a_question_of_place():
    found = verdict(dataclasses.replace(GOOD, rivals=(Rival("friction", "hip", CLOSE),)))
    assert found.verdict == NAMED
    assert found.rulings[0].places == ("hip",)
    assert "hip" in found.rulings[0].evidence


def test_data_at_the_floor_have_no_gap_whatever_was_fitted():
    found = verdict(GOOD, before=AFTER)
    assert (found.verdict, found.names) == (NO_GAP, ())


def test_one_channel_of_many_is_a_gap():
    rng = np.random.default_rng(1)
    r = rng.normal(size=(800, 20))
    assert not decide.has_gap([r])
    r[:, 7] *= 1.5
    assert decide.has_gap([r])


def test_noise_alone_is_rarely_a_gap():
    rng = np.random.default_rng(2)
    hits = [decide.has_gap([1.05 * rng.normal(size=(500, 8))]) for _ in range(60)]
    assert np.mean(hits) <= 0.05


def test_a_short_gap_is_one():
    r = np.random.default_rng(3).normal(size=(400, 1))
    r[50:60] += 30.0
    assert decide.has_gap([r])


def test_a_small_gap_that_a_trifle_explains_is_none():
    slight = score(2.0)
    trifle = dataclasses.replace(GOOD, trifle=True)
    assert verdict(trifle, before=slight).verdict == NO_GAP
    assert verdict(trifle).verdict == NAMED
    rival = Rival("delay", "", CLOSE, trifle=True)
    assert verdict(dataclasses.replace(GOOD, rivals=(rival,)), before=slight).verdict == NO_GAP
    weak = dataclasses.replace(rival, over=STRONG)
    assert verdict(dataclasses.replace(GOOD, rivals=(weak,)), before=slight).verdict == NAMED


def test_what_explains_only_a_part_gets_no_verdict_by_name():
    found = verdict(GOOD, after=score(6.0))
    assert found.verdict == UNKNOWN
    assert not found.adequate
    assert found.rulings[0].verdict == NAMED
    assert "part" in found.evidence


def test_nothing_selected_is_unknown():
    assert verdict(after=BEFORE).verdict == UNKNOWN


def test_two_effects_one_of_them_in_doubt():
    doubt = dataclasses.replace(GOOD, name="delay", rivals=(Rival("lag", "", CLOSE),))
    found = verdict(GOOD, doubt)
    assert found.verdict == AMBIGUOUS
    assert found.names == ("friction",)
    assert found.ambiguous == (("delay", "lag"),)


def test_negative_damping_raises_an_alarm():
    damping = Estimate("damping", -0.2, -0.3, -0.1, "N·m·s/rad", sign=1)
    (alarm,) = decide.alarms(dataclasses.replace(GOOD, estimates=(damping,)))
    assert "damping = -0.2 N·m·s/rad is negative" in alarm
    assert verdict(dataclasses.replace(GOOD, estimates=(damping,))).alarms == (alarm,)


def test_shapes_need_not_exclude_zero_and_zero_is_no_bound():
    shape = Estimate("speed", 0.1, -0.1, 0.3, absent=None)
    other = Estimate("viscous", 0.0, -0.01, 0.01, least=0.0, most=1.0)
    found = verdict(dataclasses.replace(GOOD, estimates=(FRICTION, shape, other)))
    assert found.verdict == NAMED


def test_what_acts_in_a_few_blocks_is_no_chance_where_much_more_is_left_without_it():
    rare = dataclasses.replace(GOOD, gain=dataclasses.replace(GOOD.gain, low=-1.0))
    assert verdict(rare).verdict == UNKNOWN
    assert verdict(dataclasses.replace(rare, worse=3.1)).verdict == NAMED


def test_what_leaves_three_times_as_much_is_no_rival_however_few_the_blocks():
    for worse, wanted in ((2.9, AMBIGUOUS), (3.1, NAMED)):
        rival = Rival("backlash", "knee", CLOSE, worse=worse)
        assert verdict(dataclasses.replace(GOOD, rivals=(rival,))).verdict == wanted


def test_an_effect_that_strains_nominal_values_is_not_told_from_them():
    found = verdict(dataclasses.replace(GOOD, traded=("drives.knee.gain",)))
    assert found.verdict == AMBIGUOUS and found.ambiguous == (("drives.knee.gain", "friction"),)
    assert "drives.knee.gain cannot be excluded" in found.rulings[0].evidence


def test_what_explains_nothing_is_no_rival_however_few_the_blocks():
    idle = Rival("hose", "knee", CLOSE, closed=0.1)
    assert verdict(dataclasses.replace(GOOD, rivals=(idle,))).verdict == NAMED
    near = dataclasses.replace(idle, closed=0.9)
    assert verdict(dataclasses.replace(GOOD, rivals=(near,))).verdict == AMBIGUOUS


def test_a_law_on_the_bound_of_its_shape_is_no_rival():
    for edge, wanted in ((True, NAMED), (False, AMBIGUOUS)):
        rival = Rival("hose", "knee", CLOSE, closed=0.9, edge=edge)
        assert verdict(dataclasses.replace(GOOD, rivals=(rival,))).verdict == wanted


def test_what_needs_an_effect_beside_it_that_is_not_established_gets_no_name():
    shaky = dataclasses.replace(GOOD, name="offset", closed=0.1)
    assert verdict(GOOD, dataclasses.replace(GOOD, name="spring")).verdict == NAMED
    found = verdict(GOOD, shaky)
    assert (found.verdict, found.names, found.adequate) == (UNKNOWN, (), True)
    assert "only beside offset" in found.evidence
    poor = verdict(GOOD, shaky, after=score(9.0))
    assert poor.verdict == UNKNOWN and "close part of it" in poor.evidence


@pytest.mark.parametrize(
    ("name", "twin"),
    [(name, twin) for name, cls in EFFECTS.items() for twin in cls.identity.twins],
)
def test_a_late_command_and_late_sensors_are_told_together(name, twin):
    found = verdict(dataclasses.replace(GOOD, name=name, place=""))
    assert (found.verdict, found.names) == (AMBIGUOUS, ())
    assert found.ambiguous == (tuple(sorted((name, twin))),)
    assert found.rulings[0].odds == 1.0
    assert f"; {twin} cannot be excluded." in found.rulings[0].evidence


def test_late_sensors_of_one_signal_are_told_from_a_late_command():
    rival = Rival("command_delay", "", STRONG)
    late = dataclasses.replace(GOOD, name="sensor_latency", place="", rivals=(rival,))
    assert verdict(late).verdict == NAMED


def test_what_closes_most_of_the_gap_is_named_while_more_is_missing():
    found = verdict(GOOD, after=score(4.0))
    assert (found.verdict, found.names, found.adequate) == (MORE, ("friction",), False)
    assert "(61% closed); more is missing: 3.96 are left where most is" in found.evidence
    assert verdict(GOOD, after=score(6.0)).verdict == UNKNOWN  # too little of it
    unsure = dataclasses.replace(GOOD, rivals=(Rival("backlash", "knee", CLOSE),))
    assert verdict(unsure, after=score(4.0)).verdict == AMBIGUOUS
    weak = dataclasses.replace(GOOD, closed=0.1)
    assert verdict(GOOD, weak, after=score(4.0)).verdict == UNKNOWN


def test_noise_in_a_small_gap_takes_no_name_away():
    """A channel of one record is a little above its floor, 1.4 floors fell to 1.0 in all."""
    rng = np.random.default_rng(1)
    noise = rng.normal(size=(2, 800, 2))
    sizes = np.array([[1.1, 1.9], [1.2, 3.6]]), np.array([[1.0, 1.0], [1.0, 1.5]])
    old, new = ([part * size for part, size in zip(noise, each, strict=True)] for each in sizes)
    scores = [evidence.score(each[:1]) for each in (old, new)]
    found = decide.decide([GOOD], *scores, whole=(old, new))
    assert evidence.rms(new[:1]) > 0.5 * evidence.rms(old[:1])
    assert (found.verdict, found.adequate) == (MORE, False)


def test_a_value_that_is_known_only_together_with_others_says_so():
    cable = dataclasses.replace(FRICTION, low=-9.0, high=9.0, with_shapes=0.02)
    found = verdict(dataclasses.replace(GOOD, estimates=(cable,)))
    assert found.verdict == NAMED
    assert "together with its other values: 0.4 ± 0.02 N·m" in found.rulings[0].evidence
    assert "together" not in verdict(GOOD).rulings[0].evidence


def test_quiet_channels_do_not_make_a_loud_one_a_trifle():
    noise = np.random.default_rng(2).normal(size=(800, 12))
    trifle = dataclasses.replace(GOOD, trifle=True)
    for size, said in ((2.5, NO_GAP), (5.0, NAMED)):
        before = evidence.score([noise * np.r_[size, np.ones(11)]])
        assert verdict(trifle, before=before, after=evidence.score([noise])).verdict == said


def lacking(**change) -> list[str]:
    return decide.lacks(dataclasses.replace(GOOD, **change))


def test_exactly_at_a_limit_a_candidate_is_considered():
    even = dataclasses.replace(STRONG, blocks_improved=LIMITS.blocks)
    assert lacking(gain=even, closed=LIMITS.closed) == []
    assert lacking(gain=dataclasses.replace(even, blocks_improved=LIMITS.blocks - 0.01))
    assert lacking(closed=LIMITS.closed - 0.01)


@pytest.mark.parametrize(
    ("gain", "low", "total", "worse", "fine"),
    [
        (80.0, 0.1, None, 1.0, True),  # the interval alone
        (80.0, 0.0, None, 1.0, False),  # an interval that reaches nothing
        (0.5, -1.0, 0.1, 1.0, True),  # all data say so, and those that judge agree
        (0.5, -1.0, 0.0, 1.0, False),
        (0.5, -1.0, -5.0, LIMITS.worse + 0.1, True),  # or much more is left without it
        (0.5, -1.0, -5.0, LIMITS.worse, False),
        (0.0, -1.0, 9.0, 9.0, False),  # but never against those that judge
        (-0.5, -1.0, 9.0, 9.0, False),
    ],
)
def test_what_is_no_chance(gain, low, total, worse, fine):
    over = dataclasses.replace(STRONG, gain=gain, low=low)
    whole = None if total is None else dataclasses.replace(STRONG, low=total)
    found = lacking(gain=over, total=whole, worse=worse)
    assert found == ([] if fine else [f"the gain of {gain:.3g} nat may be chance (from {low:.3g})"])


def test_rivals_at_a_limit_are_taken_seriously():
    at = Rival("backlash", "knee", CLOSE, closed=LIMITS.closed, worse=LIMITS.worse)
    close = dataclasses.replace(at, over=dataclasses.replace(CLOSE, odds=LIMITS.odds))
    assert decide.serious(dataclasses.replace(GOOD, rivals=(at,)), LIMITS) == (at,)
    assert verdict(dataclasses.replace(GOOD, rivals=(close,))).verdict == AMBIGUOUS
    surer = dataclasses.replace(close, over=dataclasses.replace(CLOSE, odds=LIMITS.odds + 0.1))
    assert verdict(dataclasses.replace(GOOD, rivals=(surer,))).verdict == NAMED
    for weak in ({"closed": LIMITS.closed - 0.01}, {"worse": LIMITS.worse + 0.01}):
        rival = dataclasses.replace(at, **weak)
        assert decide.serious(dataclasses.replace(GOOD, rivals=(rival,)), LIMITS) == ()


@pytest.mark.parametrize(
    ("sign", "value", "word"), [(1, -0.4, "negative"), (-1, 0.4, "positive"), (0, -0.4, None)]
)
def test_a_sign_that_physics_forbids_is_said(sign, value, word):
    e = Estimate("size", value, value - 0.1, value + 0.1, "N", sign=sign)
    found = decide.alarms(dataclasses.replace(GOOD, estimates=(e,)))
    said = (f"friction knee: size = {value} N is {word}, which is not physical",) if word else ()
    assert found == said


def test_a_spread_is_weighed_against_the_way_from_where_the_effect_is_absent():
    """A gain of 1.1 is 0.1 away from none: parts of the data that differ by 0.05 differ by half."""
    gain = Estimate("gain", 1.1, 1.05, 1.15, absent=1.0, spread=0.05)
    (alarm,) = decide.alarms(dataclasses.replace(GOOD, estimates=(gain,)))
    assert alarm == "friction knee: gain = 1.1 differs by 0.05 between parts of the data"
    near = dataclasses.replace(gain, absent=0.0)
    shape = dataclasses.replace(gain, absent=None)
    assert decide.alarms(dataclasses.replace(GOOD, estimates=(near, shape))) == ()


@pytest.mark.parametrize(("unit", "told"), [("N·m", 0), ("rad", 1)])
def test_a_part_near_nothing_is_weighed_against_the_whole_vector(unit, told):
    """The cosine of a ripple that is a sine; but what has another unit is no part of it."""
    sine = Estimate("sine", 0.05, 0.049, 0.051, "N·m")
    cosine = Estimate("cosine", -7e-5, -2e-4, 1e-4, unit, spread=1.6e-4)
    assert len(decide.alarms(dataclasses.replace(GOOD, estimates=(sine, cosine)))) == told


def test_a_strength_must_be_known_and_a_shape_or_a_second_one_need_not():
    open_end = dataclasses.replace(FRICTION, low=-9.0, high=np.inf)
    shape = Estimate("speed", 0.1, -np.inf, np.inf, absent=None)
    known = dataclasses.replace(FRICTION, name="other")
    for estimates, count in (((open_end, shape), 2), ((open_end, known), 0), ((known, shape), 0)):
        told = decide.alarms(dataclasses.replace(GOOD, estimates=estimates))
        assert sum("no interval" in alarm for alarm in told) == count


def test_places_are_those_of_the_same_effect_elsewhere():
    rivals = (Rival("friction", "knee", CLOSE), Rival("friction", "hip", CLOSE),
              Rival("backlash", "ankle", STRONG))  # fmt: skip
    assert verdict(dataclasses.replace(GOOD, rivals=rivals)).rulings[0].places == ("hip",)


def test_data_that_judged_are_told_by_their_name_and_rivals_from_the_nearest_on():
    far = dataclasses.replace(STRONG, odds=5e3)
    rivals = (Rival("delay", "", STRONG), Rival("backlash", "knee", far))
    text = verdict(dataclasses.replace(GOOD, rivals=rivals)).rulings[0].evidence
    assert text.startswith("Without friction knee the held-out likelihood falls by 80 nat")
    assert "odds 5e+03 to 1 against the next name, backlash" in text
    elsewhere = verdict(dataclasses.replace(GOOD, elsewhere=True)).rulings[0].evidence
    assert elsewhere.startswith("Without friction knee the likelihood of all records falls")


def test_a_gap_that_is_none_or_a_trifle_leaves_a_model_that_explains_the_data():
    assert verdict(GOOD, before=AFTER).adequate
    slight = verdict(dataclasses.replace(GOOD, trifle=True), before=score(2.0))
    assert slight.verdict == NO_GAP and slight.adequate


@pytest.mark.parametrize(("before", "after"), [(61.0, 132.0), (61.0, 61.0), (2.0, 3.0)])
def test_a_try_that_is_no_better_is_no_answer(before, after):
    said = decide._summary(UNKNOWN, (), after, before, after, 0.0)
    assert f"{after:.3g}" not in said.replace(f"{before:.3g}", "") and "or lowers it" in said


def test_a_try_that_is_better_is_told():
    assert "the best try leaves 12" in decide._summary(UNKNOWN, (), 12.0, 61.0, 12.0, 0.8)


@pytest.mark.parametrize(
    ("low", "high", "known"),
    [(2.0, math.inf, True), (0.0, math.inf, False), (-math.inf, math.inf, False),
     (-math.inf, -1.0, True)],
)  # fmt: skip
def test_a_strength_without_one_end_has_a_size_where_nothing_is_outside(low, high, known):
    """A stop that is harder than can be seen was unknown at 94 % closed."""
    value = 5.0 if low > -math.inf or high > 0.0 else -5.0
    stop = Estimate("stiffness", value, low, high, "N·m/rad")
    lines = decide.alarms(dataclasses.replace(GOOD, name="end_stop", estimates=(stop,)))
    assert any("has no interval" in line for line in lines) is not known
    assert stop.excludes_absent is known
