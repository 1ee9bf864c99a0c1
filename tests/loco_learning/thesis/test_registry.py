# SPDX-License-Identifier: Apache-2.0
"""The registry of claims: every row has a rule that can fail, a measure and runs."""

import dataclasses
import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_learning.study.trial import share_interval
from loco_learning.thesis import chapter5, chapter6, chapter7, chapter8, evidence, registry
from loco_learning.thesis.evidence import Entry, Evidence
from loco_learning.thesis.registry import AGREES, DISAGREES, HOLDS, MEASURES, OPEN, ROBOT, Bound

PLANS = ("quick", "medium", "full", "mujoco", "ablations", "networks", "band")
CLAIMS = {claim.number: claim for claim in registry.claims()}
JUDGED = [claim for claim in CLAIMS.values() if not claim.robot]
MODULES = (chapter5, chapter6, chapter7, chapter8)
ROW = {"item": "here", "says": "it is so", "from": "x", "measure": "mine", "frozen": "2026-11-28",
       "runs": 5, "rule": {"a": {"median": [1, 2]}}}  # fmt: skip


def claim(tmp_path, **changes):
    """A claim of a file with one row; a change to None leaves a key out."""
    row = {key: value for key, value in (ROW | changes).items() if value is not None}
    path = tmp_path / "claims.yaml"
    path.write_text(
        "'0.0':\n" + "".join(f"  {key}: {json.dumps(value)}\n" for key, value in row.items())
    )
    return registry.claims(path)[0]


def possible(name, bound):
    """Smallest and largest value that a number can have."""
    if bound.kind == "share" or name.startswith(("r2", "stable", "survived", "share")):
        return 0.0, 1.0
    if name.startswith("rho") or name in ("default", "calibrated"):  # correlations
        return -1.0, 1.0
    if name.endswith("spread"):  # the largest of something over its smallest
        return 1.0, math.inf
    signed = ("change", "gain", "minus_best", "_distance", "gap", "slope_per_1000")
    return -math.inf if name.endswith(signed) else 0.0, math.inf


def within(name, bound):
    """A value inside the range."""
    low, high = possible(name, bound)
    low, high = max(low, bound.low), min(high, bound.high)
    if math.isinf(high):
        return low + 1.0 if math.isfinite(low) else 0.0
    return high - 1.0 if math.isinf(low) else (low + high) / 2.0


def contrary(name, bound):
    """A possible value outside of the range; None if there is none."""
    low, high = possible(name, bound)
    if bound.low > low:
        return bound.low - 1.0 if math.isinf(low) else (low + bound.low) / 2.0
    if bound.high < high:
        return bound.high + 1.0 if math.isinf(high) else (high + bound.high) / 2.0
    return None


def made(claim, **changes):
    """Numbers with which a claim agrees, from many runs; other values by name."""
    numbers = {key: within(key, Bound("value", *limits)) for key, limits in claim.valid.items()}
    for name, bound in claim.rule.items():
        numbers[name] = drawn(bound, changes.get(name, within(name, bound)))
    return numbers


def drawn(bound, value, count=200):
    """As many runs with this value, or with this share of ones."""
    if bound.kind == "value":
        return value
    ones = np.arange(count) < value * count
    return ones.astype(float) if bound.kind == "share" else np.full(count, value)


def test_all_47_claims_are_there():
    counts = {chapter: sum(n.startswith(f"{chapter}.") for n in CLAIMS) for chapter in "56789"}
    assert counts == {"5": 8, "6": 16, "7": 15, "8": 6, "9": 2}


@pytest.mark.parametrize("number", CLAIMS)
def test_a_claim_has_a_measure_and_runs(number):
    claim = CLAIMS[number]
    assert claim.measure in MEASURES and claim.says and claim.item
    for plan in ("quick", "medium", "full"):
        assert set(claim.evidence) & set(evidence.plan(plan))


# ---- rules that can fail


@pytest.mark.parametrize("claim", JUDGED, ids=lambda claim: claim.number)
def test_a_rule_gives_the_other_verdict_for_contrary_numbers(claim):
    """Each number alone refutes its claim; none agrees with whatever comes out."""
    agreeing = HOLDS if claim.holds else AGREES
    assert registry.decide(claim, made(claim)).verdict == agreeing
    for name, bound in claim.rule.items():
        value = contrary(name, bound)
        assert value is not None, f"{name} is within its range whatever comes out"
        found = registry.decide(claim, made(claim, **{name: value}))
        assert found.verdict == DISAGREES, name


