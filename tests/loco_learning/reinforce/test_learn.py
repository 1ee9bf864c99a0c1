# SPDX-License-Identifier: Apache-2.0
"""Learning from episodes: budget, record, resumption, and what it writes."""

import shutil

import numpy as np
import pytest

from loco_control.exceptions import MissingFileError, ParameterError
from loco_control.reading import read_yaml
from loco_learning.reflex import weights as weight_files
from loco_learning.reinforce import learn
from loco_learning.reinforce.episode import first_weights, play, prepared
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.reinforce.reward import Reward
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout

KIND = "joint_weights"


@pytest.fixture
def folder(taught, tmp_path):
    shutil.copy(taught, tmp_path / learn.START)
    return tmp_path


@pytest.fixture(scope="module")
def whole(experiment, taught, tmp_path_factory):
    """A learning run that was left alone: its folder and result."""
    from .conftest import SHORT

    folder = tmp_path_factory.mktemp("whole")
    shutil.copy(taught, folder / learn.START)
    return folder, learn.learn(experiment, SHORT.replace(seconds=50.0), folder, workers=0)


def test_the_budget_is_told_before_and_kept(experiment, short):
    updates, seconds = learn.cost_of(experiment, short.replace(seconds=50.0))
    assert (updates, seconds) == (2, 44.0)  # 2 (4 + 1) + 1 episodes of 4 s
    assert learn.cost_of(experiment, short.replace(seconds=44.0)) == (2, 44.0)
    assert learn.cost_of(experiment, short.replace(seconds=43.9)) == (1, 24.0)
    with pytest.raises(ParameterError, match="seconds is 23, but one update needs 24 s"):
        learn.cost_of(experiment, short.replace(seconds=23.0))


def test_a_run_keeps_each_episode_and_no_more_time_than_told(whole):
    folder, learnt = whole
    assert learnt.updates == 2 and learnt.seconds <= 44.0
    assert len((folder / learn.RECORD).read_text().splitlines()) == 1 + 2 * 5 + 1
    assert learnt.value >= learnt.first == learnt.course["value"][0]
    assert learnt.course["value"].max() == learnt.value
    assert learnt.course["seconds"][0] == 0.0 and np.all(np.diff(learnt.course["seconds"]) > 0.0)
    assert np.isnan(learnt.course["batch"][-1]) and np.all(np.isfinite(learnt.course["batch"][:-1]))


def test_a_run_that_was_cut_short_ends_with_the_same_bytes(whole, folder, experiment, short):
    record = (whole[0] / learn.RECORD).read_bytes()
    lines = record.splitlines(keepends=True)
    (folder / learn.RECORD).write_bytes(b"".join(lines[:8]) + lines[8][:20])
    heard = []
    again = learn.learn(experiment, short.replace(seconds=50.0), folder, 2, heard.append)
    assert (folder / learn.RECORD).read_bytes() == record  # by two processes, too
    np.testing.assert_array_equal(again.readout, whole[1].readout)
    assert [p.update for p in heard] == [1, 2] and heard[1].best == pytest.approx(
        max(whole[1].course["value"][:2])
    )


def test_a_smaller_budget_is_the_beginning_of_a_larger_one(whole, folder, experiment, short):
    less = learn.learn(experiment, short.replace(seconds=24.0), folder, 0)
    assert less.updates == 1
    np.testing.assert_array_equal(less.course["value"][0], whole[1].course["value"][0])
    more = learn.learn(experiment, short.replace(seconds=50.0), folder, 0)
    assert (folder / learn.RECORD).read_bytes() == (whole[0] / learn.RECORD).read_bytes()
    np.testing.assert_array_equal(more.readout, whole[1].readout)


def test_other_work_is_not_gone_on_with(whole, experiment, short):
    with pytest.raises(ParameterError, match="seed is 0 there, 1 here"):
        learn.learn(experiment, short.replace(seed=1), whole[0], 0)


