# SPDX-License-Identifier: Apache-2.0
"""Node sets, and the ROS parameters an experiment becomes."""

import json

import pytest

from loco_bringup.graph import node_set
from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.names import LEGS
from loco_control.ros.messages.joint_topics import JOINT_NODES, TABLES
from loco_control.ros.messages.topics import NODES
from loco_learning.runs.experiment import load
from loco_sim.engines import default_engine


def content(experiment):
    run = {"recorded": True, "recorder": {"bag": "b"}, "weights": "w.npz"}
    tick = {"clock": "lockstep", "speed": 0.0, "duration": 1.0}
    return node_set.parameter_file(node_set.load("hyq"), experiment, tick, run)


@pytest.mark.parametrize(("name", "nodes"), [("hyq", NODES), ("joint", JOINT_NODES)])
def test_the_set_holds_the_nodes_of_the_topic_table(name, nodes):
    assert {spec.name for spec in node_set.load(name)} == set(nodes)
    assert {row.writer for row in TABLES[node_set.table_of(name)].values()} >= set(nodes)


def test_a_module_beside_the_set_is_named_with_its_folder(tmp_path):
    (tmp_path / "mine.py").touch()
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/__init__.py").touch()
    names = ["mine:Node", "parts.legs:Node", "elsewhere:Node"]
    rows = "".join(f"  - {{name: n{i}, class: '{name}'}}\n" for i, name in enumerate(names))
    (tmp_path / "set.yaml").write_text(f"table: joint\nnodes:\n{rows}")
    classes = [spec.cls for spec in node_set.load(str(tmp_path / "set.yaml"))]
    assert classes == [f"{tmp_path}/mine:Node", f"{tmp_path}/parts.legs:Node", "elsewhere:Node"]


def test_every_experiment_value_reaches_a_node():
    overrides = {"gait.speed": 0.11, "learner.memory": 33, "trunk.mass": 70.0, "seed": 9}
    made = content(load("hyq_trot_reflex", overrides))
    at = {name.split("/")[-1]: node["ros__parameters"] for name, node in made.items()}
    assert at["target_generator"]["gait"]["speed"] == 0.11
    assert at["reflex_network"]["learner"]["memory"] == 33
    assert at["stance_controller"]["trunk"]["mass"] == 70.0
    assert at["robot_sim"]["seed"] == at["reflex_network"]["seed"] == 9


def test_every_value_of_a_joint_experiment_reaches_a_node():
    overrides = {
        "target.frequency": 1.25,
        "learner.memory": 33,
        "overrides": {"masses.front_body": 0.7},
        "sim.friction": 0.3,
        "effects": [{"name": "command_delay", "delay": 0.02}],
        "seed": 9,
    }
    experiment = load("tigrillo_walk", overrides)
    run = {"recorded": True, "recorder": None, "weights": "w.npz"}
    made = node_set.parameter_file(node_set.load("joint"), experiment, {"clock": "asap"}, run)
    at = {name.split("/")[-1]: node["ros__parameters"] for name, node in made.items()}
    assert "recorder" not in at
    plant = at["robot_sim"]
    assert json.loads(plant["overrides"]) == {"masses.front_body": 0.7}
    assert json.loads(plant["sim"]) == {"friction": 0.3, "engine": default_engine()}
    assert json.loads(plant["effects"])[0]["delay"] == 0.02
    assert plant["seed"] == at["reflex_network"]["seed"] == 9
    assert plant["clock"] == "asap"
    assert at["target_generator"]["target"]["frequency"] == 1.25
    assert at["reflex_network"]["learner"]["memory"] == 33
    assert at["target_generator"]["driven"] == [f"{leg}_hfe_joint" for leg in LEGS]


@pytest.mark.parametrize(("name", "nodes"), [("tigrillo_walk", "hyq"), ("hyq_short", "joint")])
def test_an_experiment_of_the_other_kind_is_refused(name, nodes):
    experiment = load(name)
    run = {"recorded": False, "weights": ""}
    with pytest.raises(ParameterError, match=f"its node set is {experiment.node_set}"):
        node_set.parameter_file(node_set.load(nodes), experiment, {}, run)


@pytest.mark.parametrize("text", ["nodes: 3", "nodes: [{class: a}]", "nodes: [", "[]"])
def test_broken_sets_are_named(tmp_path, text):
    path = tmp_path / "set.yaml"
    path.write_text(text)
    with pytest.raises(ParameterError, match=r"set\.yaml.* is not "):
        node_set.load(str(path))


def test_unknown_parts_name_the_known(tmp_path):
    path = tmp_path / "set.yaml"
    path.write_text("nodes: [{name: a, class: b, parameters: [gate]}]")
    with pytest.raises(NameUnknownError, match="gait"):
        node_set.load(str(path))
    path.write_text("table: joints\nnodes: []")
    with pytest.raises(NameUnknownError, match="joint"):
        node_set.load(str(path))
