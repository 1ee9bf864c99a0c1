# SPDX-License-Identifier: Apache-2.0
"""The bench of networks: rows, and the agreement it insists on."""

import pytest

from loco_control.exceptions import DivergedError
from loco_workshop.bench import msd as module


def test_rows_say_how_much_faster_and_how_far_from_the_limit():
    rows = module.bench_msd(sizes=(20,), populations=(1, 16), threads=(1, 2), seconds=0.005)
    assert [(row["nets"], row["threads"]) for row in rows] == [(1, 1), (16, 1), (16, 2)]
    for row in rows:
        assert row["links"] == 54
        for ratio in ("x textbook", "x author", "x limit"):
            assert float(row[ratio]) > 0.0
        assert float(row["apart [m]"]) < 1e-9


def test_a_wrong_trajectory_ends_the_bench(monkeypatch):
    monkeypatch.setattr(module, "largest_difference", lambda *_: 1e-6)
    with pytest.raises(DivergedError, match=r"5 nodes: 1e-06 m from the textbook's trajectory"):
        module.bench_msd(sizes=(5,), populations=(1,), seconds=0.001)
