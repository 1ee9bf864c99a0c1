# SPDX-License-Identifier: Apache-2.0
"""Where a model does not stand, what is established in it, or a rival that cannot be excluded."""

from types import SimpleNamespace as Some

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.fitting.screen import Screened
from loco_learning.gap.hypotheses.families import families
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import judge
from loco_learning.gap.verdict.candidates import Estimate
from loco_learning.gap.verdict.decide import LIMITS, NAMED, UNKNOWN
from loco_sim.effects.coordinates import Coordinate


class Judgement(judge._Judgement):
    """Models are tuples of effects; a verdict is given for each, unknown for all others.

    Or verdicts of its effects, of which one at least is not established.
    """

    def __init__(self, **named):
        self.named = {tuple(key): verdict for key, verdict in named.items()}
        self.judged = []

    def _judged(self, best, limits):
        self.judged.append(best)
        given = self.named.get(tuple(getattr(best, "key", best)), ())
        if isinstance(given, tuple):
            return Some(decision=weighed(*given).decision, best=best)
        return Some(decision=Some(verdict=given), best=best)

    def _finished(self, models):
        return list(models)

    def _without(self, best, index):
        return best[:index] + best[index + 1 :]


def weighed(*verdicts):
    """A model of effects a, b, c ... of which each has its own verdict."""
    rulings = tuple(Some(verdict=v) for v in verdicts)
    return Some(decision=Some(verdict=UNKNOWN, rulings=rulings), best=tuple("abc"[: len(rulings)]))


@pytest.mark.parametrize(
    ("verdicts", "left"),
    [((NAMED, UNKNOWN, UNKNOWN), "a"), ((UNKNOWN, NAMED, UNKNOWN), "b"),
     ((NAMED, UNKNOWN, NAMED), "ac")],
)  # fmt: skip
def test_what_is_established_stands_without_the_rest(verdicts, left):
    found = Judgement(**{left: NAMED})._established(weighed(*verdicts), LIMITS)
    assert found.best == tuple(left) and found.decision.verdict == NAMED


@pytest.mark.parametrize(("last", "left"), [(NAMED, "a"), ((UNKNOWN,), "abc")])
def test_what_is_not_established_without_the_rest_goes_as_well(last, left):
    judging = Judgement(ab=(NAMED, UNKNOWN), a=last)
    found = judging._established(weighed(NAMED, NAMED, UNKNOWN), LIMITS)
    assert found.best == tuple(left)
    assert judging.judged == [tuple("ab"), tuple("a")]


def test_what_does_not_stand_without_the_rest_stays_unknown():
    before = weighed(NAMED, UNKNOWN)
    assert Judgement()._established(before, LIMITS) is before


@pytest.mark.parametrize("verdicts", [(UNKNOWN, UNKNOWN), (NAMED, NAMED), (UNKNOWN,)])
def test_where_all_or_nothing_is_established_nothing_is_left_out(verdicts):
    judging, before = Judgement(a=NAMED, b=NAMED), weighed(*verdicts)
    assert judging._established(before, LIMITS) is before and not judging.judged


@pytest.mark.parametrize(
    ("sizes", "left"),
    [((0.0, 2.0, 0.0), "knee"), ((2.0, 0.0, 3.0), "hip ankle"), ((1.0, 2.0, 3.0), None),
     ((0.0, 0.0, 0.0), None), ((0.2, 0.2, 0.2), None)],
)  # fmt: skip
def test_a_law_in_several_joints_stays_where_it_is_more_than_nothing(sizes, left):
    """Nothing is an interval about 0 that ends at little beside the largest size."""
    joints = ("hip", "knee", "ankle")
    size = Coordinate("torque", 1.0, (1.0,), 0.0, 10.0, strength=True)
    offered = [Hypothesis("coulomb_friction", j, (("joint", j),), (size,)) for j in joints]
    screened = [Screened(h, 0.2, (1.0,)) for h in offered]
    ((family, _),) = families(screened, joints)
    beside = Hypothesis("push", "trunk", (), (size,)), (1.0,)
    best = Some(parts=((family, sizes), beside))
    known = {
        h.key: [
            Estimate(c.label, x, x - 0.1, x + 0.1) for c, x in zip(h.coordinates, at, strict=True)
        ]
        for h, at in best.parts
    }
    judging = Judgement()
    judging.search = Some(
        hypotheses=offered, joints=joints, setting=None,
        each=lambda function, arguments: [Some(parts=parts) for parts, _ in arguments],
    )  # fmt: skip
    found = judging._narrowed(best, known)
    if left is None:
        assert found is None
        return
    (law, at), other = found.parts
    assert (law.place, other) == (left, beside)
    assert at == tuple(x for x in sizes if x)


