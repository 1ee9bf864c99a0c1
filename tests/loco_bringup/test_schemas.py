# SPDX-License-Identifier: Apache-2.0
"""Schemas: shipped files are valid, and a value is legal exactly where the reader takes it."""

import dataclasses
import itertools
import json
import typing
from pathlib import Path

import jsonschema
import pytest

from loco_bringup import schemas
from loco_control.exceptions import LocoError
from loco_control.params import Params, from_dict, to_dict
from loco_control.reading import parse_yaml, read_yaml
from loco_learning.plain import plain
from loco_learning.runs import experiment
from loco_learning.thesis import evidence
from loco_sim.effects import EFFECTS
from loco_sim.plant import model

TOP = Path(__file__).parents[2]
SHIPPED = {
    "experiment": "src/loco_learning/loco_learning/experiments/*.yaml",
    "robot": "src/loco_sim/loco_sim/assets/*/robot.yaml",
    "gait": "src/loco_learning/loco_learning/gaits/*.yaml",
    "study": "src/loco_learning/loco_learning/studies/*.yaml",
    "mapping": "bags/**/mapping.yaml",
}
VALUES = (
    True, "abc", None, [], {}, {"no": 1}, 0, 1, -1, 2, 3, 0.5, 1e-9, 1e12, -1e12,
    [0.0], [1, 2], ["a"], [0.1, 0.2, 0.3], [0.1, 0.2, 0.3, 0.4], [1e12], [-1, -1, -1, -1],
)  # fmt: skip


def valid(kind, values):
    return jsonschema.Draft202012Validator(schemas.schema(kind)).is_valid(values)


def files(kind):
    return sorted(TOP.glob(SHIPPED[kind]))


@pytest.mark.parametrize("kind", schemas.SCHEMAS)
def test_a_schema_is_one_and_is_json(kind):
    made = schemas.schema(kind)
    jsonschema.Draft202012Validator.check_schema(made)
    assert json.loads(json.dumps(made, allow_nan=False)) == made


@pytest.mark.parametrize("kind", SHIPPED)
def test_shipped_files_are_valid_and_a_wrong_key_is_not(kind):
    assert files(kind)
    validator = jsonschema.Draft202012Validator(schemas.schema(kind))
    for path in files(kind):
        values = read_yaml(path)
        validator.validate(values)
        assert not validator.is_valid({**values, "no such key": 1}), path


def test_locked_joints_and_a_scale_of_times_are_valid():
    made = read_yaml(files("robot")[0])
    assert valid("robot", {**made, "locked": {"finger": 0.01}})
    assert not valid("robot", {**made, "locked": {"finger": "open"}})
    columns = [{"column": "q", "role": "q", "joint": "knee"}]
    assert valid("mapping", {"time": {"column": "t", "scale": 0.5}, "columns": columns})


def test_plans_are_valid():
    for name, entries in read_yaml(evidence.file("plans.yaml")).items():
        assert valid("plan", entries), name


def test_a_model_is_valid_and_an_effect_that_is_not_there_is_not():
    effect = {"name": "command_delay", "delay": 0.1}
    made = model.Model("tigrillo", {"masses.front_body": 0.7}, [effect])
    assert valid("model", parse_yaml(made.dumps(), "model.yaml"))
    for wrong in ({"name": "no_such_effect"}, {**effect, "delay": -1.0}, {"delay": 0.1}):
        assert not valid("model", {"format": 1, "robot": "hyq", "effects": [wrong]})


def test_an_experiment_as_it_is_saved_is_valid():
    for name in experiment.names():
        saved = plain(to_dict(experiment.load(name)))
        assert valid("experiment", saved), name


def parameter_classes(cls=Params):
    """Of loco: other test files, read by the same process, make classes of their own."""
    for kind in cls.__subclasses__():
        yield from (kind, *parameter_classes(kind))


CLASSES = {
    cls.__name__: cls
    for cls in (*parameter_classes(), *EFFECTS.values())
    if cls.__module__.startswith("loco_")
}
del CLASSES["Experiment"]  # it says itself what it takes; the files above are its test


@pytest.mark.parametrize("cls", CLASSES.values(), ids=CLASSES)
def test_a_value_is_valid_where_the_class_takes_it(cls):
    """Values that only a combination forbids are the reader's own business."""
    validator = jsonschema.Draft202012Validator(schemas.of_params(cls))
    hints = typing.get_type_hints(cls)
    own = [f.name for f in dataclasses.fields(cls) if not dataclasses.is_dataclass(hints[f.name])]
    for name, value in itertools.product(own, VALUES):
        try:
            from_dict(cls, {name: value})
            taken = True
        except LocoError as error:
            taken = f"{cls.__name__}.{name}" not in str(error)
        assert validator.is_valid({name: value}) == taken, (name, value)
