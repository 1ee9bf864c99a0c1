# SPDX-License-Identifier: Apache-2.0
"""`loco gap check`: what it prints and writes, and recordings that it refuses."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import pytest

from loco_bringup.cli import main as cli
from loco_bringup.gap import check

T = np.arange(200) / 100.0
LATE = 0.04  # [s] behind the command


def good(t):
    return 0.4 * np.sin(3.0 * (t - LATE)) + 0.2 * np.sin(15.0 * (t - LATE))


MAPPING = """format: 1
time: {column: t, unit: s}
columns:
  - {column: goal, role: command_position, joint: pivot, unit: rad}
  - {column: angle, role: q, joint: pivot, unit: rad}
"""


@pytest.fixture
def write(tmp_path):
    """Function that writes a recording of the servo pendulum."""

    def make(name, angle):
        (tmp_path / "mapping.yaml").write_text(MAPPING)
        goal = good(T + LATE)
        rows = zip(T, goal, angle(T), strict=True)
        text = "".join(f"{t:.4f},{g:.6f},{a:.6f}\n" for t, g, a in rows)
        path = tmp_path / name
        path.write_text("t,goal,angle\n" + text)
        return path

    return make


def call(*arguments):
    """Exit code of a command line."""
    with pytest.raises(SystemExit) as end:
        cli.main(["gap", "check", *map(str, arguments)])
    return end.value.code


def test_it_writes_a_page_and_json_and_refuses_what_is_no_use(write, tmp_path, capsys):
    moved, in_degrees = write("moved.csv", good), write("degrees.csv", lambda t: 57.3 * good(t))
    out = tmp_path / "out"
    given = "--robot", "servo_pendulum", "--workers", "1", "--out", out
    assert call(moved, in_degrees, *given) == 2
    said = capsys.readouterr().out
    assert "not usable as it is" in said and "deg" in said
    assert "viscous" in said and "a search takes about" in said
    values = json.loads((out / check.JSON).read_text())
    assert values["verdict"] == check.UNUSABLE
    assert [r["name"] for r in values["recordings"]] == ["moved"]
    assert values["recordings"][0]["lag_ms"]["pivot"] == pytest.approx(1e3 * LATE, abs=4.0)
    assert "coulomb friction" in (out / check.PAGE).read_text()

    assert call(moved, *given, "--json") == 0
    values = json.loads(capsys.readouterr().out)
    assert values["verdict"] == check.WARNED and values["refused"] == []
    assert any("last third" in line for line in values["missing"])


def test_notes_of_reading_are_printed(write, tmp_path, capsys):
    moved = write("moved.csv", good)
    lines = moved.read_text().splitlines()
    lines[20:22] = lines[21:19:-1]
    moved.write_text("\n".join(lines))
    assert call(moved, "--robot", "servo_pendulum", "--workers", "1", "--out", tmp_path / "o") == 0
    assert "moved: samples were not in the order" in " ".join(capsys.readouterr().out.split())


def test_one_line_for_every_mistake(write, tmp_path, capsys):
    still = write("still.csv", lambda t: 0.0 * t)
    assert call(still, "--robot", "servo_pendulum", "--out", tmp_path / "out") == 2
    assert "constant" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert call(still) == 2
    assert "--robot" in capsys.readouterr().err
    assert call(still, "--robot", "servo_pendulum", "--out", tmp_path) == 2
    assert "other files" in capsys.readouterr().err


def test_a_wrong_set_up_is_told_with_its_line_and_nothing_is_tried(write, tmp_path, capsys):
    turned = write("turned.csv", lambda t: -good(t))
    given = "--robot", "servo_pendulum", "--workers", "1"
    assert call(turned, *given, "--out", tmp_path / "out") == 2
    said = " ".join(capsys.readouterr().out.split())
    assert check.WRONG in said and "pivot moves against its command" in said
    assert "say sign: -1 at q of pivot in mapping.yaml" in said
    values = json.loads((tmp_path / "out" / check.JSON).read_text())
    assert values["verdict"] == check.WRONG and values["effects"] == []
    assert "moves against its command" in (tmp_path / "out" / check.PAGE).read_text()

    with pytest.raises(SystemExit) as end:
        cli.main(["gap", str(turned), *given, "--out", str(tmp_path / "gap")])
    assert end.value.code == 2
    assert "the set-up is wrong" in capsys.readouterr().out
    result = json.loads((tmp_path / "gap" / "gap.json").read_text())
    assert result["verdict"] == "set-up" and result["names"] == [] and result["terms"] == []
    assert "moves against its command" in (tmp_path / "gap" / "gap.html").read_text()


def test_fix_chooses_none_of_two_ways_and_says_so(write, tmp_path, capsys):
    turned = write("turned.csv", lambda t: -good(t))
    given = "--robot", "servo_pendulum", "--workers", "1"
    assert call(turned, *given, "--fix", "--out", tmp_path / "out") == 2
    said = " ".join(capsys.readouterr().out.split())
    assert "--fix leaves out: sign of pivot" in said and "written:" not in said
    assert not (tmp_path / "out" / "mapping.yaml").exists()


def test_fix_writes_the_lines_into_new_files_and_they_mend(write, tmp_path, capsys):
    in_degrees = write("degrees.csv", lambda t: 57.29578 * good(t))
    before = {p: p.read_text() for p in tmp_path.iterdir()}
    given, out = ("--robot", "servo_pendulum", "--workers", "1"), tmp_path / "out"
    assert call(in_degrees, *given, "--fix", "--out", out) == 2
    said = " ".join(capsys.readouterr().out.split())
    assert "unit: deg at q of pivot" in said and f"--mapping {out / 'mapping.yaml'}" in said
    assert {p: p.read_text() for p in before} == before
    assert call(in_degrees, *given, "--fix", "--out", out, "--mapping", out / "mapping.yaml") == 0
    assert not (out / "mapping_2.yaml").exists()
    assert json.loads((out / check.JSON).read_text())["setup"] == []


@pytest.mark.parametrize("given", [None, Path("my mapping.yaml")])
@pytest.mark.parametrize("key", ["--robot", "--mapping"])
def test_the_next_command_has_what_was_given_and_what_was_fixed(given, key):
    fixed = {key: Path("out/new.yaml")}
    line = check.next_lines("servo_pendulum", ["a log.csv"], given, {"setup": []}, fixed)[-1]
    words = shlex.split(line.partition("loco gap ")[2])
    robot, mapping = ("out/new.yaml", given) if key == "--robot" else ("servo_pendulum", fixed[key])
    wanted = ["a log.csv", "--robot", robot, *(["--mapping", str(mapping)] if mapping else [])]
    assert words == wanted
