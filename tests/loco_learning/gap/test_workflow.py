# SPDX-License-Identifier: Apache-2.0
"""Laws of the whole workflow on a bench: what was planted comes back, and nothing else.

The measurements are the model's own at another physics step, with noise. About 30 s: every
case is a search.
"""

import json
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap import contents, workflow
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.fitting.search import Search
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.prediction.forward import Forward
from loco_sim.effects.catalogue.friction import StribeckFriction as Stribeck
from loco_sim.plant.model import Model

EFFECTS = ("*_friction", "joint_offset", "sensor_bias", "command_delay", "hysteresis")
QUICK = GapParams(effects=EFFECTS, most_terms=2)
FEW = QUICK.replace(effects=("viscous_friction", "joint_offset"), most_terms=1)
CHEAP = {"rough": 2, "evaluations": 4, "polished": 0}  # enough for what is about no value


@pytest.fixture
def found(slide):
    """Function that plants effects and runs the workflow."""

    def run(effects=(), params=QUICK, **kwargs):
        return workflow.find(slide.model, *slide.records(effects), params, **kwargs)

    return run


def test_nothing_planted_is_no_gap(found):
    gap = found()
    assert (gap["verdict"], gap["names"], gap["terms"]) == ("no gap", [], [])
    assert gap["model"]["effects"] == []
    assert gap["probability"] == {}


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "unit"),
    [("coulomb_friction", "torque", 3.0, "N"), ("sensor_bias", "q", 0.002, "m")],
)
def test_what_was_planted_is_named_with_its_size_and_place(found, effect, parameter, value, unit):
    gap = found([{"name": effect, parameter: value}])
    assert (gap["verdict"], gap["names"]) == ("named", [effect])
    (term,) = gap["terms"]
    assert term["place"] == "slide"
    assert term["parameters"][parameter]["value"] == pytest.approx(value, rel=0.1)
    assert term["parameters"][parameter]["low"] > 0.0
    assert term["parameters"][parameter]["unit"] == unit
    assert gap["gap"]["closed"] > 0.9
    assert gap["model"]["effects"][0]["name"] == effect
    told = gap["probability"]
    assert told["effects"][effect] > 0.95 and told["places"]["slide"] > 0.95
    assert term["probability"] == told["effects"][effect]


def test_of_two_effects_both_are_named(slide):
    planted = {"viscous_friction": ("damping", 20.0), "sensor_bias": ("q", 0.002)}
    four = QUICK.replace(effects=(*planted, "coulomb_friction", "joint_offset"))
    fit, judge = slide.records([{"name": e, key: value} for e, (key, value) in planted.items()])
    gap = workflow.find(slide.model, fit[:1], judge, four)
    assert (gap["verdict"], sorted(gap["names"])) == ("named", sorted(planted))
    for term in gap["terms"]:
        key, value = planted[term["effect"]]
        assert term["parameters"][key]["value"] == pytest.approx(value, rel=0.1)
    assert gap["gap"]["closed"] > 0.9


UNSURE = {"uncertain.bodies.*.mass": "3%", "uncertain.drives.*.k[pd]": "3%"}
OFF = {"bodies.carriage.mass": 1.04, "drives.slide.kp": 1960.0}  # the drive has 2000 N/m


def test_a_model_that_is_a_little_off_has_no_gap_and_is_put_right(slide):
    unsure = Model(slide.model.robot, UNSURE)
    both = slide.records(overrides=OFF)
    gap = workflow.find(unsure, *both, QUICK)
    assert (gap["verdict"], gap["alarms"]) == ("no gap", [])
    assert gap["gap"]["before"] > 2.0
    assert gap["evidence"].startswith("The model is a little off. With bodies.carriage.mass")
    said = gap["model"]["overrides"]
    wanted = OFF["drives.slide.kp"] / OFF["bodies.carriage.mass"]
    # A drive of 60 N·s/m that is late by 0.05 ms acts like 3 g of the 1.04 kg.
    assert said["drives.slide.kp"] / said["bodies.carriage.mass"] == pytest.approx(wanted, 3e-3)