@pytest.mark.parametrize("claim", JUDGED, ids=lambda claim: claim.number)
def test_fewer_runs_than_the_rule_requires_leave_a_claim_open(claim):
    numbers = made(claim)
    for name, bound in claim.rule.items():
        few = math.nan
        if claim.runs:
            few = drawn(bound, within(name, bound))[: claim.runs - 1]
        found = registry.decide(claim, numbers | {name: few})
        assert found.verdict == OPEN
        assert found.reason.startswith("Number " + name.replace("_", " "))


def test_claims_that_are_not_judged_by_runs_say_why():
    assert [c.number for c in CLAIMS.values() if c.robot] == ["5.3", "5.5", "5.6"]
    assert [c.number for c in CLAIMS.values() if c.holds] == ["6.5", "6.16", "7.11"]
    assert [c.number for c in CLAIMS.values() if c.exact] == ["5.4"]


def test_a_changed_rule_has_a_new_date():
    """Digests of all rules, so that ranges do not change under an old date."""
    lines = Path(__file__).with_name("frozen_rules.txt").read_text().splitlines()
    assert lines == [f"{c.number} {c.frozen} {digest(c)}" for c in JUDGED], (
        "a rule changed: set its `frozen` and `after_results` in claims.yaml, then its line here"
    )


def digest(claim):
    ranges = {name: (b.kind, b.low, b.high) for name, b in claim.rule.items()}
    text = repr((ranges, claim.runs, claim.valid, claim.frozen, claim.after_results))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


# ---- what the registry refuses


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"runs": 1}, "by 1 runs; their spread needs at least 5"),
        ({"runs": None}, "by 0 runs"),
        ({"rule": {"a": {"value": [1, 2]}}}, "judges one value and does not say why"),
        ({"rule": {"a": {"value": [1, 2]}, "b": {"each": [1, 2]}}, "exact": "x", "runs": 1},
         "by 1 runs"),
        ({"rule": {"a": {"median": [None, None]}}}, "a cannot fail"),
        ({"rule": {"a": {"share": [0, 1]}}}, "a cannot fail"),
        ({"rule": {"a": {"median": [2, 1]}}}, "2 is above 1"),
        ({"rule": {"a": [1, 2]}}, "must be like {median: [low, high]}"),
        ({"rule": None}, "either a rule, or a reason in robot"),
        ({"robot": "only it knows"}, "either a rule, or a reason in robot"),
        ({"frozen": None}, "must be the date of the rule"),
    ],
)  # fmt: skip
def test_a_row_without_a_whole_rule_is_refused(changes, text, tmp_path):
    with pytest.raises(ParameterError) as caught:
        claim(tmp_path, **changes)
    assert text in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"rule": {"a": {"mean": [1, 2]}}}, "no comparison in claim 0.0.a named 'mean'"),
        ({"rules": "x"}, "no key in claim 0.0 named 'rules'"),
    ],
)
def test_a_name_that_is_unknown_is_refused(changes, text, tmp_path):
    with pytest.raises(NameUnknownError) as caught:
        claim(tmp_path, **changes)
    assert text in str(caught.value)


# ---- comparisons and verdicts


def test_an_interval_of_the_median_has_the_coverage_it_says():
    """Of 4,000 samples of ten normal numbers the interval has the median in at least 90 %."""
    draws = np.random.default_rng(1).normal(3.0, 1.0, (4000, 10))
    low, high = np.array([registry.median_interval(row) for row in draws]).T
    assert 0.9 < np.mean((low <= 3.0) & (high >= 3.0)) < 0.99
    assert registry.median_interval(np.arange(5.0)) == (0.0, 4.0)
    assert all(map(math.isnan, registry.median_interval(np.arange(4.0))))


