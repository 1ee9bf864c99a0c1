# SPDX-License-Identifier: Apache-2.0
"""`loco reproduce`: arguments, verdicts on the terminal, page."""

import csv
import dataclasses
import json

import pytest

from loco_bringup.cli import main as cli
from loco_learning.networks import jobs as msd_jobs
from loco_learning.thesis import evidence
from loco_learning.thesis.evidence import Entry

SHORT = {"learner.train": 1.0, "learner.closing": 1.2, "learner.test": 1.2, "learner.stand": 0.2}


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        cli.main(["reproduce", *arguments])
    return caught.value.code


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["msb"], "no choice of loco reproduce named 'msb' (did you mean 'msd'?)"),
        (["msd", "--preset", "code"], "available: author_code, thesis"),
        (["msd", "--workers", "0"], "workers must be at least 1, got 0"),
        (
            ["hyq", "--plan", "fast"],
            "no plan named 'fast'; available: ablations, band, full, medium, mujoco, networks, quick",
        ),
    ],
)
def test_mistakes_are_one_line(arguments, text, capsys):
    assert call(*arguments) == 2
    assert text in capsys.readouterr().err


def test_verdicts_are_printed_and_the_page_is_written(tmp_path, monkeypatch, capsys):
    quick = dataclasses.replace(
        msd_jobs.PLANS["quick"], nodes=(5,), repetitions=1, budget=(0, 10), omega_nodes=(),
        powers=(), loop_repetitions=0, disturbed=(0, 0), noises=(),
    )  # fmt: skip
    monkeypatch.setitem(msd_jobs.PLANS, "quick", quick)
    asked = ("msd", "--quick", "--workers", "1", "--out", str(tmp_path))
    assert call(*asked, "--cost") == 0
    said = capsys.readouterr().out
    assert "1 of 1 runs to go, not timed" in said and not list(tmp_path.iterdir())
    assert call(*asked) == 0
    text = capsys.readouterr().out
    assert "6.5  holds by construction: The resonance of one node" in text
    assert "6.1  open: The score falls" in text and "found: rho" in text
    assert "It is the solution of the model's equation" in text
    assert (tmp_path / "README.md").is_file()
    assert "Figure 6.1" in (tmp_path / "thesis.html").read_text()
    assert (tmp_path / "runs" / "nodes_5_0.npz").is_file()


def test_claims_are_judged_from_what_ran_and_the_rest_is_open(tmp_path, monkeypatch, capsys):
    entries = {
        "clock": Entry("clock", "chapter8_clock", seeds=1, overrides=SHORT),
        "clock_short": Entry("clock_short", "chapter8_clock", seeds=1, base="clock",
                             change="a short test", overrides={**SHORT, "learner.test": 0.8}),
    }  # fmt: skip
    monkeypatch.setattr(evidence, "plan", lambda name: entries)
    assert call("clock", "--quick", "--workers", "1", "--out", str(tmp_path)) == 0
    out = capsys.readouterr().out
    assert "1 open" in out and "8.6, a short test  open" in out
    judged, beside = csv.DictReader(open(tmp_path / "verdicts.csv"))  # no entry of other claims
    assert judged["claim"] == beside["claim"] == "8.6"
    assert (judged["change"], beside["change"]) == ("", "a short test")
    assert "1 of 6 runs" in judged["reason"] and "clock slip" in judged["found"]
    assert judged["found"] != beside["found"] and judged["rule of"] == "2026-11-23"
    assert judged["engine"] == entries["clock"].engine
    numbers = json.loads((tmp_path / "numbers.json").read_text())
    assert len(numbers["8.6"]["clock_slip"]) == len(numbers["8.6, a short test"]["clock_slip"]) == 1
    page = (tmp_path / "README.md").read_text()
    assert "| 8.6 |" in page and "[clock](clock/study.html)" in page and "## Open" in page
    page = (tmp_path / "thesis.html").read_text()
    assert '<a href="clock/study.html">clock</a>' in page and "Figure" not in page


def test_a_plan_of_your_own_is_a_file(tmp_path, capsys):
    path = tmp_path / "mine.yaml"
    path.write_text("gaits: {study: tigrillo_gaits, engine: mujoco, overrides: {duration: 0.5}}\n")
    assert list(evidence.plan(str(path))) == ["gaits"]
    assert evidence.plan(str(path))["gaits"].load().variants["bound"].duration == 0.5
    for text, word in (
        ("gaits: 3\n", "gaits must be like {study: NAME}, got 3"),
        ("gaits: {studies: a}\n", "did you mean 'study'"),
        ("full: {gaits: {study: a}}\n", "no key in full of"),
        ("[1]\n", "mine.yaml"),
    ):
        path.write_text(text)
        assert call("tigrillo", "--plan", str(path)) == 2
        error = capsys.readouterr().err
        assert word in error and "mine.yaml" in error
