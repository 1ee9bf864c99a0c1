# SPDX-License-Identifier: Apache-2.0
"""`loco gap fleet`: its files and words, and one line for every mistake."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from loco_bringup.cli import main as cli
from loco_bringup.gap.fleet import page, terminal
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_sim.plant.model import Model

RULES = """format: 1
time: {column: t}
columns:
  - {column: q, role: q, joint: slide, unit: m}
  - {column: p, role: command_position, joint: slide, unit: m}
"""


def call(*arguments):
    """Exit code of a command line."""
    with pytest.raises(SystemExit) as end:
        cli.main(["gap", "fleet", *map(str, arguments)])
    return end.value.code


def slide(seed):
    """Text of a table of 3 s of a slide that lacks nothing."""
    rng, t = np.random.default_rng(seed), np.arange(750) / 250.0
    p = 0.08 * np.clip(t / 0.2, 0.0, 1.0) * np.sin(2 * np.pi * rng.uniform(0.5, 2.0) * t)
    empty = Record("x", t, {"position": p[:, None]}, ("slide",), {"q": p[:, None]}, ("slide",))
    q = Forward(Model("linear_axis"), [empty])((), step=1 / 8)[0][:, 0]
    q = q + 5e-5 * rng.standard_normal(len(t))
    rows = "\n".join(f"{a:.3f},{b:.7f},{c:.7f}" for a, b, c in zip(t, q, p, strict=True))
    return f"t,q,p\n{rows}\n"


@pytest.fixture
def folder(tmp_path):
    """Two recordings of a slide, with their mapping, as ROBOT/DAY/FILE."""
    root = tmp_path / "recordings"
    for k, day in enumerate(("monday 2", "monday 10")):
        path = root / "slide" / day / "run.csv"
        path.parent.mkdir(parents=True)
        path.write_text(slide(k))
    (tmp_path / "mapping.yaml").write_text(RULES)
    return root


def test_a_healthy_fleet_gets_its_files_and_a_draft_that_may_be_corrected(folder, tmp_path, capsys):
    options = "--robot", "linear_axis", "--mapping", tmp_path / "mapping.yaml", "--workers", 1
    out = tmp_path / "out"
    assert call(folder, *options, "--out", out) == 0
    said = capsys.readouterr()
    assert "recordings.csv is a draft" in said.out
    assert "2 recordings of 1 robot: no effect is named." in said.out
    assert "min left" in said.err
    result = json.loads((out / terminal.RESULT).read_text())
    assert [one["day"] for one in result["robots"][0]["days"]] == ["monday 2", "monday 10"]
    (name,) = [name for name in terminal.TABLES if (out / name).is_file()]
    if name == terminal.CSV:
        rows = list(csv.DictReader((out / name).read_text().splitlines()))
        assert [row["day"] for row in rows] == ["monday 2", "monday 10"]
    assert "no effect is named" in (out / terminal.PAGE).read_text()
    draft = out / terminal.DRAFT
    draft.write_text(draft.read_text().replace(",slide,monday 10", ",other,monday 10"))
    (folder / "slide" / "monday 10" / "bad.csv").write_text("t,q,p\n0,1,x\n")
    draft.write_text(draft.read_text() + "slide/monday 10/bad.csv,other,monday 10\n")
    (folder / "slide" / "monday 10" / "new.csv").write_text("t,q,p\n")
    assert call(folder, *options, "--out", out) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "not in it, and left out: 1 recording, slide/monday 10/new.csv first" in said
    assert "2 recordings of 2 robots" in said
    assert "skipped: slide/monday 10/bad.csv: " in said


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("--workers", 0), "workers must be at least 1, got 0"),
        (("--set", "rounds=0"), "fleet.rounds must be in [1, 5]"),
        (("--set", "nonsense=1"), "nonsense"),
        (("--effects", "nonsense"), "nonsense"),
        (("--robot", "nonsense"), "nonsense"),
    ],
)
def test_a_wrong_option_is_one_line(folder, tmp_path, capsys, change, says):
    options = ["--robot", "linear_axis"] if change[0] != "--robot" else []
    options += ["--mapping", tmp_path / "mapping.yaml", "--out", tmp_path / "out"]
    assert call(folder, *options, *change) == 2
    error = capsys.readouterr().err
    assert says in error and error.count("\n") == 1


def test_a_fleet_needs_a_robot_and_a_folder(folder, tmp_path, capsys):
    assert call(folder) == 2
    assert "wants --robot" in capsys.readouterr().err
    assert call(tmp_path / "nowhere", "--robot", "linear_axis") == 2
    assert "there is no folder of recordings at" in capsys.readouterr().err


def effect(**changes):
    """An effect in a robot, as in ``fleet.json``."""
    size = {"size": 1.5, "low": 1.4, "high": 1.6}
    days = [{"day": f"day {d}", **size} for d in (1, 2, 10)]
    return {"effect": "coulomb_friction", "place": "knee", "has": True, "probability": 0.9999,
            "course": "begins", "day": "day 2", "day_probability": 0.97, **size, "unit": "N·m",
            "days": days, **changes}  # fmt: skip


def result(**changes):
    """Contents of ``fleet.json`` of a robot."""
    robot = {"robot": "<b>arm</b>", "recordings": 9, "unexplained": 1, "effects": [effect()],
             "days": [{"day": f"day {d}", "recordings": 3} for d in (1, 2, 10)],
             "searches": [{"day": "day 10", "verdict": "named", "evidence": "It is."}]}  # fmt: skip
    return {"robot": "arm", "recordings": 9, "settings": {}, "robots": [robot], "skipped": [],
            "effects": [{**effect(), "parameter": "torque", "robots": ["arm"],
                         "spread_robots": 0.1, "spread_days": 0.01}],
            "unexplained": [{"file": "f", "robot": "arm", "day": "day 1", "before": 9.0,
                             "after": 3.0}], **changes}  # fmt: skip


def test_words_say_who_has_it_since_when_and_how_sure():
    first, second = page.lines(result())
    assert first == "9 recordings of 1 robot: 1 with an effect; 1 recording unexplained."
    assert second.endswith(
        "coulomb friction in knee, 1.5 N·m (1.4 to 1.6) since day 2 (probability 0.97); "
        "probability over 0.999"
    )
    always = effect(course="always", day=None, day_probability=None)
    assert page.when(always).startswith("1.5 N·m (1.4 to 1.6) on all days; ")
    wrong = result()
    wrong["robots"][0]["searches"][0]["verdict"] = "set-up"
    assert page.lines(wrong)[-1].endswith("set-up on day 10: It is.")


def test_the_page_shows_all_and_names_of_robots_are_no_html():
    text = page.page(result())
    assert "<b>arm</b>" not in text and "since day 2" in text
    assert "Coulomb friction in knee" in text and "Not shown" not in text
    assert page.page(result()) == text
    assert "no effect is named" in page.page(result(robots=[], effects=[], unexplained=[]))
