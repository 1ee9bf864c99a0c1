# SPDX-License-Identifier: Apache-2.0
"""`loco study` on a grid: cost, table, page of maps, and one line for a mistake."""

import json
import re
import shlex

import pytest

from loco_bringup.cli import main as cli
from loco_bringup.cli import table

TEXT = """
description: two by two
variants: {open: {experiment: hyq_trot_open, learner.stand: 0.2, learner.train: 1.2}}
axes:
  gait.speed: {linspace: [0.1, 0.25, 2]}
  gait.step_height: [0.05, 0.1]
phase: train
metrics: [speed, power]
map: {legal: {speed: [0, 1]}}
"""


def call(*arguments):
    with pytest.raises(SystemExit) as caught:
        cli.main(["study", *map(str, arguments)])
    return caught.value.code


def test_a_grid_leaves_tables_and_a_page_whose_cells_know_their_cases(tmp_path, capsys):
    (tmp_path / "mine.yaml").write_text(TEXT)
    out = tmp_path / "out"
    assert call(tmp_path / "mine.yaml", "--workers", 1, "--out", out) == 0
    assert "open gait.speed 0.1 gait.step_height 0.05 seed 0: survived" in capsys.readouterr().out
    assert {"cases.csv", "cases.npz", "study.html", "map_open_speed.png"} <= set(
        path.name for path in out.iterdir()
    )
    page = (out / "study.html").read_text()
    details = json.loads(re.search(r'id="cases">(.*)</script>', page)[1])
    assert set(details) == {f"open_{i:02d}_{j:02d}_0" for i in (0, 1) for j in (0, 1)}
    (panel,) = json.loads(re.search(r'<script type="application/json">(.*?)</script>', page)[1])[
        "panels"
    ]
    links = {link for layer in panel["layers"] for link in layer["links"]}
    assert links == {f"#case-{name}" for name in details}
    words = shlex.split(details["open_01_00_0"]["run it, with a moving picture"])
    assert words[0] == "./loco"
    _, options = table.parse(words[1:])
    assert {"gait.speed=0.25", "gait.step_height=0.05", "learner.train=1.2"} <= set(options.set)


def test_cost_alone_runs_three_cases(tmp_path, capsys):
    more = TEXT.replace("0.25, 2]", "0.25, 6]")
    (tmp_path / "mine.yaml").write_text(more)
    out = tmp_path / "out"
    assert call(tmp_path / "mine.yaml", "--cost", "--workers", 1, "--out", out) == 0
    assert "9 runs to go" in capsys.readouterr().err.replace("\n", " ")
    assert len(list(out.glob("open_*.npz"))) == 3 and not (out / "study.html").exists()


@pytest.mark.parametrize(
    ("text", "arguments", "message"),
    [
        (TEXT.replace("[0.05, 0.1]", "[]"), [], "gait.step_height has no values: give a list"),
        (TEXT.replace("step_height: [", "stepheight: ["), [], "did you mean 'step_height'?"),
        (TEXT, ["--points", "0"], "points must be at least 1, got 0"),
        (TEXT, ["--scheduler", "tcp://127.0.0.1:9"], "no dask scheduler answers"),
    ],
)
def test_mistakes_are_one_line(tmp_path, monkeypatch, capsys, text, arguments, message):
    monkeypatch.setattr("loco_learning.jobs.cluster.CONNECT_SECONDS", 0.5)
    (tmp_path / "mine.yaml").write_text(text)
    assert call(tmp_path / "mine.yaml", "--out", tmp_path / "out", *arguments) == 2
    error = capsys.readouterr().err
    assert message in error and error.startswith("loco: ") and error.count("\n") == 1
