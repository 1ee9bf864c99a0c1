# SPDX-License-Identifier: Apache-2.0
"""A search begins and ends where the verdict says that there is or is no gap."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted, Setting
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.fitting.screen import Screened, project
from loco_learning.gap.fitting.search import (
    AT_JUMPS,
    IN_REACH,
    TANGENT_STEP,
    Pool,
    Search,
    call,
    sibling_pairs,
)
from loco_learning.gap.hypotheses.bundles import Batch
from loco_learning.gap.hypotheses.families import by_law
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.prediction.case import Case
from loco_learning.gap.statistics import evidence
from loco_learning.gap.statistics.leftover import LIMITS, has_gap
from loco_sim.effects.coordinates import Coordinate

from .. import laws

ROWS, RECORDS = 500, 4


def whole(*levels):
    """Residuals whose one channel has these rms values, a record each."""
    signs = np.where(np.arange(ROWS) % 2, 1.0, -1.0)
    return [level * signs[:, None] for level in levels]


def explains(residuals):
    """Answer of a search whose last record judges."""
    flags = [np.full(ROWS, i < RECORDS - 1) for i in range(RECORDS)]
    case = SimpleNamespace(fit_rows=flags, held_rows=[~f for f in flags])
    case.masked = lambda *a: Case.masked(case, *a)
    return Search.adequate(SimpleNamespace(case=case), SimpleNamespace(whole=residuals))


@pytest.mark.parametrize("level", np.linspace(1.0, 2.0, 21))
def test_a_gap_that_the_verdict_sees_is_searched(level):
    """Between two thresholds a gap would end in unknown without a search."""
    residuals = whole(*[level] * RECORDS)
    if has_gap(residuals):
        assert not explains(residuals)
    assert explains(residuals) or level > LIMITS.explained


def test_what_is_left_in_the_record_that_judges_alone_is_searched():
    assert explains(whole(1.0, 1.0, 1.0, 1.0))
    assert not explains(whole(1.0, 1.0, 1.0, 1.8))


def screened(effect, place, share, variant=""):
    return Screened(Hypothesis(effect, place, (), (), variant), share, (1.0,))


def test_pairs_of_one_kind_at_the_place_where_it_explains_most_are_tried():
    found = sibling_pairs(
        [
            screened("sensor_gain", "hip", 0.4),
            screened("sensor_bias", "knee", 0.5, "q"),
            screened("sensor_bias", "knee", 0.45, "tau"),  # one of an effect
            screened("sensor_gain", "knee", 0.3),
            screened("sensor_nonlinearity", "knee", 0.01),  # explains too little
            screened("added_stiffness", "knee", 0.9),  # alone of its kind there
            screened("command_delay", "", 0.8),  # sits nowhere
            screened("coulomb_friction", "hip", 0.2),
            screened("viscous_friction", "hip", 0.3),
        ],
        0.05,
    )
    told = {tuple(sorted((h.effect, h.place, h.variant) for h, _ in pair)) for pair in found}
    assert told == {
        (("sensor_bias", "knee", "q"), ("sensor_gain", "knee", "")),
        (("coulomb_friction", "hip", ""), ("viscous_friction", "hip", "")),
    }


def test_pairs_of_siblings_are_few():
    laws = ("coulomb_friction", "viscous_friction", "stribeck_friction", "load_friction")
    found = sibling_pairs(
        [screened(law, "knee", 0.5 - 0.1 * k) for k, law in enumerate(laws)], 0.05
    )
    assert len(found) == 3 and not any(h.effect == laws[3] for pair in found for h, _ in pair)


def fit_of(name, rms, hope=1.0):
    held = SimpleNamespace(rms=rms)
    return SimpleNamespace(
        key=name, names=(name,), parts=((name,),), overrides={}, cost=1.0, fit_rms=rms, held=held,
        hope=hope,
    )  # fmt: skip


def test_values_of_the_robot_are_fitted_by_simulation_only_near_the_best():
    """Most of a search was spent on models of several times the residual of the best one."""
    rough = [
        fit_of("payload", 1.0, 0.9),
        fit_of("armature", 9.0, 0.9),  # hopeless
        fit_of("com_offset", 9.0, 0.01),  # a simulation may bring it near
        fit_of("end_stop", 9.0, 0.9),  # nothing is known: it is not smooth
    ]
    search, sought = object.__new__(Search), []

    def each(function, arguments):
        if function.__name__ == "fit":
            return iter(rough[: len(arguments)])
        sought.extend(parts[0][0] for parts, *_ in arguments)
        return (fit_of(name, 1.0) for name in sought)

    search.fits, search.setting, search.each = {}, None, each
    models = search.fitted([m.parts for m in rough])
    assert sought == ["payload", "com_offset", "end_stop"]
    assert [m.hope for m in models] == [1.0, 0.9, 1.0, 1.0]
    assert [search.in_reach(fit_of("payload", rms), models) for rms in (1.9, 2.1)] == [True, False]


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_effects_in_jumps_beside_a_judged_model_are_in_reach_farther_than_others(share):
    """Of nothing that was fitted before anything is known; hopeless ones were half of a verdict."""
    search = object.__new__(Search)
    search.fits = {"best": fit_of("payload", 1.0)}
    for name, limit in (("armature", IN_REACH), ("end_stop", AT_JUMPS)):
        model = fit_of(name, np.exp(0.5 * share * limit))
        assert search.in_reach(model, (), AT_JUMPS) is (share < 1.0)
    assert search.in_reach(model) and AT_JUMPS > IN_REACH


@pytest.mark.parametrize("cost", [0.0, 10.0])
def test_fits_beside_fitted_models_are_told_the_cost_at_which_they_are_hopeless(cost):
    told, search = [], object.__new__(Search)
    search.setting, search.fits = Setting(GapParams(), {}, {}, 3.0, ()), {}
    search.each = lambda function, tasks: [
        told.append(task) or fit_of("push", 1.0) for task in tasks
    ]
    known = [fit_of("payload", 1.0), fit_of("", 1.0), fit_of("armature", 2.0)]
    for model, each in zip(known, (cost, 0.1 * cost, 3.0 * cost), strict=True):
        model.cost, model.parts = each, model.parts if model.key else ()
    search.fitted([(("push", 1.0),)], known)
    ((_, setting, _),) = told
    assert setting.hopeless == pytest.approx(cost * np.exp(AT_JUMPS) if cost else np.inf)


@pytest.mark.parametrize(
    ("nominal", "stated", "asked"),
    [
        ({}, None, False),
        ({}, (False, False), False),
        ({}, (False, True), True),
        ({"drives.knee.kp": 2.0}, None, True),
        ({"drives.knee.kp": 2.0}, (False,), True),
    ],
)
def test_values_are_asked_for_if_any_is_free_or_stated_uncertain(nominal, stated, asked):
    loose = None if stated is None else SimpleNamespace(stated=np.array(stated))
    search = object.__new__(Search)
    search.nominal, search.case = nominal, SimpleNamespace(loose=loose)
    assert search.asked is asked


KP, SENSED = "drives.knee.kp", 600


def screened_beside(size, amplitude):
    """Tangent of a model of friction with a free gain, and what its three numbers change.

    Each number bends what it changes: by as much as its own change at one unit of it.

    Args:
        size: Coordinate of the friction's torque.
        amplitude: What one unit of a number changes [floors].
    """
    rng = np.random.default_rng(0)
    lines, bends = np.linalg.qr(rng.normal(size=(SENSED, 6)))[0].T.reshape(2, 3, SENSED)
    asked = []

    def vector(specs, overrides, only, coarse=False):
        ((spec,), at) = specs, overrides.get(KP, 2.0)
        scales = laws.TORQUE.size, laws.SPEED.size
        by = spec["torque"] / scales[0] - size, np.log(spec["velocity"] / scales[1])
        steps = np.array([*by, np.log(at / 2.0)])
        asked.append(coarse)
        return 5.0 + amplitude * (steps @ lines + np.square(steps) @ bends)

    case = SimpleNamespace(
        vector=vector, forward=SimpleNamespace(robot=lambda: SimpleNamespace(joints=()))
    )
    told = []

    def ordered(jobs):
        told.extend(arguments[5] for _, arguments in jobs)
        return ([Screened(arguments[0].hypotheses[0], 0.5, (1.0,))] for _, arguments in jobs)

    search = Search(
        case, [laws.COULOMB], GapParams(), SimpleNamespace(ordered=ordered), lambda *_: None,
        {KP: 2.0}, lambda some: [Batch((h,), (None,)) for h in some],
    )  # fmt: skip
    search.only = [0]
    model = replace(laws.fitted(laws.STRIBECK), parts=((laws.STRIBECK, (size, 0.0)),))
    search.beside(model, [Screened(laws.COULOMB, 0.5, (1.0,), cost=1)])
    assert all(asked)  # a screening needs no finer steps than the model's
    return told[0], lines


@pytest.mark.parametrize("size", [0.0, 1.0, 0.3])
@pytest.mark.parametrize("amplitude", [1e-6, 1.0, 1e6])
def test_what_the_numbers_of_a_model_change_is_no_evidence_for_another_effect(size, amplitude):
    """However little it is; secants differ from derivatives by no more than a step bends them."""
    tangent, lines = screened_beside(size, amplitude)
    np.testing.assert_allclose(tangent.T @ tangent, np.eye(3), atol=1e-9)
    left = np.linalg.norm(project(lines.T, tangent), axis=0)
    steps = np.array([TANGENT_STEP * (size or 1.0), 2.0 * TANGENT_STEP, TANGENT_STEP])
    assert (left <= 1.01 * steps).all() and (left >= 0.5 * steps / np.hypot(1.0, steps)).all()


@pytest.mark.parametrize(("explains", "extended"), [("first", 1), ("second", 2), ("none", 2)])
def test_no_model_is_extended_once_another_one_explains_the_data(explains, extended):
    """With a beam of two: what is left is the work of rivals, which a verdict looks for."""
    names = {"first": "payload", "second": "armature"}
    begun, done = [], "end_stop"
    singles = [laws.fitted(laws.hypothesis(n, laws.TORQUE)) for n in names.values()]
    silent, loud = (np.ones((ROWS, 1)) * [[level]] for level in (0.5, 9.0))

    def whole(parts):
        names_of = {h.effect for h, _ in parts}
        good = {done, names.get(explains)} == names_of
        return fitted_as(parts, [silent if good else loud * (1.0 - 0.1 * len(parts))] * 2)

    def ordered(jobs):
        for function, arguments in jobs:
            if function.__name__ == "screen":
                yield [Screened(h, 0.5, (1.0,), cost=1) for h in arguments[0].hypotheses]
            elif function.__name__ == "rough_fit":
                begun.append(arguments[0][0][0].effect)
                yield 1.0, arguments[0]
            else:
                yield whole(arguments[0]) if function.__name__ == "fit" else arguments[0]

    flags = [np.full(ROWS, i == 0) for i in range(2)]
    case = SimpleNamespace(
        fit_rows=flags, held_rows=[~f for f in flags], vector=lambda *a, **k: np.ones(ROWS),
        forward=SimpleNamespace(robot=lambda: SimpleNamespace(joints=())),
    )  # fmt: skip
    case.masked = lambda *a: Case.masked(case, *a)
    more = laws.hypothesis(done, laws.TORQUE)
    search = Search(
        case, [more], GapParams(beam=2, most_terms=2), SimpleNamespace(ordered=ordered),
        lambda *_: None, {}, lambda some: [Batch((h,), (None,)) for h in some],
    )  # fmt: skip
    search.only, search.setting = [0], Setting(GapParams(), {}, {}, 3.0, ())
    models = [whole(m.parts) for m in singles]
    search.fits = {m.key: m for m in models}
    search.together(Pool(fitted_as((), [loud] * 2), fitted_as((), [loud] * 2), models))
    assert [*dict.fromkeys(begun)] == [*names.values()][:extended]


def fitted_as(parts, residuals):
    """A model that leaves residuals, of which the last record's judge."""
    held = [np.full_like(residuals[0], np.nan), residuals[1]]
    rms = evidence.rms(residuals[:1])
    return Fitted(tuple(parts), {}, rms, evidence.score(held), tuple(residuals), 1.0)


