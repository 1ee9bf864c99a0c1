# SPDX-License-Identifier: Apache-2.0
"""Tutorials run as they are printed, in a folder with nothing but what they write down."""

import pytest

from loco_workshop.docs.tutorials import follow

pytestmark = pytest.mark.ros
graph = pytest.mark.xdist_group("graph")
searches = pytest.mark.xdist_group("tutorials")  # without a graph: beside the tests that have one


@graph
def test_own_robot_and_controller(repository, tmp_path):
    said = list(follow(repository / "docs/tutorial_own.md", tmp_path))
    assert "my_door/picture.png" in said[0]
    assert (tmp_path / "bags/door/report.html").exists()
    assert "my_door: done, 5.0 s simulated" in said[1]


@graph
def test_walking_by_reflex(repository, tmp_path):
    """With the short training of the tests, which is good for a few steps only."""
    short = {"hyq_trot_reflex": "hyq_short", "--duration 12": "--duration 4",
             "start: 6, stop: 6.5": "start: 2, stop: 2.5"}  # fmt: skip
    said = list(follow(repository / "docs/tutorial_walk.md", tmp_path, short))
    assert (tmp_path / "bags/first/report.html").exists()
    assert (tmp_path / "bags/first_csv/motion_command.csv").exists()
    assert said[2].count("done, 4.0 s simulated") == said[3].count("done, 4.0 s simulated") == 1
    assert "identical" in said[-1]


@searches
def test_a_measured_log(repository, tmp_path):
    """With two candidates in place of all."""
    (tmp_path / "bags").symlink_to(repository / "bags")
    short = {"--robot": "--effects payload coulomb_friction --robot"}
    said = list(follow(repository / "docs/tutorial_log.md", tmp_path, short))
    assert "mapping.yaml is a draft" in said[1] and "torque is command_torque" in said[1]
    assert "Unknown" in said[1]
    assert "robot.yaml is a draft" in said[2] and "No gap" not in said[2]
    assert "Named: payload in pendulum." in said[3] and "position.-z 0.5" in said[3]


@searches
@pytest.mark.timeout(900)  # two minutes of processor time
def test_a_hidden_gap(repository, tmp_path):
    """Two recordings of 4 s without ROS, two candidates."""
    short = {"chirp_large_air slow_ramp_air in_turn_air": "chirp_large_air",
             "--set robot=hidden.yaml": "--set robot=hidden.yaml --layout rollout --duration 4",
             "--set robot=hidden_hyq.yaml": "--set robot=hidden_hyq.yaml --layout rollout",
             "run tigrillo_walk": "run tigrillo_walk --layout rollout --duration 2",
             "tigrillo --hold": "tigrillo --effects payload coulomb_friction --hold",
             "hyq --hold": "hyq --effects payload coulomb_friction --hold"}  # fmt: skip
    said = list(follow(repository / "docs/tutorial_gap.md", tmp_path, short))
    assert "ready: of" in said[1]
    assert "Named: coulomb friction in rh hfe." in said[2]
    assert (tmp_path / "results/hidden/gap.html").exists()
    assert "2.0 s simulated" in said[3]
    assert "Named: coulomb friction in rf kfe." in said[4]
