# SPDX-License-Identifier: Apache-2.0
"""The graph of joint robots over real DDS: same bytes in every layout, several robots, clean ends.

Every test needs runs of the graph, which take seconds each; they are shared.
"""

import os
import re
import signal
import time

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run as runner
from loco_bringup.logs.rollout_bag import run_rollout
from loco_control.exceptions import GraphError
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_learning.runs.experiment import load

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

CONTROL = ("joint_states", "imu/data", "joint_target", "joint_command", "joint_prediction",
           "ground_truth/odom")  # fmt: skip
CLOSED = {  # all phases of a small learner in 1.5 s
    "duration": 0.0,
    "learner": {"enabled": True, "neurons": 30, "memory": 10, "stand": 0.2, "train": 0.6,
                "closing": 0.4, "test": 0.3},
    "effects": [{"name": "command_delay", "delay": 0.02}],
}  # fmt: skip


@pytest.fixture(scope="module")
def closed():
    return load("tigrillo_walk", CLOSED)


@pytest.fixture(scope="module")
def bags(closed, tmp_path_factory):
    """Bags by name: rollout, composed, processes in a namespace, two robots side by side."""
    root = tmp_path_factory.mktemp("bags")
    made = {"rollout": run_rollout(closed, root / "rollout", lambda progress: None)}
    for layout, space in (("composed", ""), ("processes", "lab/tigrillo")):
        made[layout] = runner.run(closed, root / layout, layout, namespace=space)
    twins = {"measured": closed.replace(seed=7), "model": closed}
    made["pair"] = runner.run_robots(twins, root / "pair")
    return made


@pytest.mark.parametrize(
    ("name", "prefix"), [("composed", ""), ("processes", "/lab/tigrillo"), ("pair", "/model")]
)
def test_same_experiment_gives_the_same_bytes_everywhere(bags, closed, name, prefix):
    one, other = Bag(bags["rollout"].folder), Bag(bags[name].folder)
    for topic in CONTROL:
        said = other.raw(f"{prefix}/{topic}")[1]
        assert len(said) == closed.ticks
        assert one.raw(topic)[1] == said, topic


def test_robots_side_by_side_do_not_hear_each_other(bags):
    bag = Bag(bags["pair"].folder)
    assert bag.raw("/measured/joint_states")[1] != bag.raw("/model/joint_states")[1]  # the seed
    for space in ("measured", "model"):
        kinds = [e.kind for e in bag.messages(f"/{space}/events")]
        assert kinds.count("started") == kinds.count("finished") == 1
    assert "/clock" not in bag.topics or bag.topics["/clock"].count == 0
    assert set(bag.attachments()) >= {"experiment_measured.yaml", "experiment_model.yaml"}
    assert "experiment.yaml" in Bag(bags["processes"].folder).attachments()


@pytest.mark.parametrize("name", ["composed", "processes", "pair"])
def test_a_run_ends_cleanly_and_loses_nothing(bags, name):
    outcome = bags[name]
    assert outcome.exit_code == 0
    assert set(outcome.exit_codes.values()) == {0}
    assert outcome.dropped == 0
    assert re.search(r"1\.5 s simulated, -?\d+\.\d\d m forward, no fall", outcome.text)


def test_robots_wait_together_for_a_recorder_that_stands_still(tmp_path):
    """Its queue holds 512 messages, and each tick of each of the three is 6."""
    stopped = []

    def stop(progress):
        if not stopped and progress.sim_time > 1.0:
            stopped.append(progress.pids["recorder"])
            os.kill(stopped[0], signal.SIGSTOP)
            time.sleep(0.7)
            os.kill(stopped[0], signal.SIGCONT)

    robot = load("tigrillo_sine", {"duration": 4.0})
    robots = dict.fromkeys(("one", "two", "three"), robot)
    outcome = runner.run_robots(robots, tmp_path / "bag", speed=2.0, on_progress=stop)
    assert stopped
    assert outcome.dropped == 0
    bag = Bag(tmp_path / "bag")
    assert {bag.topics[f"/{name}/joint_states"].count for name in robots} == {robot.ticks}


def test_composed_run_says_what_it_does(bags, closed):
    bag = Bag(bags["composed"].folder)
    events = bag.messages("events")
    assert [e.kind for e in events].count("ready") == 4  # three nodes and the recorder
    assert [e.text for e in events if e.kind == "phase"] == ["stand", "train", "closing", "test"]
    assert events[-1].kind == "finished"
    assert events[-1].text == bags["rollout"].text
    for topic in ("knee_adc", "/tf"):
        assert bag.topics[bag.resolve(topic)].count == closed.ticks
    assert bag.attachments()["weights.npz"] > 0
    counts = np.array([m.data for m in bag.messages("knee_adc")])
    assert counts.shape == (closed.ticks, 4)
    assert (counts == np.round(counts)).all() and counts.min() >= 0 and counts.max() < 4096


def test_every_topic_of_the_table_is_recorded(bags):
    bag = Bag(bags["composed"].folder)
    recorded = {"/" + name.lstrip("/") for name in JOINT_TOPICS} - {"/recorder_status"}
    assert recorded == set(bag.topics)


def test_learner_drives_from_closing_on(bags, closed):
    bag = Bag(bags["composed"].folder)
    target, command, prediction = (
        np.array([m.position for m in bag.messages(name)])
        for name in ("joint_target", "joint_command", "joint_prediction")
    )
    closing = round((closed.learner.stand + closed.learner.train) * closed.control_rate)
    np.testing.assert_array_equal(command[:closing], target[:closing])
    np.testing.assert_array_equal(command[closing:], prediction[closing:])


def test_a_fall_ends_the_run_with_code_3(tmp_path):
    push = {"name": "push", "force": [0.0, 30.0, 0.0], "start": 0.2, "stop": 0.5}
    outcome = runner.run(load("tigrillo_hold", {"effects": [push]}), tmp_path / "fall")
    assert outcome.fallen and outcome.exit_code == 3
    assert "fell at" in outcome.text
    assert [e.kind for e in Bag(outcome.folder).messages("events")].count("fall") == 1


@pytest.mark.parametrize("robot", ["servo_pendulum", "spring_mass"])
def test_benches_run_too_even_without_a_drive(robot, tmp_path):
    experiment = load("servo_pendulum_sine", {"robot": robot, "duration": 0.2})
    made = [
        run_rollout(experiment, tmp_path / "rollout", lambda progress: None),
        runner.run(experiment, tmp_path / "graph"),
    ]
    bags = [Bag(outcome.folder) for outcome in made]
    assert [outcome.text for outcome in made] == ["0.2 s simulated"] * 2
    for topic in ("joint_states", "joint_command"):
        assert bags[0].raw(topic)[1] == bags[1].raw(topic)[1]
        assert bags[0].topics["/" + topic].count == experiment.ticks


def test_a_second_run_in_a_namespace_is_refused_and_another_namespace_is_not(closed, tmp_path):
    with runner._domain_lock(["a"]):
        with pytest.raises(GraphError, match="namespace a"):
            runner.run(closed, tmp_path / "second", namespace="a")
        with runner._domain_lock(["b", ""]):
            pass
    assert not (tmp_path / "second").exists()


def test_what_the_plant_refuses_ends_the_run_with_its_words(tmp_path):
    with pytest.raises(GraphError, match="whole multiple"):
        runner.run(load("tigrillo_hold", {"control_rate": 300.0}), tmp_path / "odd")