@pytest.mark.parametrize(
    ("effects", "adequate", "rivals"),
    [(2, False, ["sensor_gain + push"]), (2, True, []), (1, False, [])],
)
def test_what_does_most_beside_the_others_is_a_rival_where_a_gap_is_left(effects, adequate, rivals):
    """A stiffness in two joints was named for a gain that did less beside it."""
    size = Coordinate("size", 1.0, (1.0,), 0.0, 10.0, strength=True)
    stiff, push, gain = (
        Hypothesis(name, "knee", (), (size,)) for name in ("added_stiffness", "push", "sensor_gain")
    )
    best, asked = Some(parts=((stiff, (1.0,)), (push, (1.0,)))[:effects]), []

    def beside(model, before):
        asked.append(model)
        return [Screened(h, 0.5, (2.0,)) for h in (stiff, push, gain)]

    judging = Judgement()
    judging.about, judging.found = None, Some(models=[], screened=[])
    judging.search = Some(
        setting=None, adequate=lambda model: adequate, beside=beside, energy=lambda model: 1.0,
        fitted=lambda wanted: [
            Some(parts=parts, key=" + ".join(h.effect for h, _ in reversed(parts)))
            for parts in wanted
        ],
    )  # fmt: skip
    assert [m.key for m in judging._swaps(best, 0, "without it")] == rivals
    assert asked == ["without it"] * len(rivals)


def test_a_look_alike_is_tried_however_many_rivals_there_are():
    """A centre of mass was never weighed against an encoder's zero: four others were fitted."""
    size = Coordinate("size", 1.0, (1.0,), 0.0, 10.0, strength=True)

    def at_knee(name):
        return Hypothesis(name, "knee", (), (size,)), (1.0,)

    best = Some(parts=(at_knee("sensor_bias"),))
    others = ("payload", "backlash", "coulomb_friction", "actuator_lag", "slip")
    known = [Some(parts=(at_knee(name),), key=name) for name in others]
    judging, asked = Judgement(), []

    def fitted(wanted):
        asked.extend(parts[0][0].effect for parts in wanted)
        return [Some(parts=parts, key=parts[0][0].effect) for parts in wanted]

    screened = [Screened(at_knee(n)[0], 0.1, (1.0,)) for n in ("armature", "com_offset", *others)]
    judging.about, judging.found = None, Some(models=known, screened=screened)
    judging.search = Some(fitted=fitted, energy=lambda m: float(m.key != "com_offset"))
    assert judging._swaps(best, 0, None)[0].key == "com_offset" and asked == ["com_offset"]


def test_all_that_are_weighed_are_fitted_about_the_model_at_hand_and_keep_the_better_fit():
    asked = []

    def each(function, tasks):
        asked.extend((function, *task) for task in tasks)
        return [Some(energy=3.0) for _ in tasks]

    judging, models = Judgement(), [Some(parts="a", energy=1.0), Some(parts="b", energy=5.0)]
    judging.search = Some(setting="as set", energy=lambda model: model.energy, each=each)
    judging.about = None
    assert judging._anew(models) == models and not asked
    judging.about = [{"name": "armature"}]
    assert [m.energy for m in judging._anew(models)] == [1.0, 3.0]
    assert asked == [(judge.anew, part, "as set", judging.about) for part in "ab"]


