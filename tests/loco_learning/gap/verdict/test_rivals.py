# SPDX-License-Identifier: Apache-2.0
"""Prices, trifles, intervals and plain values: the parts of judging that need no simulation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.fitting.screen import Screened
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import rivals, sensitivity
from loco_learning.gap.verdict.decide import LIMITS
from loco_sim.effects import EFFECTS, offers
from loco_sim.effects.coordinates import Coordinate

TORQUE = Coordinate("torque", 0.05, (1.0,), 0.0, 10.0, "N·m", strength=True)
DELAY = Coordinate("delay", 0.02, (1.0,), 0.0, 1.0, "s", strength=True)
SPEED = Coordinate("velocity", 0.1, (0.0,), 0.001, 10.0, "rad/s", logarithmic=True)


def hypothesis(effect: str, *coordinates: Coordinate, place: str = "knee") -> Hypothesis:
    return Hypothesis(effect, place, (("joint", place),), coordinates)


COULOMB = hypothesis("coulomb_friction", TORQUE)
STRIBECK = hypothesis("stribeck_friction", TORQUE, SPEED)
COMMAND_DELAY = hypothesis("command_delay", DELAY)


def fitted(h: Hypothesis, shape: float = 0.0) -> Fitted:
    r = np.random.default_rng(0).normal(size=(500, 2))
    x = (1.0, shape)[: len(h.coordinates)]
    return Fitted(((h, x),), {}, 1.0, evidence.score([r]), (r,), 0.0)


def leaves(*records: np.ndarray | float, judges: float = 1.0) -> Fitted:
    """A model that leaves so many floors of noise in each record, and in the data that judge."""
    rng = np.random.default_rng(1)
    whole = tuple(size * rng.normal(size=(800, 2)) for size in records)
    held = evidence.score([judges * rng.normal(size=(800, 2))])
    return Fitted((), {}, 1.0, held, whole, 0.0)


@pytest.mark.parametrize(
    ("law", "x", "edge"),
    [
        (STRIBECK, (1.0, 0.0), False),
        (STRIBECK, (1.0, SPEED.inverse(10.0)), True),
        (STRIBECK, (1.0, SPEED.inverse(9.95)), True),  # less than a hundredth below
        (STRIBECK, (1.0, 99.0), True),  # values are forced into their bounds
        (STRIBECK, (1.0, SPEED.inverse(0.001)), True),
        (STRIBECK, (0.0, 0.0), False),  # a strength of nothing is no shape
        (COULOMB, (0.0,), False),
        (COMMAND_DELAY, (50.0,), False),
    ],
)
def test_a_shape_on_its_bound_makes_another_law(law, x, edge):
    assert rivals.on_edge(law, x, 0.01) is edge


def test_a_parameter_more_costs_and_one_less_pays():
    simple, rich = fitted(COULOMB), fitted(STRIBECK)
    assert rivals.occam(simple, simple) == 0.0
    assert rivals.occam(rich, simple) == pytest.approx(-rivals.occam(simple, rich))
    assert rivals.occam(rich, simple) == pytest.approx(0.5 * np.log(1000.0), rel=0.1)


def test_a_shape_that_no_robot_has_costs_as_its_prior_says():
    usual, odd = fitted(STRIBECK), fitted(STRIBECK, 2.1)
    assert rivals.occam(odd, usual) == pytest.approx(0.5 * (2.1 / 0.7) ** 2)
    assert rivals.occam(fitted(STRIBECK, 70.0), usual) == pytest.approx(np.log(rivals.MOST_PRICE))


def test_a_trifle_is_told_only_where_sizes_compare():
    assert rivals.trifle(COMMAND_DELAY, [0.01])
    assert not rivals.trifle(COMMAND_DELAY, [0.5])
    assert not rivals.trifle(COULOMB, [1e-9])


def test_a_length_is_no_trifle_but_on_a_joint_that_turns():
    """A quarter of a millimetre is five floors of a slide's encoder (battery 10606: 76)."""
    zero = Coordinate("q", 1e-3, (1.0,), -0.1, 0.1, "rad", strength=True)
    law = hypothesis("sensor_bias", zero)
    assert rivals.trifle(law, [0.26]) and rivals.trifle(law, [0.26], {"another"})
    assert not rivals.trifle(law, [0.26], {law.place})
    family = replace(law, place="*_joint", joints=("a_joint", "b_joint"))
    assert not rivals.trifle(family, [0.26], {"b_joint"})


STRENGTHS = [(name, key) for name, cls in EFFECTS.items() for key in cls.identity.strengths]


@pytest.mark.parametrize(("name", "key"), STRENGTHS)
def test_a_trifle_is_far_below_what_any_robot_has(name, key):
    size = replace(offers.coordinate(EFFECTS[name], key), size=1.0, logarithmic=False)
    prior = EFFECTS[name].identity.priors[key]
    law, compares = hypothesis(name, size), size.unit in rivals.COMPARABLE
    assert not rivals.trifle(law, [prior.high])
    for small in (0.0, 0.01 * (prior.low if prior.low > 0.0 else prior.high)):
        assert rivals.trifle(law, [small]) is compares and rivals.trifle(law, [-small]) is compares


def test_one_strength_that_matters_is_no_trifle_whatever_the_others_and_the_shapes():
    tilt = [Coordinate(a, 1.0, (1.0,), -1.0, 1.0, "rad", strength=True) for a in ("roll", "pitch")]
    law = hypothesis("imu_tilt", *tilt, SPEED)
    assert rivals.trifle(law, [1e-6, 1e-6, 1.0])
    assert not rivals.trifle(law, [1e-6, 0.2, 1.0]) and not rivals.trifle(law, [0.2, 1e-6, 1.0])