def test_what_is_written_plays_by_itself(whole, experiment, short, tmp_path, monkeypatch):
    folder = tmp_path / "moved"
    shutil.copytree(whole[0], folder)
    learnt = whole[1]
    weights, path = learn.write(experiment, short, folder, learnt.readout, test=2.0)
    monkeypatch.chdir(tmp_path)  # weights are beside the experiment, wherever that is
    loaded = load(path)
    assert loaded.name == "tigrillo_bound_reflex_reinforced"
    assert read_yaml(path)["learner"]["weights"] == "weights.npz"
    log = rollout(loaded)
    test = log.phase_of("test")
    assert test.stop - test.start == 200 and not log.fall
    assert np.all(log.command[test] == log.prediction[test][:, :4])
    np.testing.assert_array_equal(weight_files.read_readout(weights, KIND), learnt.readout)
    # The same sensors, weights and seed as in the episode that was the best.
    again = play(prepared(experiment, short, weights), short, learnt.readout, 5, {})
    other = prepared(loaded.replace(learner=loaded.learner.replace(weights="")), short, weights)
    assert play(other, short, learnt.readout, 5, {}) == again


def test_the_return_of_an_episode_is_the_mean_reward_less_the_price_of_a_fall(taught, experiment):
    params = ReinforceParams(lead=1.0, episode=1.5)
    e = prepared(experiment, params, taught)
    log = rollout(e)
    test, reward = log.cut(log.phase_of("test")), Reward(params.reward, e.plant, e.sim_params)
    ticks = reward.tick(test.velocity, test.dq, test.tau)
    assert reward.of_log(test, 150) == pytest.approx(ticks.mean())
    half = test.cut(slice(0, 75))
    assert reward.of_log(half, 150) == pytest.approx(ticks[:75].sum() / 150)
    half.fall = "fell"
    assert reward.of_log(half, 150) == pytest.approx(ticks[:75].sum() / 150 - 1.0)
    late = reward.of_log(test, 150, discount=0.5)
    assert late == pytest.approx(ticks[:40] @ 0.5 ** np.arange(40) / 2.0)  # eq. (3.18)


def test_pushes_and_bodies_reach_the_perturbed_episodes(taught, experiment, short):
    pushed = prepared(experiment, short.replace(push=0.1), taught)
    push = pushed.effects[-1]
    assert (push["name"], push["start"]) == ("push", 2.5)
    assert push["random"] == pytest.approx(0.1 * 0.95 * 9.81, rel=1e-3)  # of the weight
    readout = weight_files.read_readout(taught, KIND)
    calm = play(prepared(experiment, short, taught), short, readout, 0, {})
    body = {"masses.front_body": 0.9}
    values = {calm.value, play(pushed, short, readout, 0, {}).value}
    values.add(play(prepared(experiment, short, taught), short, readout, 0, body).value)
    assert len(values) == 3


def test_first_weights_may_be_zero_or_from_a_file(taught, experiment, tmp_path):
    assert first_weights(experiment, tmp_path / "zero.npz", zero=True) == 0.0
    assert not weight_files.read_readout(tmp_path / "zero.npz", KIND).any()
    assert first_weights(experiment, tmp_path / "copy.npz", taught) == 0.0
    np.testing.assert_array_equal(
        weight_files.read_readout(tmp_path / "copy.npz", KIND),
        weight_files.read_readout(taught, KIND),
    )
    with pytest.raises(MissingFileError):
        first_weights(experiment, tmp_path / "no.npz", tmp_path / "nothing.npz")
    other = load("tigrillo_bound_reflex")
    with pytest.raises(ParameterError, match=r"learner\.neurons is 200"):
        first_weights(other, tmp_path / "no.npz", taught)


def test_an_odd_batch_is_refused():
    with pytest.raises(ParameterError, match="batch must be even.* got 5, take 6"):
        ReinforceParams(batch=5)
