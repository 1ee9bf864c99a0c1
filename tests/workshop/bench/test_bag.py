# SPDX-License-Identifier: Apache-2.0
"""The bench of bag readers: all read the same numbers."""

import numpy as np

from loco_workshop.bench import bag as bench_bag


def test_all_readers_get_the_same_numbers_and_a_rate(tmp_path, monkeypatch):
    monkeypatch.setattr(bench_bag, "MESSAGES", 300)
    monkeypatch.setattr(bench_bag, "_OTHERS", 100)
    rows = bench_bag.bench_bag()
    assert [row["reader"] for row in rows] == ["ours", "rosbags", "mcap-ros2-support"]
    assert all(rate > 0 for row in rows for name, rate in row.items() if name != "reader")
    path = bench_bag.write_bag(tmp_path / "bag", 50)
    for name in ("robot_state", "motion_command", "trunk_torque"):
        read = [
            way(path, name) for way in (bench_bag._ours, bench_bag._rosbags, bench_bag._mcap_ros2)
        ]
        np.testing.assert_array_equal(read[0], read[1])
        np.testing.assert_array_equal(read[0], read[2])
