# SPDX-License-Identifier: Apache-2.0
"""A model file comes back as it was saved, and what is wrong in one is named."""

import pytest

from loco_control.exceptions import LocoError
from loco_sim.plant import model
from loco_sim.plant.model import Model
from loco_sim.robot import robot

CHANGES = {"masses.front_body": 0.674, "springs.?h_kfe_joint.stiffness": 440.6}
DELAY = [{"name": "command_delay", "delay": 0.1}]


def test_a_saved_model_loads_as_it_was(tmp_path):
    saved = Model("tigrillo", CHANGES, DELAY)
    saved.save(tmp_path / "new" / "model.yaml")
    assert model.load(tmp_path / "new" / "model.yaml") == saved
    assert [file.name for file in (tmp_path / "new").iterdir()] == ["model.yaml"]


def test_a_model_makes_its_robot_and_effects(tmp_path):
    made = Model("tigrillo", CHANGES, DELAY)
    assert made.make_robot().springs["lh_kfe_joint"].stiffness == 440.6
    assert [effect.name for effect in made.make_effects()] == ["command_delay"]


def test_any_name_or_path_is_a_model(tmp_path):
    path = tmp_path / "model.yaml"
    Model("tigrillo", CHANGES).save(path)
    assert model.load_any(path) == Model("tigrillo", CHANGES)
    assert model.load_any("hyq") == Model("hyq")
    bench = robot.ASSETS / "pendulum"
    assert model.load_any(bench).make_robot().name == "pendulum"
    assert model.load_any(bench / "robot.yaml").make_robot().name == "pendulum"


def test_the_path_of_a_robot_starts_at_the_model(tmp_path):
    (tmp_path / "bench").mkdir()
    for name in ("robot.yaml", "pendulum.urdf"):
        text = (robot.ASSETS / "pendulum" / name).read_text()
        (tmp_path / "bench" / name).write_text(text)
    (tmp_path / "model.yaml").write_text("format: 1\nrobot: bench\n")
    assert model.load(tmp_path / "model.yaml").make_robot().joints == ("pivot",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format: 2\nrobot: tigrillo\n", "has format 2; this version reads 1"),
        ("robot: tigrillo\n", "has format None"),
        ("format: 1\n", "mapping with 'format' and 'robot'"),
        ("[", "is not YAML"),
        ("format: 1\nrobot: tigrillo\nextra: 1\n", "no key in"),
        ("format: 1\nrobot: tigrilla\n", "there is no robot at"),
        ("format: 1\nrobot: tigrillo\noverrides: {masses.x: 1}\n", "no link"),
        ("format: 1\nrobot: tigrillo\noverrides: [1]\n", "must be a mapping"),
        ("format: 1\nrobot: tigrillo\neffects: [{name: magic}]\n", "no effect named 'magic'"),
        ("format: 1\nrobot: tigrillo\neffects: [{name: push, power: 1}]\n", "power"),
    ],
)
def test_a_wrong_model_is_refused(tmp_path, text, message):
    path = tmp_path / "model.yaml"
    path.write_text(text)
    with pytest.raises(LocoError, match=message):
        model.load(path)


LEARNED = "format: 1\nrobot: pendulum\neffects: [{{name: learned_residual, {}}}]\n"


@pytest.mark.parametrize(
    ("hostile", "message"),
    [
        ("weights: [1, 2, 3]", "weights must have 18 values, got 3"),
        ("weights: [" + "1, " * 17 + ".nan]", r"weights\[17\] must be in \[-10000, 10000\]"),
        ("weights: [" + "1, " * 17 + "1.0e+9]", r"weights\[17\] must be in \[-10000, 10000\]"),
        ("weights: /etc/passwd", "weights must be a list of 18 numbers"),
        ("weights: [" + "1, " * 17 + "{a: 1}]", r"weights\[17\] must be a number"),
        ("travel: 0", "travel must be in"),
        ("speed: .inf", "speed must be in"),
        ("file: ../../weights.npz", "no parameter in effect learned_residual named 'file'"),
    ],
)
def test_hostile_weights_of_a_learned_correction_are_one_line(tmp_path, hostile, message):
    (tmp_path / "model.yaml").write_text(LEARNED.format(hostile))
    with pytest.raises(LocoError, match=message) as error:
        model.load(tmp_path / "model.yaml")
    assert "\n" not in str(error.value)


def test_a_model_with_a_learned_correction_says_that_it_explains_nothing():
    learned = Model("pendulum", {}, [{"name": "learned_residual", "weights": [0.01] * 18}])
    assert "explains nothing" in learned.dumps() and model.loads(learned.dumps()) == learned
    assert "explains nothing" not in Model("pendulum", {}, DELAY).dumps()


def test_a_model_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(LocoError, match="there is no model at"):
        model.load(tmp_path / "model.yaml")


def test_a_model_that_cannot_be_written_leaves_nothing(tmp_path):
    with pytest.raises(Exception, match="cannot represent"):
        Model("tigrillo", {"masses.front_body": object()}).save(tmp_path / "model.yaml")
    assert list(tmp_path.iterdir()) == []