DRY = {"name": "coulomb_friction", "torque": 3.0}
LATE = {"name": "command_delay", "delay": 0.004}


def searched(bench, effects, names):
    """A search among effects of some names on a bench with effects, its result, and progress."""
    case, offered = bench(effects)
    tasks = SimpleNamespace(ordered=lambda jobs: (call(case, *job) for job in jobs))
    told, hypotheses = [], [offered[name].hypotheses[0] for name in names]
    search = Search(
        case, hypotheses, GapParams(), tasks, lambda share, *_: told.append(share), {},
        lambda some: [Batch((h,), (None,)) for h in some],
    )  # fmt: skip
    return search, search.together(search.singles()), told


def test_two_causes_are_found_in_whatever_order_they_are_tried_and_leave_noise(bench):
    names = ["coulomb_friction", "viscous_friction", "command_delay"]
    search, found, told = searched(bench, [DRY, LATE], names)
    assert found.best.names == ("command_delay", "coulomb_friction")
    assert search.adequate(found.best) and not search.adequate(found.base)
    assert told == sorted(told) and 0.0 <= told[0] < told[-1] <= 1.0
    _, again, _ = searched(bench, [DRY, LATE], names[::-1])
    assert [m.key for m in again.models] == [m.key for m in found.models]
    assert [m.fit_rms for m in again.models] == [m.fit_rms for m in found.models]


