# SPDX-License-Identifier: Apache-2.0
"""Attitude, height and speed of a base that nobody measured, against what the simulator knows."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from loco_learning.gap.prediction import horizon, odometry, windows
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.recordings.record import Record
from loco_learning.params import JointLearnerParams
from loco_learning.runs import experiment
from loco_learning.runs.rollout import rollout
from loco_sim.effects import from_list
from loco_sim.plant.model import Model

SOFT = {"name": "ground_compliance", "compliance": 2e-3, "damping": 20.0}
EXACT = {"sensors.exact": True}


@lru_cache(maxsize=4)
def walked(effects: tuple = (), seconds: float = 1.5):
    """Record of Tigrillo's walk without motion capture, and the log with the truth."""
    whole = experiment.load("tigrillo_walk")
    made = replace(
        whole,
        learner=JointLearnerParams(enabled=False),
        effects=tuple(dict(e) for e in effects),
        overrides={**whole.overrides, **EXACT},
    )
    log, plant = rollout(made, until=seconds), made.plant
    signals = {
        "q": log.q, "gyro": log.gyro, "acceleration": log.acceleration,
        "orientation": log.imu_orientation, "grf": log.grf[:, :, 2],
    }  # fmt: skip
    said = {"position": log.command, "velocity": log.command_dq}
    driven = tuple(plant.joints[i] for i in plant.driven)
    record = Record("walk", log.t, said, driven, signals, plant.joints, feet=plant.feet)
    return record, log


def legs(record, robot=None):
    robot = robot or Model("tigrillo", EXACT).make_robot()
    return odometry.legs(record, robot, *windows.joint_states(record, robot))


def in_world(log):
    """True velocity of the base in the world, (T, 3)."""
    return odometry.rotate(odometry.matrices(log.orientation), log.velocity)


def test_height_and_speed_are_what_they_were_although_the_feet_slide():
    record, log = walked()
    moved = odometry.estimate_base(legs(record))
    late = slice(20, None)
    assert np.max(np.abs(moved.height - log.position[:, 2])[late]) < 1e-3
    assert np.std(log.velocity[late, 2]) > 0.05
    assert np.std((moved.velocity - in_world(log))[late, 2]) < 0.01
    assert np.abs(np.mean((moved.velocity - in_world(log))[late, :2], axis=0)).max() < 0.05


def test_without_forces_the_lowest_feet_stand():
    record, log = walked()
    blind = replace(record, signals={k: v for k, v in record.signals.items() if k != "grf"})
    moved = odometry.estimate_base(legs(blind))
    assert np.median(np.abs(moved.height - log.position[:, 2])) < 1e-3


def test_without_attitude_nothing_is_told():
    record, _ = walked()
    signals = {k: v for k, v in record.signals.items() if k != "orientation"}
    assert legs(replace(record, signals=signals)) is None


def test_speed_comes_from_feet_that_agree_and_not_from_one_that_slides():
    rows, rng = 400, np.random.default_rng(0)
    true = 0.2 * np.sin(np.arange(rows) * 0.02)
    said = true[:, None] + 0.002 * rng.standard_normal((rows, 4))
    said[100:300, 3] -= 0.5
    change = np.diff(true) + 5e-4 * rng.standard_normal(rows - 1)
    value, apart = odometry.fuse(said, np.ones((rows, 4), bool), change, (3.0, 1e-3), 8e-4)
    assert np.sqrt(np.mean((value - true) ** 2)) < 0.01
    assert 0.0 < apart < 0.05


def test_feet_that_always_slide_the_same_way_are_not_believed_from_rest():
    rows = 300
    true = 0.1 * np.sin(np.arange(rows) * 0.03)
    said = np.repeat(true[:, None] - 0.3, 4, axis=1)
    said[0] = 0.0
    known = said, np.ones(said.shape, bool), np.diff(true), (3.0, 1e-3), 2e-4
    rested, _ = odometry.fuse(*known, at_zero=True)
    anywhere, _ = odometry.fuse(*known, at_zero=False)
    assert np.max(np.abs(rested - true)) < 0.05
    assert np.mean(anywhere - true) == pytest.approx(-0.3, abs=0.05)


def test_on_soft_ground_the_base_starts_lower_with_the_effect_than_without():
    record, log = walked((tuple(SOFT.items()),))
    robot = Model("tigrillo", EXACT).make_robot()
    starts = windows.segments(record, robot, 0.2)
    moved = windows.adjust_starts(robot, from_list([SOFT]), starts, legs(record))
    height = {s.row: log.position[s.row, 2] for s in starts}
    before, after = (
        np.median([abs(s.base.position[2] - height[s.row]) for s in some[1:]])
        for some in (starts, moved)
    )
    assert after < 0.5 * before