def test_an_interval_of_a_share_is_that_of_clopper_and_pearson():
    """Limits at which 6 of 6, and 0 of 6, have a probability of 5 %."""
    low, high = share_interval(np.ones(6))
    assert low**6 == pytest.approx(0.05) and high == 1.0
    low, high = share_interval(np.zeros(6))
    assert low == 0.0 and (1.0 - high) ** 6 == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("kind", "values", "word"),
    [
        ("median", [1.2, 1.3, 1.4, 1.5, 1.6], AGREES),
        ("median", [0.9, 1.3, 1.4, 1.5, 1.6], OPEN),  # a median of 0.95 is not excluded
        ("median", [0.1, 0.2, 0.3, 0.4, 0.5], DISAGREES),
        ("median", [1.2, 1.3, 1.4, math.nan, 1.6], OPEN),  # a run without the number does not count
        ("each", [1.2, 1.3, 1.4, 1.5, 1.6], AGREES),
        ("each", [0.9, 1.3, 1.4, 1.5, 1.6], DISAGREES),
    ],
)
def test_a_number_is_judged_with_its_spread(kind, values, word, tmp_path, monkeypatch):
    monkeypatch.setitem(MEASURES, "mine", lambda found: {"a": np.array(values), "other": 9.0})
    row = claim(tmp_path, rule={"a": {kind: [1, 2]}}, why="because")
    verdict = registry.judge(row, None)
    assert verdict.verdict == word and "other 9" in verdict.text
    if word == DISAGREES:
        assert verdict.reason == "because"


def test_a_number_outside_of_its_condition_leaves_a_claim_open(tmp_path):
    row = claim(tmp_path, valid={"rising": [0, 0.5]})
    numbers = {"a": np.linspace(1.2, 1.8, 5), "rising": 0.9}
    found = registry.decide(row, numbers)
    assert (found.verdict, found.reason) == (OPEN, "Number rising is 0.9, not 0 to 0.5.")
    assert registry.decide(row, numbers | {"rising": 0.1}).verdict == AGREES


def test_a_claim_about_the_robot_gets_no_other_verdict(tmp_path, monkeypatch):
    monkeypatch.setitem(MEASURES, "mine", lambda found: {"a": 1.0})
    row = claim(tmp_path, rule=None, runs=None, frozen=None, robot="It has the springs.")
    verdict = registry.judge(row, None)
    assert (verdict.verdict, verdict.reason, verdict.text) == (ROBOT, "It has the springs.", "a 1")


def test_what_was_not_run_is_open(tmp_path):
    nothing = Evidence(evidence.plan("quick"), tmp_path)
    for claim in JUDGED:
        if claim.measure not in ("resonance", "operations", "force_filter"):
            assert registry.judge(claim, nothing).verdict == OPEN, claim.number


def test_a_verdict_follows_from_the_numbers_that_are_published(tmp_path):
    """Also where rounding moves a number over the limit of its range, or to another third digit."""
    row = claim(tmp_path, rule={"a": {"median": [1, 1.615]}})
    numbers = {"a": np.array([1.6150004, 1.6149996, 1.6150004, 1.6150004, 1.2]),
               "b": 3.0, "c": np.array([0.123456789, math.inf, math.nan])}  # fmt: skip
    verdict = registry.decide(row, numbers)
    text = registry.as_json([verdict])
    assert '"a": [1.615, 1.615, 1.615, 1.615, 1.2], "b": 3, "c": [0.123457, "inf", "nan"]' in text
    again = registry.decide(row, registry.from_json(text)[verdict.name])
    assert (again.verdict, again.text) == (verdict.verdict, verdict.text)
    assert registry.as_json([again]) == text


def test_verdicts_are_counted():
    verdicts = [registry.decide(c, made(c)) for c in CLAIMS.values()]
    agree = 47 - 3 - 3
    assert registry.tally(verdicts) == (
        f"{agree} agrees, 3 holds by construction, 3 cannot be judged without the robot"
    )


def test_every_measure_is_tested_on_results_whose_answer_is_known():
    """Each is asked for by its name in a test of its chapter."""
    text = "".join(path.read_text() for path in Path(__file__).parent.glob("test_chapter*.py"))
    assert [name for name in MEASURES if f'MEASURES["{name}"]' not in text] == []


# ---- plans