def test_a_model_fits_no_worse_than_a_part_of_it(bench):
    """Friction that holds the axis, whatever its size, is no start beside a limit of its force."""
    names = ["torque_limit", "coulomb_friction"]
    search, _, _ = searched(bench, [DRY, {"name": "torque_limit", "reduction": 0.6}], names)
    limit, dry = search.hypotheses
    search.fits = {}
    (alone,) = search._fit([((limit, (0.6 / limit.coordinates[0].size,)),)])
    holds = dry.coordinates[0].inverse(dry.coordinates[0].high)
    (both,) = search.fitted([(*alone.parts, (dry, (holds,)))])
    assert both.fit_rms < alone.fit_rms


def test_a_rival_that_does_nothing_changes_nothing(bench):
    """The drive never comes near its limit."""
    names = ["coulomb_friction", "viscous_friction"]
    (_, found, _), (_, beside, _) = (
        searched(bench, [DRY], [*names, *more]) for more in ((), ("torque_limit",))
    )
    assert found.best.names == beside.best.names == ("coulomb_friction",)
    assert found.best.parts == beside.best.parts
    assert beside.best.fit_rms == found.best.fit_rms


@pytest.mark.parametrize("noise", [0.1, 1.0, 6.0])
def test_the_robust_loss_is_as_wide_as_three_deviations_of_noise_and_of_floors(noise):
    residual = noise * np.random.default_rng(0).normal(size=20_000)
    search = SimpleNamespace(case=SimpleNamespace(vector=lambda specs, overrides: residual))
    width = Search._scale(search, SimpleNamespace(specs=[], overrides={}))
    assert width == pytest.approx(3.0 * max(noise, 1.0), rel=0.03)


