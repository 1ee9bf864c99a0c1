# SPDX-License-Identifier: Apache-2.0
"""Stance estimators and their switch at run time."""

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError
from loco_control.gait.generator import GaitParams, TargetGenerator
from loco_control.stance.controller import (
    ESTIMATORS,
    HeightEstimator,
    StanceController,
    StanceParams,
)
from loco_control.stance.trunk import TrunkParams
from loco_control.types import MotionCommand

DT = 0.004


def command(target, q=None):
    return MotionCommand(target.tick, target.t, target.q if q is None else q, target.dq)


def run(state_at, ticks, change=None, frozen_from=None, gait=None, **stance):
    """Stances and torques while the robot is commanded as the target says."""
    generator = TargetGenerator(gait or GaitParams(start_time=0.0), DT)
    controller = StanceController(StanceParams(**stance), TrunkParams(), DT)
    targets, stances, torques, held = [], [], [], None
    for tick in range(ticks):
        if change and tick == change[0]:
            controller.set_estimator(change[1])
        state = state_at(tick)
        target = generator.step(state)
        held = target.q if frozen_from is None or tick < frozen_from else held
        one, torque = controller.step(state, target, command(target, held))
        targets.append(target)
        stances.append(one)
        torques.append(torque)
    return targets, stances, torques


def flags(messages):
    return np.array([message.stance for message in messages])


def test_pse_is_the_gait_clock(state_at):
    targets, stances, torques = run(state_at, 700)
    np.testing.assert_array_equal(flags(stances), flags(targets))
    np.testing.assert_array_equal(flags(torques), flags(targets))
    assert {s.estimator for s in stances} == {ESTIMATORS.index("pse")}


def test_rse_follows_the_clock_when_the_command_follows_the_target(state_at):
    targets, stances, _ = run(state_at, 1500, estimator="rse", window=5)
    assert (flags(targets)[500:] == flags(stances)[500:]).mean() > 0.85
    assert {s.estimator for s in stances} == {ESTIMATORS.index("rse")}


def test_pse_ignores_the_command_and_rse_does_not(state_at):
    options = {"ticks": 1000, "frozen_from": 500}
    pse = flags(run(state_at, estimator="pse", **options)[1])
    rse = flags(run(state_at, estimator="rse", **options)[1])
    assert np.diff(pse[600:].astype(int), axis=0).any()
    assert not np.diff(rse[600:].astype(int), axis=0).any()


def test_standing_robot_stands_on_four_legs_by_both(state_at):
    for estimator in ESTIMATORS:
        _, stances, _ = run(state_at, 50, gait=GaitParams(), estimator=estimator)
        assert flags(stances).all()
        np.testing.assert_allclose([s.foot_height for s in stances], 0.0, atol=1e-12)


def test_foot_height_is_the_average_over_the_window(state_at):
    targets, stances, _ = run(state_at, 600, window=15)
    feet = np.array([target.foot_position[:, 2] for target in targets])
    height = feet - feet[0].min()  # the ground is where the robot stood at first
    np.testing.assert_allclose(stances[-1].foot_height, height[-15:].mean(axis=0), atol=1e-12)


def test_hysteresis_keeps_a_foot_in_the_band_where_it_was():
    estimator = HeightEstimator(StanceParams(window=1))
    heights = [0.0, 0.018, 0.021, 0.018, 0.016, 0.014, 0.018]
    seen = [estimator.update(np.full(4, height))[1][0] for height in heights]
    assert seen == [True, True, False, False, False, True, True]


def test_estimator_start_is_when_rse_takes_over(state_at):
    _, stances, _ = run(state_at, 300, estimator="rse", estimator_start=0.4)
    assert [s.estimator for s in stances] == [0] * 100 + [1] * 200


def test_switching_while_running_equals_having_switched_all_along(state_at):
    _, switched, _ = run(state_at, 800, change=(400, "rse"))
    _, reactive, _ = run(state_at, 800, estimator="rse")
    np.testing.assert_array_equal(flags(switched)[400:], flags(reactive)[400:])
    assert [s.estimator for s in switched] == [0] * 400 + [1] * 400
    _, back, _ = run(state_at, 500, estimator="rse", change=(400, "pse"))
    assert [s.estimator for s in back] == [1] * 400 + [0] * 100


def test_reset_repeats_the_run(state_at):
    generator = TargetGenerator(GaitParams(start_time=0.0), DT)
    controller = StanceController(StanceParams(estimator="rse"), TrunkParams(), DT)
    runs = []
    for _ in range(2):
        generator.reset()
        controller.reset()
        out = []
        for tick in range(200):
            state = state_at(tick, yaw=0.1)
            target = generator.step(state)
            out.append(controller.step(state, target, command(target)))
        controller.set_estimator("pse")
        runs.append(out)
    for (a, tau_a), (b, tau_b) in zip(*runs, strict=True):
        np.testing.assert_array_equal(a.stance, b.stance)
        np.testing.assert_array_equal(a.foot_height, b.foot_height)
        np.testing.assert_array_equal(tau_a.tau, tau_b.tau)


def test_messages_keep_their_arrays(state_at):
    targets, stances, torques = run(state_at, 300, estimator="rse")
    before = flags(stances).copy(), flags(torques).copy()
    targets[100].stance[:] = False
    stances[101].stance[:] = True
    np.testing.assert_array_equal(flags(torques), before[1])
    np.testing.assert_array_equal(flags(stances)[:101], before[0][:101])


def test_unknown_estimator_is_refused_while_running():
    controller = StanceController(StanceParams(), TrunkParams(), DT)
    with pytest.raises(NameUnknownError, match="available: pse, rse"):
        controller.set_estimator("reactive")