@pytest.mark.parametrize("plan", PLANS)
def test_every_study_of_a_plan_reads_and_serves_a_claim(plan):
    used = {name for claim in CLAIMS.values() for name in claim.evidence}
    for name, entry in evidence.plan(plan).items():
        assert (entry.base or name) in used
        if entry.study:
            assert entry.load().variants


def test_a_plan_has_the_runs_that_its_rules_require():
    """Seeds of each study whose rules count them; a study with one seed has one draw."""
    by_place = {"regions", "damping", "falls_coincide"}  # a run is a point of the grid
    for plan in PLANS:
        for name, entry in evidence.plan(plan).items():
            needs = [c.runs for c in JUDGED if c.evidence[0] == name and c.measure not in by_place]
            if entry.study and needs:
                study = entry.load()
                assert len(study.seeds) >= max(needs), (plan, name)
                assert all(e.draws for e in study.variants.values()) or name == "real_like"


def test_a_plan_that_is_unknown_is_said():
    with pytest.raises(NameUnknownError, match="no plan named 'fast'"):
        evidence.plan("fast")


def test_an_entry_runs_on_its_engine_with_its_points():
    entry = Entry("map", "hyq_map", "mujoco", points=3)
    loaded = entry.load()
    assert len(list(loaded.cases())) == 9
    assert loaded.variants["open"].sim["engine"] == entry.physics == "mujoco"
    assert dataclasses.replace(entry, options={"preset": "thesis"}).physics == "msd"


def test_a_claim_is_judged_by_its_runs_and_beside_by_those_with_a_change(tmp_path, monkeypatch):
    """Each change replaces the entries that it repeats; claims of other entries have no row."""
    entries = {
        "x": Entry("x", "hyq_map", points=3),
        "x_soft": Entry("x_soft", "hyq_map", base="x", change="soft"),
        "y": Entry("y", "hyq_map"),
    }
    made = {"x": 1.5, "x_soft": 9.0, "y": 1.5}
    monkeypatch.setattr(Evidence, "planned", lambda self, name: self.changed.get(name, name))
    monkeypatch.setitem(MEASURES, "mine", lambda found: {"a": np.full(5, made[found.planned("x")])})
    first, second = claim(tmp_path), dataclasses.replace(claim(tmp_path), evidence=("y",))
    verdicts = registry.judge_all([first, second], Evidence(entries, tmp_path))
    assert [(v.name, v.verdict) for v in verdicts] == [
        ("0.0", AGREES), ("0.0, soft", DISAGREES), ("0.0", AGREES)
    ]  # fmt: skip
    assert registry.tally(verdicts) == "2 agrees"


def test_a_change_is_beside_an_entry_of_its_plan(tmp_path):
    path = tmp_path / "plan.yaml"
    for text, word in (
        ("a: {study: hyq_map, base: b, change: x}", "no base of a in"),
        (
            "a: {study: hyq_map}\nb: {study: hyq_map, base: a}",
            "b must have both base and change",
        ),
    ):
        path.write_text(text)
        with pytest.raises((NameUnknownError, ParameterError)) as caught:
            evidence.plan(str(path))
        assert word in str(caught.value)


def test_chapters_7_and_8_are_judged_with_held_torques_and_ours_beside():
    """Section 4.3.2 of the thesis samples its impedances at 250 Hz."""
    for plan in ("quick", "medium", "full", "mujoco", "ablations"):
        entries = evidence.plan(plan)
        judged = {c.evidence[0] for c in JUDGED if c.number[0] in "789"}
        for name, entry in entries.items():
            if name in judged:
                drives = [each.overrides for each in entry.load().variants.values()]
                assert all(d["drives.*.torque"] == "held" for d in drives), (plan, name)
                assert all(d["drives.*.period"] == 0.004 for d in drives), (plan, name)
        beside = {e.base for e in entries.values() if e.change == "torque continuous"}
        assert beside >= {"map", "open_loop", "stiffness", "chapter8"}, plan


def test_a_range_reads_as_a_sentence():
    bounds = (Bound("each", 1, 1), Bound("each", 1, math.inf), Bound("each", -math.inf, 2),
              Bound("each", 1, 2))  # fmt: skip
    assert [b.text for b in bounds] == ["is 1", "at least 1", "at most 2", "1 to 2"]
