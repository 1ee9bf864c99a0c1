# SPDX-License-Identifier: Apache-2.0
"""Experiments of joint robots: what they settle, and what they refuse."""

import pickle

import pytest

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.oscillators import CpgParams
from loco_control.params import to_dict
from loco_learning.experiment import Experiment, from_values, load, names, override
from loco_learning.gait_file import Gait
from loco_learning.joint_experiment import JointExperiment, flat
from loco_sim.model import Model

JOINT = [name for name in names() if isinstance(load(name), JointExperiment)]


def test_kind_chooses_the_class():
    assert {"tigrillo_sine", "tigrillo_bound", "tigrillo_walk", "tigrillo_hold"} <= set(JOINT)
    assert isinstance(load("hyq_short"), Experiment)
    with pytest.raises(NameUnknownError, match="joint"):
        from_values({"kind": "joints"})


@pytest.mark.parametrize("name", JOINT)
def test_plain_values_make_the_same_experiment(name):
    experiment = load(name)
    again = from_values(to_dict(experiment))
    assert again == experiment
    assert pickle.loads(pickle.dumps(experiment)) == experiment
    assert experiment.ticks > 0


def test_control_rate_is_the_robots_unless_given():
    assert load("tigrillo_hold").control_rate == load("tigrillo_hold").plant.control_rate
    assert load("tigrillo_hold", {"control_rate": 50.0}).dt == 0.02


def test_overrides_reach_the_robot_nested_or_dotted():
    dotted = load("tigrillo_hold", {"overrides": {"springs.lf_kfe_joint.stiffness": 300.0}})
    nested = load("tigrillo_hold", {"overrides.springs.lf_kfe_joint.stiffness": 300.0})
    assert dotted == nested
    assert dotted.plant.springs["lf_kfe_joint"].stiffness == 300.0
    assert flat({"a": {"b": 1, "c": {"d": 2}}, "e.f": 3}) == {"a.b": 1, "a.c.d": 2, "e.f": 3}


def test_sim_is_the_robots_with_changes_on_top():
    experiment = load("tigrillo_hold", {"sim.friction": 0.25})
    plain = load("tigrillo_hold")
    assert experiment.sim_params == plain.sim_params.replace(friction=0.25)
    assert plain.sim_params == plain.plant.sim


def test_a_model_dissolves_into_robot_overrides_and_effects(tmp_path):
    model = Model(
        "tigrillo",
        {"springs.*_kfe_joint.stiffness": 400.0, "masses.front_body": 0.7},
        [{"name": "command_delay", "delay": 0.02}],
    )
    model.save(tmp_path / "model.yaml")
    changes = {
        "robot": str(tmp_path / "model.yaml"),
        "overrides": {"masses.front_body": 0.6},
        "effects": [{"name": "command_delay", "delay": 0.01}],
    }
    experiment = load("tigrillo_hold", changes)
    assert experiment.robot == "tigrillo"
    assert experiment.plant.springs["rh_kfe_joint"].stiffness == 400.0
    assert experiment.overrides["masses.front_body"] == 0.6  # the experiment's wins
    assert [effect["delay"] for effect in experiment.effects] == [0.02, 0.01]
    assert override(experiment, {"seed": 3}).effects == experiment.effects  # not twice


def test_a_gait_can_be_the_target(tmp_path):
    found = CpgParams(amplitude=(0.1, 0.2, 0.3, 0.4), phase=(0.0, 0.5, 0.5, 0.0))
    path = str(tmp_path / "gait.yaml")
    Gait("mine", "tigrillo", found, {}, 0.1, 1.5, 15.0, 0, 1).save(path)
    assert load("tigrillo_hold", {"target": path}).target == found
    changed = load("tigrillo_walk", {"target": {"gait": path}, "target.amplitude": [0.25]})
    phase = (0.0, 0.5, 0.5, 0.0)
    assert changed.target == found.replace(amplitude=(0.25,), phase=phase)
    with pytest.raises(MissingFileError, match="nowhere"):
        load("tigrillo_hold", {"target": "nowhere.yaml"})


@pytest.mark.parametrize(
    ("changes", "error", "message"),
    [
        ({"robot": "tigrilo"}, NameUnknownError, "tigrillo"),
        ({"robot": "nowhere/robot.yaml"}, MissingFileError, "nowhere"),
        ({"overrides": {"springs.*.stifness": 1.0}}, NameUnknownError, "stiffness"),
        ({"overrides": {"springs.*_kfe_joint.stiffness": -1.0}}, ParameterError, "-1"),
        ({"overrides": [1]}, ParameterError, "mapping"),
        ({"sim": {"frction": 0.1}}, NameUnknownError, "friction"),
        ({"effects": {"name": "push"}}, ParameterError, "list"),
        ({"effects": [{"name": "pussh"}]}, NameUnknownError, "push"),
        ({"target.phase": [0.0, 0.5]}, ParameterError, "4 driven joints"),
        ({"target.amplitude": [9.0]}, ParameterError, "amplitude"),
        ({"gait": {}}, NameUnknownError, "target"),
    ],
)
def test_what_does_not_fit_is_refused(changes, error, message):
    with pytest.raises(error, match=message):
        load("tigrillo_hold", changes)