@pytest.mark.parametrize(
    "spec", [{"name": "imu_tilt", "pitch": 0.08, "roll": -0.05}, {"name": "slope", "pitch": 0.06}]
)
def test_what_deceives_the_imu_is_undone_at_the_start(spec):
    record, log = walked((tuple(spec.items()),), 0.8)
    robot = Model("tigrillo", EXACT).make_robot()
    (effect,) = from_list([spec])
    effect.reset(np.random.default_rng(0))
    starts = windows.segments(record, robot, 0.2)
    for start in windows.adjust_starts(robot, [effect], starts, legs(record)):
        true = odometry.matrices(log.orientation[[start.row]])[0]
        mine = odometry.matrices(np.array([start.base.orientation]))[0]
        assert np.allclose(mine @ true.T, np.eye(3), atol=2e-3)


@pytest.mark.pybullet
def test_the_right_model_stays_within_the_floor_and_another_does_not():
    record, _ = walked()
    model = Model("tigrillo", EXACT)
    length = horizon.length(model, [record])
    assert horizon.SHORTEST <= length <= horizon.LONGEST
    forward = Forward(model, [record], ForwardParams(ground=length, most=5))
    assert 0 < len(forward.starts[0]) <= 5
    assert "pieces" in horizon.messages(forward)[0]
    load = {"name": "payload", "mass": 0.3, "link": "front_body"}
    (doubt,) = horizon.state_std(forward)
    right, wrong = (forward(e)[0] - forward.measured[0] for e in ([], [load]))
    seen = np.isfinite(right) & (doubt > 0.0)
    assert np.median(np.abs(right[seen]) / doubt[seen]) < 1.5
    assert np.nanmean(wrong**2) > 1.5 * np.nanmean(right**2)
    (more,) = horizon.state_std(forward, [SOFT])  # engines part where its contacts give way
    assert np.all(more >= doubt)
    assert np.any(more > 2.0 * doubt)


def test_few_pieces_are_some_of_many():
    record, _ = walked()
    forward = Forward(Model("tigrillo", EXACT), [record], ForwardParams(ground=0.1, most=10))
    few = forward.fewer(3)
    assert [s.row for s in few.starts[0]] == [
        s.row for s in windows.select_evenly(forward.starts[0], 3)
    ]
    seen = np.isfinite(few.measured[0])
    assert seen.any() and np.isfinite(forward.measured[0][seen]).all()
    assert np.isfinite(few()[0][seen]).all()
    assert np.isfinite(forward.measured[0]).sum() > 2 * seen.sum()


def test_a_foot_on_higher_ground_says_that_the_base_is_higher():
    record, _ = walked()
    robot, said = Model("tigrillo", EXACT).make_robot(), legs(record)
    (higher,) = from_list([{"name": "ground_height", "foot": "lf_foot", "height": 0.004}])
    starts = windows.segments(record, robot, 0.2)
    moved = windows.adjust_starts(robot, [higher], starts, said)
    rise = [b.base.position[2] - a.base.position[2] for a, b in zip(starts, moved, strict=True)]
    stands = [said.stands[s.row, 0] for s in starts]
    assert np.mean(np.array(rise)[stands]) > 5e-4
    assert max(rise) < 0.0041


def test_without_attitude_whole_runs_are_compared_and_it_is_said():
    record, _ = walked()
    signals = {k: v for k, v in record.signals.items() if k != "orientation"}
    blind, model = replace(record, signals=signals), Model("tigrillo", EXACT)
    assert horizon.length(model, [blind]) == 0.0
    (said,) = horizon.messages(Forward(model, [blind]))
    assert "attitude" in said and "walk" in said


def test_only_about_a_touch_down_may_a_prediction_come_a_sample_late():
    record, _ = walked()
    forward = Forward(Model("tigrillo", EXACT), [record], ForwardParams(ground=0.2, most=4))
    (late,), said = horizon.timing(forward), legs(record)
    about = ~windows.steady(said, 2.0 * said.dt)
    assert about.any() and not about.all()
    assert not late[~about].any()
    assert late[about].any()


def test_pieces_begin_where_no_foot_steps():
    record, _ = walked()
    robot, said = Model("tigrillo", EXACT).make_robot(), legs(record)
    starts = windows.segments(record, robot, 0.3)
    calm = windows.steady(said, windows.JUMP)
    assert np.mean([calm[s.row] for s in starts]) > np.mean(calm)
    assert all(a.stop <= b.row for a, b in zip(starts, starts[1:], strict=False))