def test_a_model_that_explains_nothing_is_not_said_to(slide):
    """A mass a thousandth off is refitted, too, but a gain too small to matter is what shows."""
    off = slide.records(
        [{"name": "sensor_gain", "q": 8e-4}], overrides={"bodies.carriage.mass": 1.001}
    )
    gap = workflow.find(slide.model, *off, QUICK.replace(effects=(*EFFECTS, "sensor_gain")))
    assert (gap["verdict"], gap["names"]) == ("no gap", [])
    assert gap["evidence"].endswith("sensor_gain too small to matter explains it.")


def test_what_is_a_little_off_hides_neither_friction_nor_a_mass(slide):
    unsure = Model(slide.model.robot, UNSURE)
    rubs = {"name": "coulomb_friction", "torque": 3.0}
    gap = workflow.find(
        unsure, *slide.records([rubs], overrides={"drives.slide.kp": 1980.0}), QUICK
    )
    assert (gap["verdict"], gap["names"]) == ("named", ["coulomb_friction"])
    assert gap["terms"][0]["parameters"]["torque"]["value"] == pytest.approx(3.0, rel=0.1)
    heavy = slide.records(overrides={"bodies.carriage.mass": 1.3})
    heavy = workflow.find(unsure, *heavy, QUICK.replace(effects=("coulomb_friction",)))
    assert heavy["verdict"] != "no gap"


def test_what_does_not_show_in_what_is_held_out_is_judged_by_all_records(slide):
    fit, judge = slide.records([{"name": "coulomb_friction", "torque": 3.0}], judged=0.0)
    rubs = FEW.replace(effects=("coulomb_friction", "joint_offset"))
    gap = workflow.find(slide.model, fit, judge, rubs)
    assert (gap["verdict"], gap["names"]) == ("named", ["coulomb_friction"])
    without, on_all = re.findall(r"([\d.]+) (?:noise floors on held-out data|on all)",
                                 gap["terms"][0]["evidence"])  # fmt: skip
    assert float(without) < 1.25 < 10.0 < float(on_all)


def test_same_seed_same_file_for_any_number_of_workers_and_progress_rises(found, cluster):
    told = []
    effects = [{"name": "viscous_friction", "damping": 20.0}]
    three = ("viscous_friction", "coulomb_friction", "sensor_bias")
    pair = QUICK.replace(effects=three, **CHEAP)
    one = found(effects, pair, progress=lambda share, stage, best: told.append(share))
    two = found(effects, pair, workers=2)
    on_cluster = found(effects, pair, workers=cluster[0])
    assert json.dumps(one, sort_keys=True) == json.dumps(two, sort_keys=True)
    assert json.dumps(one, sort_keys=True) == json.dumps(on_cluster, sort_keys=True)
    assert told[0] == 0.0
    assert told[-1] == 1.0
    assert told == sorted(told)


@pytest.mark.parametrize(
    "effects",
    [
        [{"name": "coulomb_friction", "torque": 3.0}],
        [{"name": "viscous_friction", "damping": 20.0}, {"name": "sensor_bias", "q": 0.002}],
    ],
)
def test_progress_is_in_proportion_to_simulations_within_a_factor_of_two(
    found, effects, monkeypatch
):
    """It said 90 % where half of the work, the verdict, was still to be done."""
    runs, told, run = [], [], Forward._run

    def counted(self, *arguments):
        runs.append(arguments)
        return run(self, *arguments)

    monkeypatch.setattr(Forward, "_run", counted)
    found(effects, progress=lambda share, *_: told.append((share, len(runs))))
    middle = [(share, count / len(runs)) for share, count in told if 0.2 <= share < 1.0]
    assert len(middle) > 8
    assert all(0.5 < done / share < 2.0 for share, done in middle)


