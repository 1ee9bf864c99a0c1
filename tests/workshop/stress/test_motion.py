# SPDX-License-Identifier: Apache-2.0
"""The judge of the safe state sees what the joints do, whatever the plant says of itself."""

import sys
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import yaml

from loco_workshop.stress.faults import SAFE_TICKS, doubts, run_topic
from loco_workshop.stress.motion import Motion

HERE = Path(__file__).resolve().parent


def states(dq, tau):
    """Records of one joint."""
    kind = [("tick", "<u8"), ("dq", "<f8", (1,)), ("tau", "<f8", (1,))]
    rows = [(10 + i, (v,), (t,)) for i, (v, t) in enumerate(zip(dq, tau, strict=True))]
    return np.array(rows, dtype=kind)


def test_drives_that_only_brake_are_damped():
    motion = Motion(states([1.0, 0.9, 0.5, 0.2], [0.0, -3.0, -2.0, -1.0]))
    assert motion.is_damped(11, 13) and not motion.is_driven(11, 13)


def test_a_tick_of_driving_is_none_even_if_ten_times_as_much_is_braked():
    motion = Motion(states([1.0, 0.9, 0.5, 0.6, 0.5], [0.0, -9.0, -9.0, 2.8, -9.0]))
    assert not motion.is_damped(11, 14) and motion.is_driven(11, 14)
    assert motion.is_damped(11, 12) and motion.is_damped(14, 14)


def test_a_joint_that_turns_round_within_a_tick_is_forgiven():
    motion = Motion(states([1.0, -0.01, -0.3], [-2.0, -0.1, 0.5]))
    assert motion.is_damped(11, 12)


def test_missing_states_and_no_motion_are_no_proof():
    still = Motion(states([0.0, 0.0, 0.0], [5.0, 5.0, 5.0]))
    assert not still.is_damped(11, 12)
    braked = Motion(np.delete(states([1.0, 0.9, 0.5, 0.2], [0.0, -3.0, -2.0, -1.0]), 2))
    assert not braked.is_damped(11, 13)
    assert not braked.is_damped(20, 22)


def test_the_power_of_drives_is_that_which_they_put_in():
    motion = Motion(states([1.0, 1.0, -1.0, 1.0], [4.0, -9.0, -2.0, 0.0]))
    assert motion.power(10, 13) == 1.0  # it turned round in tick 12
    assert motion.power(20, 22) == 0.0


def test_commands_that_come_for_moments_are_not_taken_for_a_robot_at_rest():
    driven, braked = (np.ones(90), np.full(90, 4.0)), (np.full(90, 0.1), np.full(90, -1.0))
    motion = Motion(states(*(np.concatenate(parts) for parts in zip(driven, braked, strict=True))))
    assert doubts(motion, [(115, 99)], []) == []
    assert doubts(motion, [(115, 99), (185, 169)], [165]) == []  # 4 ticks of commands
    rest = doubts(motion, [(185, 169)], [])
    assert rest == ["the robot was at rest in the 50 ticks before 169"]
    # After a while of commands it has to move again.
    assert doubts(motion, [(115, 99), (185, 169)], [110]) == rest


def node_set(folder, plant):
    source = resources.files("loco_bringup") / "node_sets" / "hyq.yaml"
    content = yaml.safe_load(source.read_text())
    for node in content["nodes"]:
        if node["name"] == "robot_sim":
            node["class"] = f"lying_plant:{plant}"
    path = folder / "nodes.yaml"
    path.write_text(yaml.safe_dump(content))
    return str(path)


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
@pytest.mark.parametrize("plant", [None, "Announces", "Silent", "Limp"])
def test_a_plant_that_does_not_damp_is_found_out(tmp_path, monkeypatch, plant):
    paths = [str(HERE), *filter(None, sys.path)]
    monkeypatch.setenv("PYTHONPATH", ":".join(dict.fromkeys(paths)))
    nodes = node_set(tmp_path, plant) if plant else None
    (row,) = run_topic("motion_command", 2, 3, tmp_path / "run", nodes, "drop")
    assert row["repeats"] == row["taken"] == 2
    assert row["hit"] == 60
    honest = plant is None
    assert row["ok"] is honest
    assert (row["damped"] == 2) is honest
    assert (row["safe"] == 2) is honest
    if honest:
        assert row["worst"] <= SAFE_TICKS
