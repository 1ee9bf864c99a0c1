# SPDX-License-Identifier: Apache-2.0
"""Benches run and say what they say they do; no test looks at a time."""

import json

import pytest

from loco_bringup import bench, bench_bolted
from loco_control.exceptions import NameUnknownError


@pytest.mark.ros
def test_graph_bench_has_all_layouts_and_shares_that_add_up():
    rows = bench.bench_graph("hyq_short")
    assert [row["layout"] for row in rows] == ["rollout, no ROS", "composed", "processes"]
    for row in rows:
        assert sum(v for key, v in row.items() if key.endswith("%")) == pytest.approx(100.0)
        assert row["x real time"] * row["tick µs"] == pytest.approx(4000.0)


@pytest.mark.parametrize("name", ["messages", "rls", "bolted"])
def test_bench_prints_and_writes_its_rows(name, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(bench_bolted, "ROBOTS", {"servo_pendulum": {}})  # others: compile longer
    out = tmp_path / "rows.json"
    bench.show_bench(name, out)
    rows = json.loads(out.read_text())["rows"]
    printed = capsys.readouterr().out
    assert rows and all(column.split()[0] in printed for column in rows[0])


def test_unknown_bench_names_the_known():
    with pytest.raises(NameUnknownError, match="graph"):
        bench.show_bench("speed")


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
def test_realtime_bench_has_the_graph_beside_the_bare_loop(tmp_path):
    out = tmp_path / "rows.json"
    bench.show_bench("realtime", out, seconds=2.0)
    rows = json.loads(out.read_text())["rows"]
    loops = ["graph, composed", "bare loop, same time", "bare loop, alone"]
    assert [row["loop"] for row in rows] == [*loops, *loops]
    assert [row["scheduling"] for row in rows] == ["as it is"] * 3 + ["SCHED_FIFO"] * 3
    for row in rows:
        assert 0.0 < float(row["p50 ms"]) <= float(row["p99 ms"]) <= float(row["max ms"])
        assert int(row["missed"].split()[-1]) >= 500
    for row in rows[::3]:
        assert "hold" in row["targets"] or "refused" in row["targets"]
