# SPDX-License-Identifier: Apache-2.0
"""Search for gaits of HyQ under its trunk controller."""

from __future__ import annotations

import numpy as np
import pytest

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_learning.gaits import figures
from loco_learning.gaits import search as gait_search
from loco_learning.gaits.legged import LeggedProblem, experiment, problem_of
from loco_learning.gaits.search import GAITS, LEGGED, GaitProblem, GaitSearchParams, judge
from loco_learning.runs import gait_file
from loco_learning.runs.rollout import rollout
from loco_learning.search.population import PopulationParams

TROT = GaitSearchParams(gait="hyq_trot", robot="hyq", duration=3.0)


def test_each_gait_has_the_problem_of_its_robot():
    assert {problem_of(gait) for gait in LEGGED} == {LeggedProblem}
    assert {problem_of(gait) for gait in GAITS} == {GaitProblem}


@pytest.mark.parametrize("gait", LEGGED)
def test_the_search_starts_at_the_gait_of_the_size_and_changes_nothing_else(gait):
    problem = LeggedProblem(TROT.replace(gait=gait))
    usual = experiment("hyq").gait.replace(pattern=gait.split("_")[1])
    assert problem.target(problem.start) == usual
    assert np.all((problem.low < problem.start) & (problem.start < problem.high))
    for x in (problem.low, problem.high):  # both are legal gaits
        target = problem.target(x)
        assert target.replace(**{n: getattr(usual, n) for n in problem.names}) == usual


def test_faster_is_better_and_a_gait_comes_back_from_its_file(tmp_path, monkeypatch):
    monkeypatch.setattr(gait_search, "CHECKS", 1)
    problem = LeggedProblem(TROT)
    slow, fast = (
        problem(np.where(np.array(problem.names) == "speed", speed, problem.start)).value
        for speed in (0.1, 0.3)
    )
    assert fast < slow < 0.0
    options = PopulationParams(workers=0, evaluations=4, population=4, sigma=0.02)
    gait, found = gait_search.search(TROT, options, tmp_path, kind=LeggedProblem)
    gait.save(tmp_path / "gait.yaml")
    again = gait_file.load(tmp_path / "gait.yaml")
    assert again == gait and again.target.pattern == "trot"
    log = rollout(figures.experiment_of(again))
    assert judge(log).extra["speed"] == pytest.approx(gait.speed, abs=1e-4)
    warm = LeggedProblem(TROT, gait.parameters)
    np.testing.assert_allclose(warm.start, list(gait.parameters.values()))


def test_what_cannot_be_searched_is_refused():
    with pytest.raises(NameUnknownError, match="did you mean 'speed'"):
        LeggedProblem(TROT, {"sped": 0.3})
    with pytest.raises(LocoError, match="legs"):
        LeggedProblem(TROT.replace(robot="tigrillo"))
    with pytest.raises(ParameterError, match="robots with legs take hyq_trot or hyq_walk"):
        GaitProblem(TROT.replace(gait="tigrillo_walk"))
