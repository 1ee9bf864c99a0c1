# SPDX-License-Identifier: Apache-2.0
"""Reading experiments: all that ship are sound, all mistakes get one clear message."""

import pytest

from loco_control.exceptions import LocoError, MissingFileError, NameUnknownError, ParameterError
from loco_control.params import to_dict
from loco_learning import experiment
from loco_learning.experiment import Experiment, from_values, load, merge, names, override


def write(folder, text, name="mine"):
    path = folder / f"{name}.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", names())
def test_every_experiment_reads_describes_itself_and_survives_a_round_trip(name):
    made = load(name)
    assert made.name == name
    assert len(made.description) > 20
    assert made.ticks > 0
    assert from_values(to_dict(made)) == made


def test_the_ones_that_documents_name_exist():
    wanted = {"hyq_trot_open", "hyq_trot_reflex", "hyq_trot_long", "hyq_author_scaling",
              "hyq_short", "chapter8_pse", "chapter8_rse"}  # fmt: skip
    assert wanted <= set(names())


def test_chapter_8_estimators_differ_in_nothing_but_the_estimator():
    pse, rse = (to_dict(load(f"chapter8_{kind}")) for kind in ("pse", "rse"))
    differing = {key for key in pse if pse[key] != rse[key]}
    assert differing == {"name", "description", "stance"}
    assert pse["criterion"] == {"fall": True, "phase_slip": 1.0, "freeze": 0.2, "nrmse": 0.3}
    delay = load("chapter8_pse").effects[0]
    test_start = sum(pse["learner"][phase] for phase in ("stand", "train", "closing"))
    assert delay["start"] == test_start + 10.0
    assert rse["stance"]["estimator_start"] == test_start - pse["learner"]["closing"]


def test_duration_is_that_of_the_phases_unless_given():
    made = load("hyq_short")
    assert made.ticks == round(made.learner.duration * 250)
    assert override(made, {"duration": 2.0}).ticks == 500


def test_overrides_reach_any_depth_and_are_checked():
    made = load("hyq_short", {"learner.memory": 30, "gait.speed": 0.1, "seed": 4})
    assert (made.learner.memory, made.gait.speed, made.seed) == (30, 0.1, 4)
    assert made.learner.train == load("hyq_short").learner.train
    with pytest.raises(NameUnknownError, match="memori.*did you mean 'memory'"):
        load("hyq_short", {"learner.memori": 30})


def test_a_file_may_extend_another_file_or_an_experiment(tmp_path):
    write(tmp_path, "extends: hyq_trot_reflex\ngait: {speed: 0.1}\nseed: 3\n", "base")
    made = load(write(tmp_path, "extends: base.yaml\ngait: {step_height: 0.05}\n"))
    assert (made.gait.speed, made.gait.step_height, made.seed) == (0.1, 0.05, 3)
    assert made.gait.frequency == load("hyq_trot_reflex").gait.frequency
    assert (made.name, made.description) == ("mine", "")


def test_lists_are_replaced_and_mappings_merged():
    base = {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    assert merge(base, {"a": {"c": 3}, "d": [4]}) == {"a": {"b": 1, "c": 3}, "d": [4]}
    assert base["a"]["c"] == 2


def test_numbers_in_scientific_notation_are_numbers(tmp_path):
    made = load(write(tmp_path, "learner: {regularisation: 1e-4}\n"))
    assert made.learner.regularisation == 1e-4


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("gait: {speed: 0.1", ParameterError, r"mine.yaml, line 1"),
        ("seed: 1\nname: a: b\n", ParameterError, r"mine.yaml, line 2"),
        ("- 1\n", ParameterError, "must hold a mapping"),
        ("", ParameterError, "must hold a mapping"),
        ("seed: 1\nseed: 2\n", ParameterError, r"line 2: 'seed' is given twice"),
        ("gait: {spede: 0.1}\n", NameUnknownError, "spede.*did you mean 'speed'"),
        ("gaits: {}\n", NameUnknownError, "gaits.*did you mean 'gait'"),
        ("gait: fast\n", ParameterError, "mine.gait must be a mapping"),
        ("learner: {memory: many}\n", ParameterError, "mine.learner.memory must be a number"),
        ("learner: {memory: 0}\n", ParameterError, r"memory must be in \[1, 1000\]"),
        ("learner: {enabled: 1}\n", ParameterError, "enabled must be true or false"),
        ("robot: anymal\n", NameUnknownError, "anymal.*available: hyq"),
        ("effects: {name: push}\n", ParameterError, "effects must be a list"),
        ("effects: [push]\n", ParameterError, r"effects\[0\] must be a mapping"),
        ("effects: [{name: pusch}]\n", NameUnknownError, "no effect named 'pusch'"),
        ("effects: [{name: command_delay, delay: -1}]\n", ParameterError, "delay must be in"),
        ("extends: 3\n", ParameterError, "extends must be the name"),
        ("extends: nothing\n", NameUnknownError, "no experiment named 'nothing'"),
        ("extends: gone.yaml\n", MissingFileError, "gone.yaml"),
        ("extends: mine.yaml\n", ParameterError, "extends itself"),
    ],
)
def test_a_mistake_in_a_file_gets_one_clear_message(tmp_path, text, kind, message):
    with pytest.raises(kind, match=message) as caught:
        load(write(tmp_path, text))
    assert isinstance(caught.value, LocoError)
    assert "\n" not in str(caught.value)


def test_unknown_names_and_missing_files():
    with pytest.raises(NameUnknownError, match="did you mean 'hyq_short'"):
        load("hyq_shrot")
    with pytest.raises(MissingFileError, match="nowhere.yaml"):
        load("nowhere.yaml")


def test_unreadable_bytes_are_a_missing_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MissingFileError, match="cannot read"):
        load(path)


def test_effects_are_checked_in_code_too():
    with pytest.raises(ParameterError, match="effects must be a list"):
        Experiment(effects={"name": "push"})
    made = Experiment(effects=[{"name": "command_delay", "delay": 0.01}])
    assert made.replace(seed=1).effects == made.effects
    assert experiment.override(made, {"seed": 1}).effects == made.effects
