# SPDX-License-Identifier: Apache-2.0
"""Benches run and say what they say they do; no test looks at a time."""

import json
import re
import time

import pytest

from loco_bringup.cli.table import call
from loco_control.exceptions import NameUnknownError
from loco_sim.engines import ENGINES
from loco_workshop.bench import bare_loop, bench
from loco_workshop.bench import bolted as bench_bolted
from loco_workshop.bench import engines as bench_engines
from loco_workshop.bench import ground as bench_ground


@pytest.mark.ros
def test_graph_bench_has_all_layouts_and_shares_that_add_up():
    rows = bench.bench_graph("hyq_short")
    assert [row["layout"] for row in rows] == ["rollout, no ROS", "composed", "processes"]
    for row in rows:
        assert sum(v for key, v in row.items() if key.endswith("%")) == pytest.approx(100.0)
        assert row["x real time"] * row["tick µs"] == pytest.approx(4000.0)
        assert row["of rollout"] * row["tick µs"] == pytest.approx(rows[0]["tick µs"])


def test_help_names_every_bench(capsys):
    with pytest.raises(SystemExit):
        call("bench", "--help")
    words = set(re.findall(r"\w+", capsys.readouterr().out))
    assert set(bench.BENCHES) <= words


@pytest.mark.parametrize("name", ["messages", "rls", "bolted", "engines", "ground"])
def test_bench_prints_and_writes_its_rows(name, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(bench_bolted, "ROBOTS", {"servo_pendulum": {}})  # others: compile longer
    monkeypatch.setattr(bench_ground, "CASES", {"tigrillo": ("tigrillo", bench_ground.TWO)})
    for name_of, value in (("SECONDS", 1.0), ("TURNS", 1), ("TICKS", 5), ("WARM", 5)):
        monkeypatch.setattr(bench_ground, name_of, value)
    monkeypatch.setattr(bench_engines, "BOLTED", {"linear_axis": {}})
    monkeypatch.setattr(bench_engines, "RUNS", {"tigrillo_bound": {"duration": 1.0}})
    for name_of in ("STEPS", "TICKS", "TURNS"):
        monkeypatch.setattr(bench_engines, name_of, 2)
    out = tmp_path / "rows.json"
    assert call("bench", name, "--json", out) == 0
    rows = json.loads(out.read_text())["rows"]
    printed = capsys.readouterr().out
    assert rows and all(column in printed for column in rows[0])
    assert all(row["baseline"] == bench.BENCHES[name][1] for row in rows)
    assert max(map(len, printed.splitlines())) <= 80


@pytest.mark.parametrize(("columns", "length"), [(4, 8), (12, 8), (12, 40)])
def test_tables_of_any_shape_fit_a_terminal_and_say_everything(columns, length):
    rows = [{f"column {c}": f"{r}{c}".rjust(length, "x") for c in range(columns)} for r in range(3)]
    made = bench.lines(rows)
    assert max(map(len, made)) <= 80
    words = " ".join(made).split()
    assert all(cell in words for row in rows for cell in row.values())
    assert all(name in " ".join(made) for name in rows[0])


@pytest.mark.pybullet
@pytest.mark.parametrize("name", ["servo_pendulum", "linear_axis", "hyq_leg", "tigrillo"])
@pytest.mark.parametrize("engine", ENGINES)
def test_bolted_robots_move_alike_with_and_without_an_engine(name, engine):
    assert bench_engines.floors(name, engine) <= 1.05


def test_unknown_bench_names_the_known():
    with pytest.raises(NameUnknownError, match="graph"):
        call("bench", "speed")


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
def test_realtime_bench_has_the_graph_beside_the_bare_loop(tmp_path):
    out = tmp_path / "rows.json"
    assert call("bench", "realtime", "--json", out, "--seconds", 2.0) == 0
    rows = json.loads(out.read_text())["rows"]
    loops = ["graph, composed", "bare loop, same time", "bare loop, alone"]
    assert [row["loop"] for row in rows] == [*loops, *loops]
    assert [row["scheduling"] for row in rows] == ["as it is"] * 3 + ["SCHED_FIFO"] * 3
    for row in rows:
        assert 0.0 < float(row["p50 ms"]) <= float(row["p99 ms"]) <= float(row["max ms"])
        assert int(row["missed"].split()[-1]) >= 500
    for row in rows[::3]:
        assert "hold" in row["targets"] or "refused" in row["targets"]


def test_sleep_until_never_wakes_early_and_returns_at_once_from_the_past():
    deadline = time.monotonic() + 0.01
    bare_loop.sleep_until(deadline)
    assert time.monotonic() >= deadline
    bare_loop.sleep_until(0.0)
