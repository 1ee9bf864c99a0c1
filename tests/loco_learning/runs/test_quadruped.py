# SPDX-License-Identifier: Apache-2.0
"""A quadruped that nobody tuned trots, by the gait clock and by reflex, and HyQ stays HyQ."""

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import to_dict
from loco_learning.params import LearnerParams
from loco_learning.runs import quadruped as quadrupeds
from loco_learning.runs.experiment import Experiment, from_values, load
from loco_learning.runs.rollout import rollout
from loco_sim.robot import robot as robots


@pytest.mark.parametrize("name", ["a1", "laikago", "mini_cheetah", "spirit40"])
def test_a_robot_that_nobody_tuned_trots_at_the_speed_asked_for(name, quadruped):
    e = load("hyq_trot_open", {"robot": str(quadruped(name)), "duration": 7.0})
    log = rollout(e)
    assert not log.fall
    end = log.position[-round(3.0 / e.dt) :, :2]
    speed = np.linalg.norm(end[-1] - end[0]) / ((len(end) - 1) * e.dt)
    assert 0.75 < speed / e.gait.speed < 1.25
    assert 0.7 < log.position[-1, 2] / log.position[0, 2] < 1.1


def test_values_follow_the_robot_unless_the_experiment_says_them(quadruped):
    path = str(quadruped("a1"))
    plain = load("hyq_trot_reflex", {"robot": path})
    said = load("hyq_trot_reflex", {"robot": path, "gait.speed": 0.4, "trunk.mass": 11.0})
    assert said.gait.speed == 0.4 and said.trunk.mass == 11.0
    assert said.gait.frequency == plain.gait.frequency > Experiment().gait.frequency
    weight = plain.trunk.mass * plain.trunk.gravity
    assert plain.learner.grf_scale == pytest.approx(0.5 * weight, rel=2e-3)
    assert plain.learner.memory < LearnerParams().memory
    assert plain.learner.train == load("hyq_trot_reflex").learner.train
    assert from_values(to_dict(plain)) == plain  # a saved experiment stands for itself


def test_hyq_at_its_own_size_is_the_experiment_without_a_robot():
    hyq = {
        name: to_dict(params) for name, params in quadrupeds.defaults(robots.load("hyq")).items()
    }
    own = to_dict(Experiment())
    assert hyq == {name: own[name] for name in hyq}


def test_what_has_no_legs_or_no_name_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="'tigrillo' lists no legs"):
        load("hyq_trot_open", {"robot": "tigrillo"})
    with pytest.raises(NameUnknownError, match="robot"):
        load("hyq_trot_open", {"robot": "hyqq"})


def test_a_path_is_kept_in_full_so_that_bags_can_be_moved(quadruped, monkeypatch):
    folder = quadruped("aliengo")
    monkeypatch.chdir(folder.parent)
    e = load("hyq_trot_open", {"robot": "./aliengo"})
    assert e.robot == str(folder.resolve())
    assert e.plant.joints == robots.load(folder).joints


@pytest.mark.parametrize("name", ["hyq", "a1"])
def test_a_quadruped_turns_and_walks_sideways_as_asked(name, quadruped):
    robot = name if name == "hyq" else str(quadruped(name))
    gait = {"speed": 0.1, "lateral_speed": 0.08, "yaw_rate": -0.3}
    changes = {f"gait.{key}": value for key, value in gait.items()}
    log = rollout(load("hyq_trot_open", {"robot": robot, "duration": 7.0, **changes}))
    assert not log.fall
    last = slice(-round(4.0 / log.dt), None)
    assert log.spin[last, 2].mean() == pytest.approx(-0.3, rel=0.15)
    assert log.velocity[last, 1].mean() == pytest.approx(0.08, abs=0.05)
    assert log.velocity[last, 0].mean() == pytest.approx(0.1, abs=0.04)