@pytest.mark.parametrize(
    ("bends", "parts", "loose", "off"),
    [
        (True, "a", {"mass": 1.3}, True),
        (True, "a", {"mass": -1.3}, True),
        (True, "a", {"mass": 0.9}, False),  # a robot as its file says
        (True, "a", {}, False),
        (True, "", {"mass": 1.3}, False),  # straight lines are about the bare model
        (False, "a", {"mass": 9.0}, False),  # torques along a motion are linear
    ],
)
def test_lines_are_drawn_anew_where_a_robot_is_off_and_has_an_effect(bends, parts, loose, off):
    judging = Judgement()
    near = Some(deviations=lambda values: np.array([0.1, values["mass"]]))
    judging.case = Some(bends=bends, loose=near)
    assert judging._off(Some(parts=parts, loose=loose)) is off


@pytest.mark.parametrize(("low", "idle"), [(0.0, {"hip"}), (-10.0, set())])
def test_a_size_that_would_rather_be_below_nothing_is_none_though_it_has_no_interval(low, idle):
    """One that may have either sign and is not known may be there."""
    joints = ("hip", "knee")
    size = Coordinate("torque", 1.0, (1.0,), low, 10.0, strength=True)
    offered = [Hypothesis("coulomb_friction", j, (("joint", j),), (size,)) for j in joints]
    ((family, _),) = families([Screened(h, 0.2, (1.0,)) for h in offered], joints)
    wide = Estimate("torque hip", 0.0, -np.inf, np.inf), Estimate("torque knee", 2.0, 1.9, 2.1)
    assert judge._idle(family, wide) == idle


@pytest.mark.parametrize(
    ("low", "high", "idle"),
    [(0.2, 3.2, {"hip"}), (1.2, 2.2, set()), (-np.inf, np.inf, set()), (-6.0, 9.4, set()),
     (-0.5, 1.0, {"hip"})],
)  # fmt: skip
def test_a_small_size_whose_interval_nearly_reaches_nothing_may_be_left_out(low, high, idle):
    """Hysteresis of one knee was given to its hip as well, and neither was established."""
    joints = ("hip", "knee")
    size = Coordinate("torque", 1.0, (1.0,), -20.0, 20.0, strength=True)
    offered = [Hypothesis("coulomb_friction", j, (("joint", j),), (size,)) for j in joints]
    ((family, _),) = families([Screened(h, 0.2, (1.0,)) for h in offered], joints)
    middle = 0.5 * (low + high) if np.isfinite(low) else 1.7
    both = Estimate("torque hip", middle, low, high), Estimate("torque knee", 12.0, 11.0, 13.0)
    assert judge._idle(family, both) == idle


@pytest.fixture
def rivals(monkeypatch):
    """Rivals (key, odds against it, its rms over the best), and a judgement of them."""
    monkeypatch.setattr(judge, "ratio", lambda model, best: model.worse)
    monkeypatch.setattr(judge, "sharp", lambda limits, best: limits)

    def instead(rows, out=(), **named):
        pairs = [(Some(key=key, worse=worse), Some(odds=odds)) for key, odds, worse in rows]
        judging = Judgement(**named)
        before = Some(rivals=pairs, best="x")
        found = judging._instead(before, set(out), LIMITS)
        return None if found is before else found.best.key, [m.key for m in judging.judged]

    return instead


def test_the_first_rival_that_is_established_takes_the_place(rivals):
    rows = [("a", 1.0, 1.0), ("b", 2.0, 1.1), ("c", 3.0, 1.2)]
    assert rivals(rows, b=NAMED, c=NAMED) == ("b", ["a", "b"])
    assert rivals(rows[:2]) == (None, ["a", "b"])