def test_an_exception_of_the_progress_ends_the_search(found):
    class StopError(Exception):
        pass

    def stop(share, stage, best):
        if share > 0.04:
            raise StopError

    with pytest.raises(StopError):
        found([{"name": "viscous_friction", "damping": 20.0}], FEW, progress=stop)


def test_one_record_is_judged_by_its_last_third(slide):
    fit, _ = slide.records([{"name": "viscous_friction", "damping": 20.0}])
    gap = workflow.find(slide.model, fit[:1], [], FEW)
    assert gap["names"] == ["viscous_friction"]


def test_a_detail_that_fails_costs_no_search_and_leaves_a_note(found, monkeypatch):
    """The verdict is handed over first; a crash behind it is a sentence in the result."""

    def crash(*args):
        raise ValueError("phase must be in [-10, 10]")

    kept = []
    monkeypatch.setattr(contents, "following", crash)
    keep = lambda result, curves: kept.append(result)  # noqa: E731
    gap = found([{"name": "viscous_friction", "damping": 20.0}], FEW, keep=keep)
    assert (gap["verdict"], gap["next"]) == ("named", [])
    (note,) = gap["notes"]
    assert note == "looking for the next experiment failed: phase must be in [-10, 10]"
    (first,) = kept
    assert first["verdict"] == "named" and first["notes"] == [] and first["where"] == []
    assert gap["where"] and {**gap, **contents.EMPTY, "notes": []} == first


@pytest.mark.parametrize("higher", [1.0, 1.5])
@pytest.mark.parametrize("guess", ["joint_offset", "viscous_friction"])
def test_engines_are_compared_with_what_was_found_where_the_guess_was_another(
    slide, monkeypatch, guess, higher
):
    """On the ground, the floor is that of the robot as it is, whatever was guessed before.

    A search that would be the same is not repeated.
    """
    prepare, compared, searches = workflow.cases.prepare, [], []

    def on_ground(forward, records, held_out, suspects=(), free_names=()):
        compared.append([spec["name"] for spec in suspects])
        case = prepare(forward, records, held_out, (), free_names)
        by = higher if "viscous_friction" in compared[-1] else 1.0
        floors = [by * floor for floor in case.floors]
        return replace(case, ground=True, floor=by * case.floor, floors=floors)

    def searching(*arguments):
        searches.append(arguments)
        return Search(*arguments)

    def guessed(case, hypotheses, each):
        first = next(h for h in hypotheses if h.effect == guess)
        return hypotheses, [], [(first, first.starts()[0])]

    monkeypatch.setattr(workflow, "Search", searching)
    monkeypatch.setattr(workflow.cases, "prepare", on_ground)
    monkeypatch.setattr(workflow, "likely_hypotheses", guessed)
    shares, (fit, judge) = [], slide.records([{"name": "viscous_friction", "damping": 20.0}])
    told = lambda share, *_: shares.append(share)  # noqa: E731
    gap = workflow.find(slide.model, fit[:1], judge, FEW.replace(**CHEAP), progress=told)
    assert shares == sorted(shares)
    assert gap["names"] == ["viscous_friction"]
    again = [] if guess == "viscous_friction" else [["viscous_friction"]]
    assert compared == [[], [guess], *again]
    assert len(searches) == (2 if again and higher > 1.0 else 1)


def test_what_the_robot_cannot_be_built_with_is_dropped_and_listed(slide, monkeypatch):
    """A failing candidate ends itself, not the search."""
    real = Stribeck.constants

    def refuse(self, world, joints):
        if self.torque:
            raise ParameterError("no such bearing")
        return real(self, world, joints)

    monkeypatch.setattr(Stribeck, "constants", refuse)
    fit, judge = slide.records([{"name": "viscous_friction", "damping": 20.0}])
    bearings = FEW.replace(effects=("viscous_friction", "stribeck_friction"))
    gap = workflow.find(slide.model, fit, judge, bearings)
    assert gap["names"] == ["viscous_friction"]
    reasons = {one["effect"]: one["reason"] for one in gap["not_tried"]}
    assert reasons["stribeck_friction slide"] == "no such bearing"
    assert not any("payload" in name for name in reasons)  # nobody asked for it