@pytest.mark.parametrize(
    ("rms", "fitted"),
    [
        ((1.0, 3.0, 4.0, 5.0), "ab"),
        ((1.0, 1.05, 1.08, 3.0), "abc"),  # a close race
        ((1.0, 1.05, 1.08, 1.09, 1.09, 1.09), "abcd"),  # of twice as many at most
        ((3.0, 1.0, 1.2), "bc"),
    ],
)
def test_the_best_of_a_tournament_are_fitted_and_more_of_them_in_a_close_race(rms, fitted):
    kept = {}
    search = object.__new__(Search)
    search.fits, search.setting, search.params = {}, None, SimpleNamespace(polished=0)
    wanted = [((SimpleNamespace(key=name), 0.0),) for name, _ in zip("abcdef", rms, strict=False)]
    search.each = lambda function, tasks: (
        zip(rms, [parts for parts, *_ in tasks], strict=True) if tasks else ()
    )
    search._fit = lambda some: kept.update(dict.fromkeys(parts[0][0].key for parts in some)) or []
    search.report = lambda *_: None
    search._tournament(wanted, 2, (0.0, 1.0))
    assert "".join(sorted(kept)) == fitted


def law(effect, joint, share):
    size = Coordinate("torque", 1.0, (1.0,), 0.0, 10.0, "N·m", strength=True)
    return Screened(Hypothesis(effect, joint, (("joint", joint),), (size,)), share, (1.0,))


