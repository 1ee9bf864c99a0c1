# SPDX-License-Identifier: Apache-2.0
"""Benches run and say what they say they do; no test looks at a time."""

import json

import pytest

from loco_bringup import bench
from loco_control.exceptions import NameUnknownError


@pytest.mark.ros
def test_graph_bench_has_all_layouts_and_shares_that_add_up():
    rows = bench.bench_graph("hyq_short")
    assert [row["layout"] for row in rows] == ["rollout, no ROS", "composed", "processes"]
    for row in rows:
        assert sum(v for key, v in row.items() if key.endswith("%")) == pytest.approx(100.0)
        assert row["x real time"] * row["tick µs"] == pytest.approx(4000.0)


@pytest.mark.parametrize("name", ["messages", "rls"])
def test_bench_prints_and_writes_its_rows(name, tmp_path, capsys):
    out = tmp_path / "rows.json"
    bench.show_bench(name, out)
    rows = json.loads(out.read_text())["rows"]
    printed = capsys.readouterr().out
    assert rows and all(column.split()[0] in printed for column in rows[0])


def test_unknown_bench_names_the_known():
    with pytest.raises(NameUnknownError, match="graph"):
        bench.show_bench("speed")
