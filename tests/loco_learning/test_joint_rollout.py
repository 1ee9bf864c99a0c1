# SPDX-License-Identifier: Apache-2.0
"""Laws of the loop of joint robots: repeatable, open ends, cheap."""

import time

import numpy as np
import pytest

from loco_control.exceptions import DivergedError, ParameterError
from loco_learning import joint_rollout
from loco_learning.experiment import load
from loco_learning.joint_log import COLUMNS, JointLog

SHORT = {"duration": 1.0}


def same(one, other):
    return all(np.array_equal(one.columns[name], other.columns[name]) for name in COLUMNS)


@pytest.fixture(scope="module")
def walk():
    return load("tigrillo_walk", SHORT)


@pytest.fixture(scope="module")
def log(walk):
    return joint_rollout.rollout(walk)


def test_equal_experiments_give_equal_logs(walk, log):
    assert same(joint_rollout.rollout(walk), log)
    loop = joint_rollout.build(walk)
    try:
        joint_rollout.run(loop)
        loop.reset()
        assert same(joint_rollout.run(loop), log)
    finally:
        loop.close()


@pytest.mark.parametrize("robot", ["servo_pendulum", "pendulum", "linear_axis", "spring_mass"])
def test_any_robot_runs(robot):
    experiment = load("servo_pendulum_sine", {"robot": robot, "duration": 0.3})
    log = joint_rollout.rollout(experiment)
    assert log.complete
    assert log.command.shape == (experiment.ticks, len(experiment.plant.driven))
    assert np.isfinite(log.q).all()


def test_columns_have_a_row_per_tick(walk, log):
    assert len(log) == walk.ticks == 100
    assert log.complete and not log.fall
    np.testing.assert_allclose(log.t, np.arange(100) * walk.dt)
    n, m = len(walk.plant.joints), len(walk.plant.driven)
    assert log.q.shape == (100, n) and log.command.shape == (100, m)
    assert log.contact.dtype == bool and log.contact.shape == (100, len(walk.plant.feet))
    assert len(log.cut(slice(10, 20))) == 10
    with pytest.raises(AttributeError, match="command"):
        log.commands  # noqa: B018


def test_without_a_learner_the_command_is_the_target(log):
    np.testing.assert_array_equal(log.command, log.target)
    assert log.distance == log.position[-1, 0] - log.position[0, 0]


def test_a_log_survives_a_file(log, tmp_path):
    log.save(tmp_path / "log.npz")
    again = JointLog.load(tmp_path / "log.npz")
    assert same(again, log)
    assert again.experiment == log.experiment
    with pytest.raises(ParameterError, match="joint_log"):
        from loco_learning.log import Log

        Log.load(tmp_path / "log.npz")


def test_a_fall_ends_the_run_and_is_told():
    push = {"name": "push", "force": [0.0, 30.0, 0.0], "start": 0.2, "stop": 0.5}
    log = joint_rollout.rollout(load("tigrillo_hold", {"effects": [push]}))
    assert "beyond" in log.fall or "below" in log.fall
    assert not log.complete
    assert 0.2 < log.t[-1] < 2.0


def test_divergence_ends_the_run_and_is_told(walk):
    loop = joint_rollout.build(walk)
    step, calls = loop.sim.step, []

    def diverge(*command):
        calls.append(command)
        if len(calls) > 10:
            raise DivergedError("the simulated state is not finite")
        return step(*command)

    loop.sim.step = diverge
    try:
        log = joint_rollout.run(loop)
    finally:
        loop.close()
    assert log.fall == "the simulated state is not finite"
    assert len(log) == 10


def test_until_cuts_and_on_tick_sees_every_tick(walk, log):
    seen = []
    cut = joint_rollout.rollout(walk, on_tick=lambda k, loop: seen.append(k), until=0.3)
    assert seen == list(range(1, 31))
    assert same(cut, log.cut(slice(0, 30)))


def test_a_recording_can_drive(walk, log):
    class Replay:
        def reset(self):
            pass

        def step(self, t):
            row = round(t / walk.dt)
            return log.target[row], log.target_dq[row]

    assert same(joint_rollout.rollout(walk, target=Replay()), log)


def test_seed_changes_the_noise_of_sensors_and_nothing_else(walk, log):
    other = joint_rollout.rollout(walk, seed=5)
    assert not np.array_equal(other.q, log.q)
    np.testing.assert_array_equal(other.position, log.position)  # open loop: nothing feels it
    np.testing.assert_array_equal(other.command, log.command)


def test_a_control_period_must_be_whole_physics_steps():
    with pytest.raises(ParameterError, match="whole multiple"):
        joint_rollout.build(load("tigrillo_hold", {"control_rate": 300.0}))


def test_the_loop_costs_little_beside_the_plant(walk):
    """Calibration and gait search run it thousands of times."""
    loop = joint_rollout.build(walk)
    step, inside = loop.sim.step, [0.0]

    def timed(*command):
        before = time.perf_counter()
        state = step(*command)
        inside[0] += time.perf_counter() - before
        return state

    loop.sim.step = timed
    try:
        log = joint_rollout.run(loop)
    finally:
        loop.close()
    assert log.wall_time - inside[0] < 0.5 * log.wall_time


@pytest.mark.parametrize(("name", "distance"), [("tigrillo_bound", 1.5), ("tigrillo_walk", 1.5)])
def test_shipped_gaits_go_forward_without_a_fall(name, distance):
    """The experiments of step one; 15 s of rollout each take a second or two."""
    log = joint_rollout.rollout(load(name))
    assert log.complete and not log.fall
    assert log.distance > distance
