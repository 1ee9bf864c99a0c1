# SPDX-License-Identifier: Apache-2.0
"""A name that depends on a setting is an alarm."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted, Setting
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import stable
from loco_sim.effects.coordinates import Coordinate

RUBS, LAGS = "coulomb_friction", "actuator_lag"


def fitted(whole, *effects):
    parts = tuple((Hypothesis(name, "knee", (), ()), ()) for name in effects)
    return Fitted(parts, {}, 1.0, evidence.score(whole), tuple(whole), 0.0)


def noise(size, seed=0):
    """Residuals of three records, with an error of a size beside the noise in each."""
    rng = np.random.default_rng(seed)
    wave = np.sign(np.sin(np.arange(400) * 0.3))[:, None]
    return [rng.normal(size=(400, 1)) + s * wave for s in size]


def search(
    each=lambda function, tasks: ([task[0].whole] * len(task[1]) for task in tasks),
    reach=lambda model, models: True,
):
    """A search of three records whose fits end where they began."""
    records = [SimpleNamespace(name=n) for n in ("chirp", "steps", "ramp")]
    case = SimpleNamespace(records=records)
    return SimpleNamespace(case=case, setting=None, each=each, in_reach=reach)


@pytest.fixture
def table():
    """Answers under settings: sizes of the error that each model leaves, per record."""

    def make(best, base, *rivals):
        models = [fitted(noise(best), RUBS), fitted(noise(base))]
        models += [fitted(noise(r), LAGS) for r in rivals]
        return stable.rows(search(), models[0], models[1], models[2:], 0)

    return make


def test_rows_are_read_wherever_the_named_model_has_a_residual_whatever_another_model_does():
    """A base model that leaves the track at once must not make a rest count as a stretch."""
    rest = np.full((1200, 1), np.nan)
    named = fitted([np.concatenate([rest, r]) for r in noise([0.0] * 3)], RUBS)
    base, late = (
        fitted([np.concatenate([np.full((n, 1), np.nan), r[n - 1200 :]]) for r in noise([5.0] * 3)])
        for n in (1200, 1300)
    )
    stretches = [
        [r.closed for r in stable.rows(search(), named, other, [], 0) if r.vary == "stretch"]
        for other in (base, late)
    ]
    assert stretches[0] == pytest.approx(stretches[1], abs=0.01)


def test_a_name_that_stays_is_no_alarm(table):
    rows = table([0.0, 0.0, 0.0], [5.0, 5.0, 5.0], [2.0, 2.0, 2.0])
    assert [r.vary for r in rows] == ["split"] * 3 + ["stretch"] * 2 + ["floor"] * 2
    assert {r.names for r in rows} == {(RUBS,)} and min(r.probability for r in rows) > 0.9
    assert stable.alarms(rows) == ()


@pytest.mark.parametrize(
    ("best", "base", "rivals", "names"),
    [
        ([0.0, 0.0, 3.0], [5.0, 5.0, 5.0], [[2.0, 2.0, 0.0]], (LAGS,)),
        ([0.0, 0.0, 5.0], [5.0, 5.0, 0.0], [], ()),
    ],
)
def test_a_record_in_which_another_answer_is_more_probable_is_an_alarm(
    table, best, base, rivals, names
):
    rows = table(best, base, *rivals)
    flip = min(rows, key=lambda r: r.probability)
    assert (flip.vary, flip.setting, flip.names) == ("split", "ramp judges", names)
    (alarm,) = stable.alarms(rows)
    assert "split 'ramp judges'" in alarm and (" and ".join(names) or "nothing") in alarm


def test_a_rest_before_a_record_is_no_stretch_of_it():
    """Its rows are unknown, so half of a record could have nothing that judges."""
    rest = np.full((1200, 1), np.nan)
    models = [
        fitted([np.concatenate([rest, r]) for r in noise([size] * 3)], *names)
        for size, names in ((0.0, (RUBS,)), (5.0, ()))
    ]
    rows = stable.rows(search(), *models, [], 0)
    short = stable.rows(
        search(), *(fitted(noise([s] * 3), *n) for s, n in ((0, [RUBS]), (5, []))), [], 0
    )
    halves, expected = ([r.closed for r in x if r.vary == "stretch"] for x in (rows, short))
    assert halves == pytest.approx(expected)


def test_a_model_with_the_named_effect_and_another_one_still_has_the_name():
    row = stable.Row("floor", "twice", (LAGS, RUBS), 0.9, 0.9)
    assert stable.alarms([row]) == ()
    lost = replace(row, setting="half", probability=0.2)
    worse = replace(lost, setting="first half", names=(), probability=0.01)
    assert "'first half' it has a probability of 0.01, and nothing" in stable.alarms(
        [row, lost, worse]
    )[0]  # fmt: skip


def test_loud_records_judge_and_floors_shrink_what_is_left(table, monkeypatch):
    monkeypatch.setattr(stable, "SPLITS", 2)
    rows = table([0.0, 0.0, 0.0], [2.0, 0.5, 4.0], [0.5, 2.0, 1.0])
    judged = [r.setting for r in rows if r.vary == "split"]
    assert judged == ["chirp judges", "ramp judges"]  # in their order, not by size
    lower, higher = (r for r in rows if r.vary == "floor")
    assert lower.setting == "0.5 times as high" and higher.setting == "2 times as high"
    assert {r.names for r in rows} == {(RUBS,)}
    # Noise is twice its floor, then half of it; the gap is 6.75 times the energy of noise.
    assert lower.closed == pytest.approx(1.0 - np.sqrt(3.0 / (4.0 * 7.75 - 1.0)), abs=0.01)
    assert higher.closed == 1.0


def test_only_the_nearest_other_names_are_fitted_again():
    asked = []

    def each(function, tasks):
        asked.extend((task[0], len(task[1])) for task in tasks)
        return [[task[0].whole] * len(task[1]) for task in tasks]

    best, base = fitted(noise([0.0] * 3), RUBS), fitted(noise([5.0] * 3))
    twin, near, next_near, far = (fitted(noise([1.0] * 3), *n) for n in ([RUBS], [LAGS], "a", "b"))
    stable.rows(search(each), best, base, [twin, near, next_near, far], 0)
    assert asked == [(m, stable.SPLITS) for m in (best, base, near, next_near)]
    asked.clear()
    out = {id(base), id(near)}  # twice the residual of the best
    some = search(each, lambda m, _: id(m) not in out)
    rows = stable.rows(some, best, base, [near, next_near], 0)
    assert asked == [(m, stable.SPLITS) for m in (best, next_near)]
    assert [r.vary for r in rows].count("split") == stable.SPLITS


def test_a_model_out_of_reach_is_judged_as_it_is_and_others_as_they_were_refitted():
    best, base, near = fitted(noise([2.0] * 3), RUBS), fitted(noise([5.0] * 3)), noise([3.0] * 3)
    out = {id(base)}
    some = search(
        each=lambda function, tasks: ([noise([0.0] * 3)] * len(task[1]) for task in tasks),
        reach=lambda model, models: id(model) not in out,
    )
    rows = stable.rows(some, best, base, [fitted(near, LAGS)], 0)
    closed = {r.vary: r.closed for r in rows}
    assert closed["split"] > 0.95 > closed["stretch"]


def test_one_record_has_no_other_that_could_judge():
    best, base = fitted(noise([0.0]), RUBS), fitted(noise([5.0]))
    rows = stable.rows(search(each=None), best, base, [], 0)
    assert {r.vary for r in rows} == {"stretch", "floor"}


@pytest.fixture
def refitted(monkeypatch):
    """Function that fits a model again without a record; says what was fitted and how long."""

    def run(model, start_rms=1.0, found_rms=0.5, judging=1):
        said = {}

        def fit(case, parts, setting):
            said.update(case=case, evaluations=setting.params.evaluations, free=setting.free)
            return replace(model, fit_rms=found_rms, whole=("found",))

        def weigh(case, parts, overrides, seek=True):
            return replace(model, fit_rms=start_rms, whole=("start",))

        monkeypatch.setattr(stable, "fit", fit)
        monkeypatch.setattr(stable, "weigh", weigh)
        case = Records(fit_rows=[np.ones(4, bool), np.zeros(3, bool)], held_rows=[])
        setting = Setting(GapParams(), {}, {}, 1.0, ())
        (residuals,) = stable.cross_validate(case, model, [judging], setting)
        return residuals, said

    return run


@dataclass(frozen=True)
class Records:
    """A case as far as splits go."""

    fit_rows: list
    held_rows: list

    def corrected(self, specs, overrides):
        return self


@pytest.mark.parametrize(
    ("sizes", "differs"),
    [((0.0, 0.0, 300.0), True), ((90.0, 0.0, 2.0), True), ((50.0, 20.0, 90.0), False),
     ((0.0, 0.0, 3.0), False), ((900.0, 40.0, 40.0), False)],
)  # fmt: skip
def test_a_recording_of_another_robot_is_told(sizes, differs):
    """The load of a gripper, for example. A model that explains no recording lacks something."""
    names = ("chirp", "steps", "ramp")
    said = stable.unlike(search().case.records, fitted(noise(sizes)))
    assert bool(said) is differs
    if differs:
        loud = names[int(np.argmax(sizes))]
        assert said[0].startswith(f"{loud} and ") and "was the robot, its load" in said[0]


def test_the_record_that_is_left_out_judges_and_no_other(refitted):
    for judging in (0, 1):
        _, said = refitted(fitted(noise([0.0, 0.0]), RUBS), judging=judging)
        fit_rows, held_rows = said["case"].fit_rows, said["case"].held_rows
        assert [rows.all() for rows in fit_rows] == [judging != 0, judging != 1]
        assert [rows.all() for rows in held_rows] == [judging == 0, judging == 1]
        assert [len(rows) for rows in fit_rows] == [4, 3]


def test_the_better_of_start_and_fit_is_taken_and_a_bare_model_stays(refitted):
    model = fitted(noise([0.0, 0.0]), RUBS)
    assert refitted(model)[0] == ("found",)
    assert refitted(model, start_rms=0.4)[0] == ("start",)
    bare = fitted(noise([0.0, 0.0]))
    residuals, said = refitted(bare)
    assert residuals == bare.whole and not said
    free = replace(bare, overrides={"masses.shank": 1.2})
    residuals, said = refitted(free)
    assert residuals == ("found",) and said["free"] == free.overrides


def test_a_fit_from_where_it_was_is_short_and_gets_longer_with_the_model(refitted):
    """A method that differentiates pays for its Jacobian outside of this number."""
    counts = {}
    for effects in ("a", "ab", "abc"):
        model = fitted(noise([0.0]), *effects)
        one = Coordinate("size", 1.0, (1.0,), 0.0, 1.0, strength=True)
        parts = tuple((replace(h, coordinates=(one,)), (1.0,)) for h, _ in model.parts)
        counts[len(effects)] = refitted(replace(model, parts=parts))[1]["evaluations"]
    assert counts[1] == stable.REFIT and counts[2] <= counts[1] and min(counts.values()) >= 4
