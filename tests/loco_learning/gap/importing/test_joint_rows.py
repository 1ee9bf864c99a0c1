# SPDX-License-Identifier: Apache-2.0
"""A table with a row for each joint says what one with a column for each joint says."""

import numpy as np
import pytest

from loco_learning.gap.drafting.draft import of_table
from loco_learning.gap.drafting.joints import Joints
from loco_learning.gap.importing import importing, tables
from loco_learning.gap.recordings import mapping
from loco_sim.plant.model import load_any

N = 200
ROBOT = load_any("hyq_leg").make_robot()
J = ROBOT.joints
T = 0.01 * np.arange(N)
Q = 0.4 * np.stack([np.sin(4.0 * T), np.cos(5.0 * T), np.sin(3.0 * T) - 2.0], axis=1)
GOAL = np.roll(Q, -2, axis=0)


def written(folder, name, ids, apart=0.0, order=lambda rows: rows):
    """Table of a bus that asks its motors in turn, `apart` seconds one after the other."""
    rows = [f"{T[i] + apart * j:.6f},{ids[j]},{Q[i, j]:.6f},{GOAL[i, j]:.6f},24.1"
            for i in range(N) for j in range(3)]  # fmt: skip
    head = f"time,{name},position,goal_position,voltage"
    (folder / "a.csv").write_text("\n".join([head, *order(rows)]) + "\n")
    return folder / "a.csv"


@pytest.mark.parametrize("apart", [0.0, 0.002])
@pytest.mark.parametrize(
    ("name", "ids"), [("motor_id", (1, 2, 3)), ("id", (0, 1, 2)), ("joint", J), ("Joint Name", J)]
)
def test_each_joint_has_its_readings(tmp_path, name, ids, apart):
    path = written(tmp_path, name, ids, apart)
    table = tables.read(path)
    rules = mapping.loads(of_table(table, Joints(J)))
    assert {(c.role, c.place) for c in rules.columns} == {
        (role, joint) for role in ("q", "command_position") for joint in J
    }
    assert "voltage" in table.columns and rules.time == "time"
    (record,) = importing.load(path, ROBOT, rules)
    assert any(f"{name} says the joint of each row" in note for note in record.notes)
    read = record.joints_of(ROBOT, "q")
    start = T[1] if apart else 0.0  # where all joints have been read
    for j in range(3):
        true = np.interp(record.t + start, T + apart * j, Q[:, j])
        assert np.nanmax(np.abs(read[:, j] - true)[5:-5]) < 2e-3


def by_joint(rows):
    return rows[::3] + rows[1::3] + rows[2::3]


@pytest.mark.parametrize(
    ("name", "ids", "order"),
    [
        ("motor_id", (1, 1, 1), list),  # one joint
        ("motor_id", (1, 2, 3), by_joint),  # one after the other
        ("motor_speed", (1, 2, 3), list),  # a signal
        ("motor_id", (1.5, 2.5, 3.5), list),  # a signal,
    ],
)
def test_other_columns_divide_no_rows(tmp_path, name, ids, order):
    table = tables.read(written(tmp_path, name, ids, order=order))
    assert list(table.columns) == ["time", name, "position", "goal_position", "voltage"]


def test_a_signal_of_a_few_steps_is_no_joint(tmp_path):
    steps = np.random.default_rng(0).integers(0, 3, N)
    lines = [f"{t:.3f},{s},{q:.5f}" for t, s, q in zip(T, steps, Q[:, 0], strict=True)]
    (tmp_path / "a.csv").write_text("\n".join(["t,motor,position", *lines]))
    assert list(tables.read(tmp_path / "a.csv").columns) == ["t", "motor", "position"]
