# SPDX-License-Identifier: Apache-2.0
"""The environment is the one loop: Gymnasium's own check, and rollouts bit by bit."""

import functools
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from loco_control.exceptions import MissingPackageError, NameUnknownError, ParameterError
from loco_learning.reflex import weights as weight_files
from loco_learning.reinforce.environment import ReflexEnv
from loco_learning.reinforce.episode import first_weights, prepared
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.reinforce.reward import Reward
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout


@pytest.fixture
def env(experiment, taught, short):
    made = ReflexEnv(experiment, taught, short)
    yield made
    made.close()


@pytest.mark.parametrize("observe", ["hidden", "senses"])
@pytest.mark.filterwarnings("ignore:.*maximum value is infinity", "ignore:.*minimum value is -inf")
def test_gymnasium_finds_no_fault(experiment, taught, short, observe):
    env = ReflexEnv(experiment, taught, short, observe)
    check_env(env, skip_render_check=True)
    assert env.observation_space.shape == ((60,) if observe == "hidden" else (500,))
    env.close()


def test_hyq_is_an_environment_too(tmp_path):
    hyq = load("hyq_short", {"learner.neurons": 20})
    first_weights(hyq, tmp_path / "zero.npz", zero=True)
    env = ReflexEnv(hyq, tmp_path / "zero.npz", ReinforceParams(lead=0.2, episode=0.2))
    check_env(env, skip_render_check=True)
    assert env.action_space.shape == (8,)  # HFE and KFE of four legs
    env.close()


def play(env, actions, seed=3):
    env.reset(seed=seed)
    rows = []
    for action in actions:
        rows.append((action, *env.step(action)))
        if rows[-1][3] or rows[-1][4]:
            break
    return rows


def test_without_actions_it_is_the_rollout(env, experiment, taught, short):
    rows = play(env, np.zeros((150, 4)))
    log = rollout(prepared(experiment, short, taught), seed=3)
    assert len(rows) == 150 and rows[-1][4] and not rows[-1][3]
    truth = env._loop.sim.ground_truth()
    assert log.distance == pytest.approx(float(truth.position[0] - log.position[0, 0]), abs=0.01)
    reward = Reward(short.reward, experiment.plant, experiment.sim_params)
    test = log.cut(log.phase_of("test"))
    # The reward of an action is that of the state it led to, one tick on in the log.
    np.testing.assert_array_equal(
        [row[2] for row in rows[:-1]], reward.tick(test.velocity, test.dq, test.tau)[1:]
    )


def test_actions_do_what_another_readout_would(env, experiment, taught, short, tmp_path):
    readout = weight_files.read_readout(taught, "joint_weights")
    other = readout.copy()
    other[:, :4] += 0.004 * np.random.default_rng(2).standard_normal((60, 4))
    weight_files.with_readout(taught, tmp_path / "other.npz", "joint_weights", other)
    log = rollout(prepared(experiment, short, tmp_path / "other.npz"), seed=3)
    u, _ = env.reset(seed=3)
    speeds = []
    for _ in range(50):
        correction = (other - readout)[:, :4].T @ u
        assert np.abs(correction).max() < env.reach
        u, *_ = env.step(correction / env.reach)
        speeds.append(env._loop.sim.ground_truth().linear_velocity)
    start = log.phase_of("test").start + 1
    # The sum is taken in another order, and rounding grows from bounce to bounce.
    np.testing.assert_allclose(speeds[:20], log.velocity[start : start + 20], atol=1e-6)


def test_a_seed_decides_all(env):
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 4))
    a, b, c = play(env, actions, 5), play(env, actions, 5), play(env, actions, 6)
    np.testing.assert_array_equal([r[1] for r in a], [r[1] for r in b])
    assert not np.array_equal(a[-1][1], c[-1][1])


def test_a_fall_ends_the_episode_and_costs(experiment, taught, short):
    heavy = experiment.replace(effects=({"name": "push", "force": [0.0, 60.0, 0.0], "start": 2.6},))
    env = ReflexEnv(heavy, taught, short)
    rows = play(env, np.zeros((150, 4)))
    assert rows[-1][3] and len(rows) < 150
    assert rows[-1][2] == -150.0 * short.reward.fall
    assert rows[-1][5]["fall"]
    env.close()


def test_it_runs_in_processes(experiment, taught, short):
    make = functools.partial(ReflexEnv, experiment, taught, short)
    several = gymnasium.vector.AsyncVectorEnv([make, make])
    first, _ = several.reset(seed=[3, 4])
    assert first.shape == (2, 60) and not np.array_equal(first[0], first[1])
    _, reward, *_ = several.step(np.zeros((2, 4)))
    several.close()
    alone = ReflexEnv(experiment, taught, short)
    alone.reset(seed=4)
    assert reward[1] == alone.step(np.zeros(4))[1]
    alone.close()


def test_what_cannot_be_is_refused_in_one_line(experiment, taught, short):
    with pytest.raises(NameUnknownError, match="'smell'"):
        ReflexEnv(experiment, taught, short, "smell")
    with pytest.raises(ParameterError, match="tigrillo_bound has no reflex network"):
        ReflexEnv("tigrillo_bound", taught, short)
    with pytest.raises(ParameterError, match="msd_20 is of masses and springs"):
        ReflexEnv("msd_20", taught, short)
    with pytest.raises(ParameterError, match=r"learner\.neurons is 200, but .* have 60"):
        ReflexEnv("tigrillo_bound_reflex", taught, short)


def test_without_gymnasium_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "loco_learning.reinforce.environment")
    with pytest.raises(MissingPackageError, match=r"\./loco install rl"):
        import loco_learning.reinforce.environment  # noqa: F401