def heavier(slide, factor):
    """Records of the slide with another mass of its carriage, which the model does not know."""
    fit, judge = slide.records()
    truth = Forward(Model("linear_axis", {"masses.carriage": 1.5 * factor}), [*fit, *judge])
    rng, (coarse, fine) = np.random.default_rng(3), (truth(step=s) for s in (1 / 8, 1 / 16))
    said = [2.0 * f - c for f, c in zip(fine, coarse, strict=True)]  # no step at all
    made = [
        replace(r, signals={"q": q + 5e-5 * rng.standard_normal(q.shape)})
        for r, q in zip((*fit, *judge), said, strict=True)
    ]
    return made[:2], made[2:]


def test_a_free_value_that_explains_all_is_no_gap_and_before_is_the_users_own_model(slide):
    free = QUICK.replace(free=("masses.carriage",), effects=("coulomb_friction",))
    fit, judge = heavier(slide, 1.3)
    gap = workflow.find(slide.model, fit, judge, free)
    bare = workflow.find(slide.model, fit, judge, free.replace(free=("",)))
    assert (gap["verdict"], gap["names"], gap["alarms"]) == ("no gap", [], [])
    assert gap["nuisance"]["masses.carriage"] == pytest.approx(1.95, rel=0.05)
    assert gap["gap"]["before"] == bare["gap"]["before"] > 2.0 * gap["gap"]["after"]
    assert "masses.carriage refitted" in gap["evidence"]


def test_a_free_value_far_from_what_the_robot_says_rings_an_alarm(slide):
    fit, judge = heavier(slide, 1.3)
    free = QUICK.replace(free=("masses.carriage",), effects=("armature",), free_spread=0.1)
    gap = workflow.find(slide.model, fit, judge, free)
    (alarm,) = gap["alarms"]
    assert "masses.carriage goes to" in alarm and "times what the robot says" in alarm


def test_rounded_readings_leave_a_note_and_no_verdict(slide):
    """A null whose sensor rounds is no gap, whatever the step."""
    fit, judge = slide.records()
    step = 0.002
    rounded = [
        replace(r, signals={"q": step * np.round(r.signals["q"] / step)},
                resolution={("q", "slide"): step})
        for r in (*fit, *judge)
    ]  # fmt: skip
    gap = workflow.find(slide.model, rounded[:2], rounded[2:], GapParams(effects=("quantisation",)))
    assert (gap["verdict"], gap["names"], gap["terms"]) == ("no gap", [], [])
    assert any("all readings of slide are multiples of 0.002" in note for note in gap["notes"])
    assert gap["not_tried"][0]["effect"] == "quantisation"
    assert gap["model"]["effects"] == []


def test_compensated_friction_is_named_and_less_friction_of_the_urdf_told_with_it(slide, one_joint):
    """The axis has a damping of 1 N·s/m in its URDF, the robot of the last line has none."""
    planted = {"torque": 2.0, "damping": 2.0, "velocity": 0.1}
    tried = QUICK.replace(effects=("friction_compensation", "coulomb_friction", "armature"))
    both = slide.records([{"name": "friction_compensation", **planted}])
    gap = workflow.find(slide.model, *both, tried)
    assert (gap["verdict"], gap["names"]) == ("named", ["friction_compensation"])
    for name, value in planted.items():
        assert gap["terms"][0]["parameters"][name]["value"] == pytest.approx(value, rel=0.1)
    assert [alarm.partition(":")[0] for alarm in gap["alarms"]] == [
        "friction_compensation in slide"
    ]
    found = Hypothesis("friction_compensation", "slide", (), ())
    bare = SimpleNamespace(parts=((found, ()),))
    assert contents.less_friction(one_joint("slide", "prismatic"), bare) == []
