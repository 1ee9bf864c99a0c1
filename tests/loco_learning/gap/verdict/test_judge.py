# SPDX-License-Identifier: Apache-2.0
"""What the most probable model is challenged with, and when a judgement ends."""

from types import SimpleNamespace as Some

import numpy as np
import pytest

from loco_learning.gap.fitting.screen import Screened
from loco_learning.gap.hypotheses.families import by_law
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.probability.weights import weigh
from loco_learning.gap.statistics.leftover import has_gap
from loco_learning.gap.verdict import judge
from loco_learning.gap.verdict.decide import (
    AMBIGUOUS,
    NAMED,
    NO_GAP,
    PARTLY,
    UNKNOWN,
    References,
    decide,
)
from loco_learning.gap.verdict.estimates import Estimate
from loco_sim.effects.coordinates import Coordinate

from ..probability.models import fitted


def judgement(**attributes):
    """A judgement of which only some attributes are known."""
    one = judge.Judgement.__new__(judge.Judgement)
    one.about, one.fits, one.converged, one.lost, one.known = None, {}, set(), {}, {}
    one.replaced = set()
    vars(one).update(attributes)
    return one


@pytest.mark.parametrize(
    ("sizes", "left"),
    [((0.0, 2.0, 0.0), "knee"), ((2.0, 0.0, 3.0), "hip ankle"), ((1.0, 2.0, 3.0), None),
     ((0.0, 0.0, 0.0), None), ((0.2, 0.2, 0.2), None)],
)  # fmt: skip
def test_a_law_in_several_joints_stays_where_it_is_more_than_nothing(sizes, left, monkeypatch):
    """Nothing is an interval about 0 that ends at little beside the largest size."""
    joints = ("hip", "knee", "ankle")
    size = Coordinate("torque", 1.0, (1.0,), 0.0, 10.0, strength=True)
    offered = [Hypothesis("coulomb_friction", j, (("joint", j),), (size,)) for j in joints]
    screened = [Screened(h, 0.2, (1.0,)) for h in offered]
    ((family, _),) = by_law(screened, joints)
    beside = Hypothesis("push", "trunk", (), (size,)), (1.0,)
    best = Some(parts=((family, sizes), beside), specs=[], overrides={}, key="best")
    known = {
        h.key: [
            Estimate(c.label, x, x - 0.1, x + 0.1) for c, x in zip(h.coordinates, at, strict=True)
        ]
        for h, at in best.parts
    }
    judging = judgement(case=Some(corrected=lambda specs, overrides: None))
    judging.search = Some(
        hypotheses=offered, joints=joints, setting=None,
        each=lambda function, arguments: [Some(parts=parts) for parts, _ in arguments],
    )  # fmt: skip
    monkeypatch.setattr(judge, "sensitivities", lambda case, model, wider: (known, None))
    found = judging._narrowed(best)
    if left is None:
        assert found == []
        return
    (law, at), other = found[0].parts
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

    judging = judgement()
    judging.found = Some(models=[], screened=[])
    judging.search = Some(
        setting=None, adequate=lambda model: adequate, beside=beside, energy=lambda model: 1.0,
        fitted=lambda wanted, rivals: [
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
    judging, asked = judgement(), []

    def fitted(wanted, rivals):
        asked.extend(parts[0][0].effect for parts in wanted)
        return [Some(parts=parts, key=parts[0][0].effect) for parts in wanted]

    screened = [Screened(at_knee(n)[0], 0.1, (1.0,)) for n in ("armature", "com_offset", *others)]
    judging.found = Some(models=known, screened=screened)
    judging.fits = {m.key: m for m in known}
    judging.search = Some(fitted=fitted, energy=lambda m: float(m.key != "com_offset"))
    assert judging._swaps(best, 0, None)[0].key == "com_offset" and asked == ["com_offset"]


@pytest.mark.parametrize(
    ("effects", "pairs"),
    [(["cable_force"], ["constant_force + sensor_bias"]), (["cable_force", "slope"], []),
     (["constant_force"], [])],
)  # fmt: skip
def test_two_effects_with_fewer_parameters_are_tried_in_place_of_one(effects, pairs):
    """A cable was named for a force and a bias, to which the search had added nothing."""
    counts = {"cable_force": 5, "constant_force": 3, "sensor_bias": 1, "slope": 2, "push": 2}

    def model(*names):
        size = Coordinate("size", 1.0, (1.0,), 0.0, 10.0, strength=True)
        parts = [(Hypothesis(n, "knee", (), (size,) * counts[n]), (1.0,)) for n in names]
        paid = sum(counts[n] for n in names)
        return Some(parts=parts, names=names, paid=paid, key=" + ".join(names))

    def beside(one, before):
        others = ("sensor_bias", "push", "cable_force", *one.names)
        return [Screened(model(n).parts[0][0], 0.5, (1.0,)) for n in others]

    judging = judgement(fits={n: model(n) for n in ("cable_force", "constant_force")})
    judging.found = Some(screened=[])
    judging.search = Some(beside=beside, energy=lambda m: 1.0, fitted=lambda wanted, _: wanted)
    tried = judging._pairs(model(*effects))
    assert [" + ".join(h.effect for h, _ in parts) for parts in tried] == pairs


@pytest.mark.parametrize(
    ("stroke", "rms", "asked"),
    [
        (0.0, 1.0, [["viscous_friction"], ["viscous_friction", "coulomb_friction"]]),
        (2.0, 1.0, []),  # a law of its own
        (0.0, 3.0, []),  # a better model is known
    ],
)
def test_what_the_best_model_equals_at_a_bound_is_fitted_once(stroke, rms, asked):
    """Hysteresis of no stroke took the place of dry friction, has no weight, and all was lost."""
    size = Coordinate("torque", 1.0, (1.0,), 0.0, 10.0, strength=True)
    shape = Coordinate("stroke", 1.0, (1.0,), 0.0, 10.0)
    law = Hypothesis("hysteresis", "knee", (), (size, shape))

    def at(name, place="knee"):
        return Hypothesis(name, place, (), (size,)), (1.0,)

    def model(parts, rms):
        return Some(parts=parts, key=" + ".join(h.key for h, _ in parts), rms=rms)

    tried = []

    def each(function, tasks):
        assert function is judge.fit
        tried.extend([h.effect for h, _ in parts] for parts, _ in tasks)
        return [model(parts, 1.1) for parts, _ in tasks]

    offered = [at("coulomb_friction"), at("coulomb_friction", "hip"), at("payload")]
    judging = judgement(_anew=list)
    judging.found = Some(screened=[Screened(h, 0.1, x) for h, x in offered])
    judging.search = Some(energy=lambda m: m.rms, each=each, setting=None)
    models = model([at("viscous_friction"), (law, (1.0, stroke))], rms), model([at("payload")], 2.0)
    judging.fits = {m.key: m for m in models}
    judging._leave_bounds()
    judging._leave_bounds()
    assert tried == asked
    assert len(judging.fits) == len(models) + len(asked)


def test_all_models_on_a_bound_are_left_until_the_best_is_inside():
    """Each of the best of a search had a stop beyond the motion; dry friction was never tried."""
    size = Coordinate("torque", 1.0, (1.0,), 0.0, 10.0, strength=True)
    shape = Coordinate("place", 1.0, (1.0,), 0.0, 10.0)
    stop = Hypothesis("end_stop", "knee", (), (size, shape)), (1.0, 0.0)
    dry, bias, spring = (
        (Hypothesis(name, "knee", (), (size,)), (1.0,))
        for name in ("coulomb_friction", "torque_bias", "cubic_stiffness")
    )

    def model(parts, rms):
        return Some(parts=parts, key=" + ".join(sorted(h.key for h, _ in parts)), rms=rms)

    def each(function, tasks):
        return [model(parts, 1.0 + 0.4 * (3 - len(parts))) for parts, _ in tasks]

    judging = judgement(_anew=list)
    judging.found = Some(screened=[])
    judging.search = Some(energy=lambda m: m.rms, each=each, setting=None)
    known = [model([stop, spring], 1.0), model([stop, dry, bias], 1.1), model([bias], 9.0)]
    judging.fits = {m.key: m for m in known}
    judging._leave_bounds()
    assert "coulomb_friction knee + torque_bias knee" in judging.fits


def test_all_that_are_weighed_are_fitted_about_the_model_at_hand_and_keep_the_better_fit():
    asked = []

    def each(function, tasks):
        asked.extend((function, *task) for task in tasks)
        return [Some(energy=3.0) for _ in tasks]

    judging, models = judgement(), [Some(parts="a", energy=1.0), Some(parts="b", energy=5.0)]
    judging.search = Some(setting="as set", energy=lambda model: model.energy, each=each)
    judging.about = None
    assert judging._anew(models) == models and not asked
    judging.about = [{"name": "armature"}]
    assert [m.energy for m in judging._anew(models)] == [1.0, 3.0]
    assert asked == [(judge.refit_model, part, "as set", judging.about) for part in "ab"]


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
    judging = judgement()
    near = Some(deviations=lambda values: np.array([0.1, values["mass"]]))
    judging.case = Some(bends=bends, loose=near)
    assert judging._off(Some(parts=parts, loose=loose)) is off


@pytest.mark.parametrize(("low", "idle"), [(0.0, {"hip"}), (-10.0, set())])
def test_a_size_that_would_rather_be_below_nothing_is_none_though_it_has_no_interval(low, idle):
    """One that may have either sign and is not known may be there."""
    joints = ("hip", "knee")
    size = Coordinate("torque", 1.0, (1.0,), low, 10.0, strength=True)
    offered = [Hypothesis("coulomb_friction", j, (("joint", j),), (size,)) for j in joints]
    ((family, _),) = by_law([Screened(h, 0.2, (1.0,)) for h in offered], joints)
    wide = Estimate("torque hip", 0.0, -np.inf, np.inf), Estimate("torque knee", 2.0, 1.9, 2.1)
    assert judge._negligible_joints(family, wide) == idle


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
    ((family, _),) = by_law([Screened(h, 0.2, (1.0,)) for h in offered], joints)
    middle = 0.5 * (low + high) if np.isfinite(low) else 1.7
    both = Estimate("torque hip", middle, low, high), Estimate("torque knee", 12.0, 11.0, 13.0)
    assert judge._negligible_joints(family, both) == idle


@pytest.fixture
def judged(monkeypatch):
    """Function that judges models that leave errors, among those that a challenge may fit."""
    monkeypatch.setattr(judge, "slides", lambda channels: set())
    surely = Estimate("torque", 1.0, 0.9, 1.1)

    def run(found, others=(), gap=10.0, sizes=(), unsure=()):
        known = {one.key: one for one in others}
        tried = []

        class Challenging(judge.Judgement):
            def _swaps(self, model, index, without):
                tried.append(model.key)
                return [m for m in known.values() if len(m.parts) == len(model.parts)]

            def _fitted(self, parts):
                return known.get(" + ".join(sorted(h.key for h, _ in parts)), self.found.base)

            def _without(self, model, index):
                return self._fitted([*model.parts[:index], *model.parts[index + 1 :]])

        def sensitivities(case, model, wider):
            size = {h.key: (dict(sizes).get(h.effect, surely),) for h, _ in model.parts}
            for h, _ in model.parts:
                if h.effect in dict(unsure).get(tuple(sorted(model.names, key=ORDER.index)), ()):
                    size[h.key] = (Estimate("torque", 1.0, -0.1, 2.1),)
            return size, None

        monkeypatch.setattr(judge, "sensitivities", sensitivities)
        base = fitted(rms=gap)
        forward = Some(measured=[np.zeros((4, 1))], channels=())
        case = Some(forward=forward, floor=np.ones(1), bends=False,
                    corrected=lambda specs, overrides: None, persistence=tuple)  # fmt: skip
        search = Some(
            params=Some(seed=0, accuracy=0.0, free_spread=0.3), nominal={}, setting=None,
            asked=False, adequate=lambda m: not has_gap(m.whole),
            energy=lambda m: np.log(m.fit_rms * m.held.rms), in_reach=lambda *_: True,
            each=lambda function, tasks: [task[0] for task in tasks],
        )  # fmt: skip
        result = Challenging(case, search, Some(base=base, given=base, models=list(found)))
        return result.result(), tried

    return run


ORDER = DRY, WET, PLAY = "coulomb_friction", "viscous_friction", "backlash"


def test_the_most_probable_model_is_challenged_and_a_better_one_takes_its_place(judged):
    first, better = fitted(DRY, rms=2.0), fitted(WET)
    found, tried = judged([first], [better])
    assert tried == [first.key, better.key]
    assert (found.decision.verdict, found.decision.names) == (NAMED, (WET,))
    assert found.best.key == better.key and [m.key for m in found.without] == [""]


def test_a_challenger_that_is_as_good_makes_the_name_ambiguous(judged):
    found, _ = judged([fitted(DRY)], [fitted(PLAY)])
    assert found.decision.verdict == AMBIGUOUS
    assert found.decision.ambiguous == ((PLAY, DRY),)
    assert [m.names for m, _ in found.rivals] in ([(PLAY,)], [(DRY,)])


def test_an_effect_is_dropped_if_the_model_without_it_is_as_good_and_stays_if_not(judged):
    both = fitted(DRY, WET)
    found, _ = judged([both], [fitted(DRY)])
    assert found.decision.names == (DRY,)
    found, _ = judged([both], [fitted(DRY, rms=1.6)])
    assert found.decision.names == (DRY, WET)


@pytest.mark.parametrize(("rms", "less"), [(0.3, 0.06), (2.0, 0.04)])
def test_what_may_be_nothing_is_challenged_only_beside_effects_that_leave_a_gap(judged, rms, less):
    """Most of a judgement went to three effects in place of two that explained the data."""
    dry, both = fitted(DRY, rms=rms), fitted(DRY, WET, rms=rms - less)
    assert weigh([both, dry, fitted(rms=10.0)], 0).best is both
    found, tried = judged([both, dry])
    assert found.best.key == dry.key and dry.key in tried
    assert (both.key in tried) is has_gap(dry.whole)


def test_an_effect_whose_size_may_be_zero_goes_if_the_rest_stands(judged):
    """The rest closes most of the gap: it is named, and more is missing."""
    nothing = Estimate("torque", 1.0, -0.1, 2.1)
    both, dry = fitted(DRY, WET), fitted(DRY, rms=2.5)
    found, _ = judged([both, dry], sizes=[(WET, nothing)])
    assert found.best.key == dry.key
    assert found.decision.names == (DRY,) and not found.decision.adequate
    alone, _ = judged([fitted(WET)], sizes=[(WET, nothing)])
    assert alone.decision.verdict == UNKNOWN


def test_what_stands_beside_an_effect_of_no_size_is_fitted_if_no_search_has_done_it(
    judged, monkeypatch
):
    """A double pendulum was unknown: a force of no size came beside the friction of its joints."""
    monkeypatch.setattr(judge, "ROUNDS", 0)
    nothing = Estimate("torque", 1.0, -0.1, 2.1)
    found, tried = judged([fitted(DRY, WET)], [fitted(DRY, rms=2.5)], sizes=[(WET, nothing)])
    assert not tried
    assert found.decision.names == (DRY,) and found.decision.verdict == PARTLY


def test_one_effect_of_no_size_goes_at_a_time_the_least_probable_first(judged):
    """Beside a force of no size the interval of the load's friction reached nothing, too."""
    wide = {(DRY, WET, PLAY): (WET, PLAY), (DRY, WET): ()}
    every, two, dry = fitted(DRY, WET, PLAY), fitted(DRY, WET, rms=1.1), fitted(DRY, rms=1.8)
    others = [two, dry, fitted(WET, PLAY, rms=4.0), fitted(DRY, PLAY, rms=1.7)]
    found, _ = judged([every], others, unsure=wide)
    assert found.best.key == two.key


@pytest.mark.parametrize(
    ("verdict", "asked", "gap", "after"),
    [
        (UNKNOWN, False, 9.0, "given"),
        (UNKNOWN, True, 9.0, "base"),
        (NO_GAP, False, 9.0, "base"),
        (NO_GAP, False, 0.0, "given"),
        (NO_GAP, True, 0.0, "base"),
        (NAMED, False, 9.0, "best"),
        (PARTLY, True, 9.0, "best"),
        (AMBIGUOUS, False, 9.0, "best"),
    ],
)
def test_the_model_after_the_search_has_what_the_verdict_says(verdict, asked, gap, after):
    given, base, best = fitted(rms=gap), fitted(rms=gap), fitted(DRY)
    weights = weigh([base, best, fitted(WET, rms=1.0)], 0)
    result = judge.Outcome(
        Some(verdict=verdict), given, base, best, weights, {}, (), None, asked=asked
    )  # fmt: skip
    assert result.after is {"given": given, "base": base, "best": best}[after]
    assert [m.names for m, _ in result.rivals] == [(WET,)]
    told = result.probability + sum(p for _, p in result.rivals)
    nothing = dict(zip((m.key for m in weights.models), weights.values, strict=True))[""]
    assert told + nothing == pytest.approx(1.0) and result.probability > 0.0


def test_a_model_is_fitted_to_convergence_once_and_again_if_a_better_start_is_found():
    tried = []

    def each(function, tasks):
        tried.extend(model.key for model, _, near in tasks)
        return [model for model, *_ in tasks]

    search = Some(each=each, setting=None, in_reach=lambda *_: True,
                  energy=lambda m: m.fit_rms)  # fmt: skip
    first, better = fitted(DRY, rms=2.0), fitted(DRY, rms=1.0)
    judging = judgement(search=search, fits={first.key: first}, converged={""})
    assert judging._finish([first, first, fitted()]) and tried == [first.key]
    assert not judging._finish([first])
    assert judging._put([fitted(DRY, rms=3.0)]) == [first] and not judging._finish([first])
    assert judging._put([better]) == [better] and judging._finish([better])
    assert tried == [first.key] * 2


@pytest.mark.parametrize(
    ("explains", "crowd", "verdict"),
    [(True, "", NAMED), (True, "3 of 4", PARTLY), (False, "", PARTLY), (False, "3 of 4", UNKNOWN)],
)
def test_values_on_their_bounds_lower_a_verdict_by_one_step(monkeypatch, explains, crowd, verdict):
    base, best = fitted(rms=9.0), fitted(DRY, rms=0.0 if explains else 2.5)
    decision = decide(weigh([base, best], 0), best, References(base, base))
    surely = {best.parts[0][0].key: (Estimate("torque", 1.0, 0.9, 1.1, most=1.0),)}
    result = judge.Outcome(decision, base, base, best, weigh([base, best], 0), surely, (), None)
    monkeypatch.setattr(judge.Judgement, "result", lambda self: result)
    monkeypatch.setattr(judge.traded, "crowded", lambda case, model: crowd)
    monkeypatch.setattr(judge.stable, "rows", lambda *args: ["row"])
    monkeypatch.setattr(judge.stable, "alarms", lambda table: (f"of {len(table)}",))
    search = Some(params=Some(seed=0, free_spread=0.3), nominal={}, adequate=lambda m: False)
    monkeypatch.setattr(judge.stable, "unlike", lambda records, model: ())
    case = Some(loose=None, records=())
    found = judge.judge(case, search, Some(base=base, given=base, models=[best]))
    assert found.decision.verdict == verdict
    assert ("More is missing: 3 of 4" in found.decision.evidence) is bool(crowd)
    assert found.decision.names == (() if verdict == UNKNOWN else (DRY,))
    on_bound, settings = found.alarms
    assert "on the bound" in on_bound and settings == "of 1"


@pytest.mark.parametrize(
    ("best", "gap", "adequate", "refitted", "told"),
    [
        ("", 3.0, True, True, True),
        ("", 0.0, True, True, False),  # there was no gap
        ("", 3.0, False, True, False),  # the values do not explain it
        ("", 3.0, True, False, False),  # none changed
        (DRY, 9.0, True, True, False),  # an effect explains it
    ],
)
def test_values_of_the_robot_are_the_answer_if_they_alone_explain_a_gap(
    best, gap, adequate, refitted, told, monkeypatch
):
    given, base = fitted(rms=gap), fitted(rms=gap if best else 0.0)
    model = fitted(best) if best else base
    weights = weigh([base, fitted(DRY)], 0)
    decision = decide(weights, model, References(given, base))
    sizes = {h.key: (Estimate("torque", 1.0, 0.9, 1.1),) for h, _ in model.parts}
    result = judge.Outcome(decision, given, base, model, weights, sizes, (), None)
    monkeypatch.setattr(judge.Judgement, "result", lambda self: result)
    monkeypatch.setattr(judge.traded, "little_off", lambda *args: ["kp (1 to 2)"] * refitted)
    monkeypatch.setattr(judge.stable, "rows", lambda *args: [])
    search = Some(
        params=Some(seed=0, free_spread=0.3), nominal={}, adequate=lambda model: adequate
    )  # fmt: skip
    found = judge.judge(Some(loose=None), search, Some(base=base, given=given, models=[model]))
    assert found.decision.verdict == (NAMED if best else NO_GAP)
    assert ("a little off. With kp (1 to 2) refitted" in found.decision.evidence) is told


def test_sensitivities_of_a_model_are_computed_once_and_anew_for_another_fit(monkeypatch):
    asked = []
    monkeypatch.setattr(judge, "sensitivities", lambda case, model, wider: asked.append(model))
    judging = judgement(case=Some(corrected=lambda specs, overrides: None))
    first, again = fitted(DRY, rms=2.0), fitted(DRY, rms=1.0)
    for model in (first, first, again, again):
        judging._sensitivities(model)
    assert [one is other for one, other in zip(asked, (first, again), strict=True)] == [True, True]


@pytest.mark.parametrize(("rms", "rounds"), [(1.0, 2), (3.0, 2), (7.0, 1)])
def test_what_cannot_be_named_is_challenged_once(judged, rms, rounds):
    """A model that leaves 7 of 10 is not named, whatever else leaves as much."""
    found, tried = judged([fitted(DRY, rms=1.1 * rms)], [fitted(WET, rms=rms)])
    assert len(tried) == rounds
    assert found.best.names == (WET,)
    assert (found.decision.verdict == UNKNOWN) == (rms == 7.0)


def test_a_judgement_ends_after_some_rounds(judged, monkeypatch):
    monkeypatch.setattr(judge, "ROUNDS", 1)
    _, tried = judged([fitted(DRY, rms=2.0)], [fitted(WET)])
    assert len(tried) == 1
