# SPDX-License-Identifier: Apache-2.0
"""`loco optimise`: searches, resumes, tells, and refuses in one line."""

from __future__ import annotations

import pytest

from loco_bringup.cli import optimise
from loco_bringup.cli.main import main
from loco_learning.gaits import search as gait_search
from loco_learning.jobs import cluster
from loco_learning.runs import gait_file
from loco_learning.search.population import Progress

QUICK = ["--duration", "1", "--evaluations", "4", "--population", "4", "--workers", "0"]


@pytest.fixture(autouse=True)
def few_checks(monkeypatch):
    monkeypatch.setattr(gait_search, "CHECKS", 1)
    monkeypatch.setattr(cluster, "CONNECT_SECONDS", 0.5)


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main(["optimise", *map(str, arguments)])
    return ended.value.code


def test_a_search_writes_its_files_and_a_second_one_starts_from_its_gait(tmp_path, capsys):
    out = tmp_path / "one"
    assert run("tigrillo_walk", *QUICK, "--seeds", 2, "--out", out, "--gif") == 0
    files = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    seeds = {f"seed_{k}/{name}" for k in (0, 1) for name in ("evaluations.jsonl", "gait.yaml")}
    assert files == seeds | {"gait.yaml", "convergence.png", "gait.gif"}
    printed = capsys.readouterr().out
    assert "speed" in printed and "convergence.png" in printed
    best = gait_file.load(out / "gait.yaml")
    assert best.speed == max(gait_file.load(out / f"seed_{k}/gait.yaml").speed for k in (0, 1))
    before = (out / "seed_0/evaluations.jsonl").read_bytes()
    assert run("tigrillo_walk", *QUICK, "--seeds", 2, "--out", out) == 0
    assert (out / "seed_0/evaluations.jsonl").read_bytes() == before
    warm = tmp_path / "warm"
    start = ("--from", out / "gait.yaml", "--sigma", 0.001)
    assert run("tigrillo_walk", *QUICK, *start, "--out", warm) == 0
    found = gait_file.load(warm / "gait.yaml").parameters
    for name, value in best.parameters.items():
        assert found[name] == pytest.approx(value, abs=0.02)


def test_a_search_that_finds_only_falls_says_so(tmp_path, monkeypatch, capsys):
    fallen = gait_search.Score(1.5, "fell: roll", {"speed": 0.0, "falls": 1})
    monkeypatch.setattr(gait_search.GaitProblem, "__call__", lambda self, x: fallen)
    assert run("tigrillo_walk", *QUICK, "--out", tmp_path) == 3
    assert "even the best gait failed: fell: roll" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tigrillo_trot"], "no choice for GaitSearchParams.gait named 'tigrillo_trot'"),
        (["tigrillo_walk", "--robot", "tigrilo"], "did you mean 'tigrillo'"),
        (["tigrillo_walk", "--from", "nowhere.yaml"], "there is no gait file nowhere.yaml"),
        (["tigrillo_walk", "--seeds", "0"], "seeds must be at least 1"),
        (["tigrillo_walk", "--randomise", "2"], "randomise must be in [0, 1]"),
        (["tigrillo_walk", "--scheduler", "tcp://127.0.0.1:9"], "no dask scheduler answers"),
    ],
)
def test_a_mistake_gets_one_line(tmp_path, capsys, arguments, message):
    assert run(*arguments, *QUICK, "--out", tmp_path) == 2
    error = capsys.readouterr().err
    assert message in error and error.count("\n") == 1


def test_the_live_line_tells_what_a_person_wants_to_know():
    p = Progress(3, 30, 600, -0.12, 0.1, 0.15, 2, "fell: pitch", 1.5, 380.0, None)
    assert optimise.line(p) == (
        "generation 3, best -0.12, step 0.15, 1.50 evaluations/s, 6.3 min left, "
        "2 failed (fell: pitch)"
    )
