# SPDX-License-Identifier: Apache-2.0
"""`loco reinforce contest`: its table, what is missing in it, and mistakes."""

from __future__ import annotations

import math

import pytest

from loco_bringup.cli.main import main
from loco_workshop import contest
from loco_workshop import contest_terminal as terminal
from loco_workshop.contest import Case


def case(method, seed, speed, falls=0, cost=0.4):
    row = {"speed": speed, "cost": cost, "falls": falls, "count": 4}
    return Case(method, seed, 600.0, 1.0, {name: row for name in ("calm", "pushed", "bodies")})


CASES = [
    case("two steps", 0, 0.2, 1),
    case("two steps", 1, 0.3, 2, math.nan),
    Case("two steps", 2, 0.0, 1.0, {}, "it fell"),
    Case("ppo", 0, 0.0, 1.0, {}, "stable_baselines3 is not installed"),
]


def test_a_row_has_mean_and_range_and_leaves_out_what_has_no_controller():
    assert terminal.rows(CASES) == [
        ["two steps", "2", "0.250 (0.200 … 0.300)", "0.400 (0.400 … 0.400)", "3 of 8",
         "0.250 (0.200 … 0.300)", "3 of 8", "0.250 (0.200 … 0.300)", "3 of 8"]
    ]  # fmt: skip
    assert terminal.rows([case("ppo", 0, 0.0, cost=math.nan)])[0][3] == "–"


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main(["reinforce", "contest", *map(str, arguments)])
    return ended.value.code


def test_the_command_writes_the_table_and_says_why_a_way_is_missing(tmp_path, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(contest, "run", lambda params, *rest: asked.append(params) or CASES)
    assert run("--out", tmp_path, "--seeds", 3, "--seconds", 700) == 0
    printed = capsys.readouterr().out
    assert "12 cases of 700 s of simulated time" in printed
    assert "ppo: stable_baselines3 is not installed" in printed and "two steps: it fell" in printed
    assert (asked[0].seeds, asked[0].seconds) == (3, 700.0)
    table = (tmp_path / "table.md").read_text()
    assert table.count("\n| two steps |") == 1 + 3 and "| ppo | 0 |" in table


@pytest.mark.parametrize(("option", "value"), [("--seeds", 0), ("--seconds", 0)])
def test_mistakes_are_refused_in_one_line(option, value, tmp_path, capsys):
    assert run(option, value, "--out", tmp_path) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and option.strip("-") in said[0]