@pytest.mark.parametrize(("alone", "tried"), [(0.1, True), (0.5, False)])
def test_a_second_law_is_tried_in_all_joints_where_these_explain_more_than_the_best_single(
    alone, tried
):
    joints, kept = ("hip", "knee", "ankle"), []
    (both,) = by_law([law("viscous_friction", j, 0.2) for j in joints], joints)
    results = [law("coulomb_friction", j, 0.1) for j in joints]
    results += [law("viscous_friction", j, 0.2) for j in joints]  # already in the model
    results.append(law("load_friction", "knee", alone))
    search = object.__new__(Search)
    search.params, search.joints, search.report = GapParams(), joints, None
    search._screen = lambda *arguments: results
    search._tournament = lambda wanted, *_: kept.extend(wanted) or []
    model = SimpleNamespace(parts=(both,))
    search._deepen([model], SimpleNamespace(screened=[], base=None), 2)
    second = [parts[1][0] for parts in kept if parts[1][0].joints]
    assert [h.effect for h in second] == (["coulomb_friction"] if tried else [])


def test_a_law_in_several_joints_does_not_count_among_the_effects_of_a_model():
    search = object.__new__(Search)
    search.params = GapParams(most_terms=2)
    joints = ("hip", "knee")
    one = (law("payload", "hip", 0.1).hypothesis, (1.0,))
    (each,) = by_law([law("coulomb_friction", j, 0.2) for j in joints], joints)
    kinds = [((one,), True), ((one, one), False), ((each, one), True), ((each, one, one), False)]
    for parts, more in kinds:
        assert search._extensible(SimpleNamespace(parts=parts)) is more


@pytest.mark.parametrize("unit", [0.1, 1.0, 10.0])
def test_a_share_of_the_loudest_record_is_told_as_one_of_all(unit):
    """Whatever the unit: friction that explains half of a record with 0.9 of the energy, 0.45."""
    levels = 3.0 * unit, 9.0 * unit
    search = object.__new__(Search)
    search.params, search.only = GapParams(), [0, 1]
    vectors = {i: np.full(100, level) for i, level in enumerate(levels)}
    search.case = SimpleNamespace(
        vector=lambda specs, overrides, only: np.concatenate([vectors[i] for i in only]),
        rounds=False,
    )
    weak, strong = law("coulomb_friction", "hip", 0.0), law("coulomb_friction", "knee", 0.3)
    tried = []

    def screened_again(model, hypotheses, only, span, starts):
        tried.extend(only)
        return [Screened(h, 0.5, (1.0,)) for h in hypotheses]

    search._tried = screened_again
    model = SimpleNamespace(whole=[v[:, None] for v in vectors.values()], specs=[], overrides={})
    again, same = search._alone(model, [weak, strong], 0.3)
    assert tried == [1] and again.share == pytest.approx(0.45) and same is strong


def test_a_further_effect_is_sought_beside_models_of_the_depth_before_alone():
    depths, base = [], fit_of("", 9.0)
    search = object.__new__(Search)
    search.params, search.report, search.joints = GapParams(beam=5), lambda *_: None, ()
    search.fits = {f"{n}{k}": fit_of(f"{n}{k}", 5.0 / n) for n in (1, 2, 3) for k in range(2)}
    for key, model in search.fits.items():
        kinds = ("coulomb_friction", "payload", "end_stop", "backlash")
        parts = [law(kind, "knee", 0.1).hypothesis for kind in kinds[int(key[1]) :]]
        model.parts = tuple((h, (1.0,)) for h in parts[: int(key[0])])
        model.names, model.count = tuple(h.effect for h in parts), len(parts)
    search.enough = lambda model, base: False
    search._idle = lambda ranked, depth: False
    search._deepen = lambda level, found, depth: depths.append(
        (depth, {len(m.parts) for m in level})
    )
    found = SimpleNamespace(
        base=base, models=[m for m in search.fits.values() if len(m.parts) == 1]
    )
    search.together(found)
    assert depths == [(2, {1}), (3, {2}), (4, {3})][: len(depths)] and len(depths) > 1