def test_a_rival_that_is_excluded_or_was_imitated_takes_no_place(rivals):
    rows = [("a", 2.0 * LIMITS.odds, 1.0), ("b", 1.0, 2.0 * LIMITS.worse), ("c", 1.0, 1.0)]
    named = dict.fromkeys("abc", NAMED)
    assert rivals(rows, **named) == ("c", ["c"])
    assert rivals(rows, out="c", **named) == (None, [])


def test_only_a_few_rivals_are_tried(rivals):
    rows = [(key, 1.0, 1.0) for key in "abcdefghijkl"]
    found, tried = rivals(rows, l=NAMED)
    assert found is None and len(tried) == judge.INSTEAD


ROWS = 4000


def fitted(*effects, level, seed=7):
    """A model with effects that leaves noise, and a slow error so that its rms is `level`."""
    rng = np.random.default_rng(seed)
    slow = np.sin(np.arange(ROWS) / 9.0 + np.cumsum(rng.standard_normal(ROWS)) / 30.0)
    left = rng.standard_normal(ROWS) + np.sqrt(2.0 * (level**2 - 1.0)) * slow
    size = Coordinate("torque", 1.0, (1.0,), 0.0, 10.0, strength=True)
    parts = tuple((Hypothesis(name, "knee", (), (size,)), (1.0,)) for name in effects)
    score = evidence.score([left[:, None]])
    return Fitted(parts, {}, score.rms, score, (left[:, None],), 0.0)


@pytest.fixture
def weighing():
    """A judgement about a gap of so many floors, that gives models without one effect."""

    def make(gap, without=None, enough=1.0):
        judging = Judgement()
        base = fitted(level=gap)
        judging.found = Some(base=base, given=base, models=[base])
        judging.search = Some(energy=lambda m: m.held.rms, params=Some(finalists=4))
        judging.seed, judging.enough = 0, np.array([enough])
        judging._without = lambda best, index: without if len(best.parts) > 1 else base
        return judging

    return make


DRY, BOTH = ("coulomb_friction",), ("coulomb_friction", "viscous_friction")


@pytest.mark.parametrize(("gap", "left"), [(54.0, 5.0), (20.0, 1.6), (200.0, 3.0)])
def test_an_effect_without_which_more_than_noise_is_left_is_never_dropped(weighing, gap, left):
    """Dry friction alone, 1.75 times too large: most of a large gap was closed without viscous."""
    alone, both = fitted(*DRY, level=left), fitted(*BOTH, level=1.0)
    judging = weighing(gap, alone)
    assert judging.beats(both, alone, LIMITS)
    best, lost = judging._pruned(both, LIMITS)
    assert best is both and lost == [alone, alone]


@pytest.mark.parametrize("gap", [8.0, 54.0])
def test_an_effect_without_which_noise_alone_is_left_is_dropped(weighing, gap):
    alone, both = fitted(*DRY, level=1.02), fitted(*BOTH, level=1.0)
    assert weighing(gap, alone)._pruned(both, LIMITS)[0] is alone


def test_an_error_within_the_accuracy_that_was_asked_for_needs_no_effect_more(weighing):
    alone, both = fitted(*DRY, level=5.0), fitted(*BOTH, level=4.0)
    assert not weighing(54.0, enough=6.0).beats(both, alone, LIMITS)
    assert weighing(54.0, enough=2.0).beats(both, alone, LIMITS)


@pytest.mark.parametrize(("left", "needed"), [(2.0, True), (1.1, False)])
def test_where_odds_are_even_held_out_data_decide(weighing, monkeypatch, left, needed):
    """A joint of a family, or an effect: what is worse without it stays."""
    judging = weighing(54.0)
    monkeypatch.setattr(judging, "beats", lambda a, b, limits: False)
    alone, both = fitted(*DRY, level=left), fitted(*BOTH, level=1.0)
    assert judging._needs(both, alone, LIMITS) is needed
    assert not judging._needs(both, fitted(*DRY, level=1.0), LIMITS)
