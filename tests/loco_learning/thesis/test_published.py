# SPDX-License-Identifier: Apache-2.0
"""Verdicts in the documentation are those of today's rules for the numbers that are kept there."""

import csv
import re
from collections import Counter
from pathlib import Path

import pytest

from loco_learning.thesis import registry
from loco_learning.thesis.registry import OPEN, ROBOT

DOCS = Path(__file__).parents[3] / "docs"
FOLDERS = sorted(path.parent.relative_to(DOCS) for path in DOCS.glob("results/**/numbers.json"))
CLAIMS = {claim.number: claim for claim in registry.claims()}


def rows(folder):
    return list(csv.DictReader((DOCS / folder / "verdicts.csv").read_text().splitlines()))


def test_there_are_results_of_every_chapter():
    chapters = {row["claim"].split(".")[0] for folder in FOLDERS for row in rows(folder)}
    assert chapters == set("56789")


@pytest.mark.parametrize("folder", FOLDERS, ids=str)
def test_a_published_verdict_follows_from_its_numbers(folder):
    numbers = registry.from_json((DOCS / folder / "numbers.json").read_text())
    for row in rows(folder):
        claim = CLAIMS[row["claim"]]
        assert (row["rule"], row["rule of"]) == (claim.rule_text, claim.since), claim.number
        name = f"{claim.number}, {row['change']}" if row["change"] else claim.number
        if numbers.get(name):
            verdict = registry.decide(claim, numbers[name])
            assert (row["verdict"], row["found"]) == (verdict.verdict, verdict.text), claim.number
        else:  # not run, or numbers of single runs were not kept
            assert row["verdict"] == (ROBOT if claim.robot else OPEN), claim.number
        assert row["reason"] or row["verdict"] == registry.AGREES


def test_the_page_counts_the_published_verdicts():
    """Each folder has a row with the numbers of its verdicts, in the order of `VERDICTS`."""
    table = re.findall(r"\]\((results/[^)]*)/[^/)]*\)([^\n]*)", (DOCS / "thesis.md").read_text())
    counted = {Path(folder): cells for folder, cells in table if cells.count("|") > 5}
    assert sorted(counted) == FOLDERS
    for folder, cells in counted.items():
        counts = Counter(row["verdict"] for row in rows(folder) if not row["change"])
        numbers = [int(cell) for cell in cells.split("|")[-6:-1]]
        assert numbers == [counts[verdict] for verdict in registry.VERDICTS], folder


def test_each_disagreement_is_on_the_page_of_ablations():
    """Its row says what was changed one at a time, or that nothing was."""
    page = (DOCS / "thesis_ablations.md").read_text().partition("## Claims by their causes")[2]
    listed = re.findall(r"\b[5-9]\.\d+\b", " ".join(re.findall(r"^\| ([^|]*)\|", page, re.M)))
    disagree = {row["claim"] for folder in FOLDERS for row in rows(folder)
                if row["verdict"] == registry.DISAGREES and not row["change"]}  # fmt: skip
    assert disagree <= set(listed) and len(disagree) > 5


NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")
ROW = re.compile(r"\| (\d\.\d+), [^|]*\|[^|]*\|([^|]*)\|([^|]*)\|")


def rounded(text: str) -> set[str]:
    return {f"{float(number):.2g}" for number in NUMBER.findall(text)}


def test_the_table_of_both_torque_loops_has_the_numbers_of_the_run():
    run = rows("results/thesis_quick_held")
    found = {(row["claim"], row["change"]): rounded(row["found"]) for row in run}
    lines = map(ROW.match, (DOCS / "thesis.md").read_text().splitlines())
    table = [line.groups() for line in lines if line]
    assert len(table) == 10
    for claim, held, continuous in table:
        assert rounded(held) <= found[claim, ""], claim
        assert rounded(continuous) <= found[claim, "torque continuous"], claim
