# SPDX-License-Identifier: Apache-2.0
"""Ways to a gait on equal time: the budget is kept, a case is run once, what is missing is said."""

import sys

import pytest
import yaml

from loco_control.exceptions import ParameterError
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.reinforce.trials import CONDITIONS, TrialParams
from loco_learning.search import evaluations
from loco_workshop import contest

GRADIENT = ReinforceParams(batch=2, lead=1.0, episode=1.0, directions=3)


@pytest.fixture(scope="module")
def params(tmp_path_factory):
    path = tmp_path_factory.mktemp("small") / "small.yaml"
    learner = {"neurons": 30, "train": 3.0, "closing": 1.0, "test": 2.0}
    path.write_text(yaml.safe_dump({"extends": "tigrillo_bound_reflex", "learner": learner}))
    return contest.ContestParams(
        seconds=24.0, seeds=1, reflex=str(path), rollout=1.5, population=4, share=0.25,
        gradient=GRADIENT, trials=TrialParams(length=1.0, count=1),
    )  # fmt: skip


@pytest.fixture(scope="module")
def folder(params, tmp_path_factory):
    folder = tmp_path_factory.mktemp("contest")
    with pytest.MonkeyPatch.context() as patch:  # an extra, too slow to be tried here
        patch.setitem(sys.modules, "stable_baselines3", None)
        patch.delitem(sys.modules, "loco_workshop.ppo", raising=False)
        heard = []
        cases = contest.run(params, folder, 0, lambda *news: heard.append(news))
    assert [news[1:] for news in heard] == [(k, 4) for k in (1, 2, 3, 4)]
    assert [case.method for case in cases] == list(contest.METHODS)
    return folder


def test_no_way_takes_more_time_than_it_has(params, folder):
    cases = {case.method: case for case in contest.run(params, folder, 0)}
    assert cases["evolution"].seconds == 24.0
    for method in ("evolution", "two steps", "three steps"):
        case = cases[method]
        if case.reason:  # a gait of so short a search may fall while it is taught
            assert "taught no readout" in case.reason and not case.rows
        else:
            assert 0.0 < case.seconds <= 24.0 and set(case.rows) == set(CONDITIONS)
    assert "stable_baselines3 is not installed" in cases["ppo"].reason


def test_what_is_done_is_not_run_again(params, folder, monkeypatch):
    def never(*job):
        raise AssertionError(f"{job} is run again")

    monkeypatch.setattr(contest, "learnt", never)
    monkeypatch.setattr(contest, "searched", never)
    before = (folder / contest.RECORD).read_bytes()
    assert len(contest.run(params, folder, 0)) == 4
    assert (folder / contest.RECORD).read_bytes() == before
    with pytest.raises(ParameterError, match="belongs to other work: seconds is 24.0 there"):
        contest.run(params.replace(seconds=25.0), folder, 0)


def test_a_shorter_search_is_the_beginning_of_a_longer_one(params, folder, tmp_path):
    contest.searched(params.replace(seconds=12.0), tmp_path, 0)
    _, short = evaluations.read(tmp_path / "search_0")
    _, long = evaluations.read(folder / "search_0")
    assert len(short) == 8 and short == long[:8]
    assert contest._gait(params, folder, 12.0, 0) == contest._gait(params, tmp_path, 12.0, 0)
