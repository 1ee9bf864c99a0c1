# SPDX-License-Identifier: Apache-2.0
"""The registry of claims: every row has a rule, a measure and runs; rules give verdicts."""

import math
from pathlib import Path

import pytest

from loco_control.exceptions import NameUnknownError
from loco_learning.thesis import chapter5, chapter7, chapter8, evidence, registry
from loco_learning.thesis.evidence import Entry, Evidence
from loco_learning.thesis.registry import AGREES, DISAGREES, MEASURES, OPEN, Claim

CLAIMS = {claim.number: claim for claim in registry.claims()}
MODULES = (chapter5, chapter7, chapter8)


def test_all_47_claims_are_there():
    counts = {chapter: sum(n.startswith(f"{chapter}.") for n in CLAIMS) for chapter in "56789"}
    assert counts == {"5": 8, "6": 16, "7": 15, "8": 6, "9": 2}


@pytest.mark.parametrize("number", CLAIMS)
def test_a_claim_has_a_measure_a_rule_and_runs(number):
    claim = CLAIMS[number]
    for plan in ("quick", "medium", "full"):
        assert set(claim.evidence) & set(evidence.plan(plan))
    if claim.measure != "msd":
        assert claim.measure in MEASURES and claim.rule and claim.says and claim.item
        assert all(low <= high for low, high in claim.rule.values())


@pytest.mark.parametrize("plan", ["quick", "medium", "full", "mujoco"])
def test_every_study_of_a_plan_reads_and_serves_a_claim(plan):
    used = {name for claim in CLAIMS.values() for name in claim.evidence}
    for name, entry in evidence.plan(plan).items():
        assert name in used
        if entry.study:
            assert entry.load().variants


def test_a_plan_that_is_unknown_is_said():
    with pytest.raises(NameUnknownError, match="no plan named 'fast'"):
        evidence.plan("fast")


@pytest.mark.parametrize(
    ("value", "word"),
    [(1.0, AGREES), (2.0, AGREES), (2.1, DISAGREES), (0.0, DISAGREES), (math.nan, OPEN)],
)
def test_a_rule_gives_a_verdict(value, word, monkeypatch):
    monkeypatch.setitem(MEASURES, "mine", lambda found: {"a": value, "other": 9.0})
    claim = Claim("0.0", "here", "it is so", ("x",), "mine", {"a": (1.0, 2.0)}, "because")
    verdict = registry.judge(claim, None)
    assert verdict.verdict == word and verdict.wanted == "a 1 to 2"
    assert verdict.why == ("because" if word == DISAGREES else "")


def test_what_was_not_run_is_not_decided(tmp_path):
    nothing = Evidence(evidence.plan("quick"), tmp_path)
    for claim in CLAIMS.values():
        if claim.measure not in ("msd", "operations", "force_filter"):
            assert registry.judge(claim, nothing).verdict == OPEN, claim.number


def test_every_measure_is_tested_on_results_whose_answer_is_known():
    """Each is asked for by its name in a test of its chapter."""
    text = "".join(path.read_text() for path in Path(__file__).parent.glob("test_chapter*.py"))
    assert [name for name in MEASURES if f'MEASURES["{name}"]' not in text] == []


def test_an_entry_runs_on_its_engine_with_its_points():
    entry = Entry("map", "hyq_map", "mujoco", points=3)
    loaded = entry.load()
    assert len(list(loaded.cases())) == 9
    assert loaded.variants["open"].sim["engine"] == "mujoco"