@pytest.mark.parametrize(
    ("records", "judges", "wanted"),
    [((1.0, 3.0), 1.0, True), ((1.0, 3.0), 3.0, False), ((1.0, 1.0), 1.0, False),
     ((1.0, 1.0), 3.0, False)],
)  # fmt: skip
def test_a_gap_is_elsewhere_where_only_data_that_do_not_judge_have_it(records, judges, wanted):
    assert rivals.elsewhere(leaves(*records, judges=judges)) is wanted


def test_a_model_that_leaves_noise_alone_has_no_rival_that_leaves_twice_as_much():
    assert rivals.sharp(LIMITS, leaves(1.0)).worse == rivals.NO_RIVAL < LIMITS.worse
    assert rivals.sharp(LIMITS, leaves(2.0)) == LIMITS
    strict = LIMITS.replace(worse=1.2)
    assert rivals.sharp(strict, leaves(1.0)) == strict


def test_a_model_is_worse_on_all_data_only_where_it_judges_no_better():
    good, bad = leaves(1.0, judges=1.0), leaves(3.0, judges=2.0)
    assert rivals.ratio(bad, good) == pytest.approx(3.0, rel=0.05)
    assert rivals.ratio(good, bad) == pytest.approx(1.0 / 3.0, rel=0.05)
    judged_well = leaves(3.0, 3.0, judges=2.0)
    assert rivals.ratio(judged_well, leaves(1.0, judges=2.5)) == 1.0
    only_elsewhere = leaves(3.0, judges=0.9)
    assert rivals.ratio(only_elsewhere, good) == pytest.approx(3.0, rel=0.05)


def test_a_price_is_taken_from_the_gain_and_from_both_ends():
    over = evidence.Comparison(10.0, 4.0, 16.0, 0.9, 50.0, 12)
    less = rivals.paid(over, 3.0)
    assert (less.gain, less.low, less.high) == (7.0, 1.0, 13.0)
    assert (less.odds, less.blocks) == (over.odds, over.blocks)


def test_of_each_other_effect_the_best_is_tried_look_alikes_first():
    alike = EFFECTS["coulomb_friction"].identity.look_alikes[0].name
    hip = hypothesis(alike, TORQUE, place="hip")
    screened = [
        Screened(COULOMB, 0.9, (1.0,)),  # itself
        Screened(COMMAND_DELAY, 0.8, (1.0,)),
        Screened(hypothesis(alike, TORQUE), 0.2, (1.0,)),
        Screened(hip, 0.3, (1.0,)),
        Screened(hypothesis("armature", TORQUE), 0.7, (1.0,), dead=True),
        Screened(hypothesis("payload", TORQUE), 0.0, (1.0,)),
        Screened(hypothesis("cable_force", TORQUE), -0.1, (1.0,)),
    ]
    found = rivals.leading(screened, COULOMB)
    assert [s.hypothesis for s in found] == [hip, COMMAND_DELAY]
    assert rivals.leading(screened[::-1], COULOMB) == found


def test_a_few_names_and_a_few_places_are_weighed_the_best_of_each():
    beside = hypothesis("payload", TORQUE, place="foot")

    def model(law: Hypothesis) -> Fitted:
        return replace(fitted(law), parts=((beside, (1.0,)), (law, (1.0,))))

    names = [hypothesis(n, TORQUE, place=p) for n in "abcdefg" for p in ("knee", "hip")]
    places = [hypothesis("mine", TORQUE, place=p) for p in ("hip", "ankle", "hip", "toe")]
    models = [model(law) for law in (*places, *names)]
    kept = rivals.few(models, hypothesis("mine", TORQUE), [beside.key])
    laws = [m.parts[1][0] for m in kept]
    assert laws == [*places[:2], *names[: 2 * rivals.RIVAL_NAMES : 2]]
    assert len(places[:2]) == rivals.RIVAL_PLACES


def test_intervals_are_in_the_unit_and_may_pass_zero():
    strength, shape = sensitivity.estimates(
        STRIBECK, [1.0, 0.0], np.array([2.0, 0.98]), np.array([0.2, 0.2]), np.array([2.0, np.nan])
    )
    assert strength.value == pytest.approx(0.05)
    assert strength.low == pytest.approx(0.05 - 2.0 * 0.05)
    assert not strength.excludes_absent
    surer, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], np.array([0.5, 0.98]), *np.zeros((2, 2)))
    assert surer.low == pytest.approx(0.5 * 0.05) and surer.excludes_absent
    assert (strength.absent, strength.sign) == (0.0, 1)
    assert strength.spread == pytest.approx(0.01)
    assert shape.absent is None
    assert shape.low == pytest.approx(0.1 * np.exp(-0.98))
    wide = np.array([np.inf, 1.0])
    unknown, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), wide)
    assert (unknown.low, unknown.high) == (-np.inf, np.inf) and not unknown.excludes_absent


def test_an_effect_of_which_size_and_shape_show_together_is_there():
    """A cable's stiffness and free length may show as one force: neither is known by itself."""
    wide, sure = np.array([9.0, 9.0]), np.array([0.1, np.nan])
    strength, shape = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), sure)
    assert strength.low < 0.0 < strength.high
    assert strength.excludes_absent and not shape.excludes_absent


def test_halves_follow_flat():
    whole = [np.zeros((4, 2)), np.zeros((2, 2))]
    assert sensitivity.halves(whole).tolist() == [0] * 4 + [1] * 4 + [2] * 2 + [3] * 2
