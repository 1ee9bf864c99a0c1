# SPDX-License-Identifier: Apache-2.0
"""Errors are of two kinds at once and tell the legal choices."""

import inspect
import pickle

import pytest

from loco_control import exceptions
from loco_control.exceptions import LocoError, NameUnknownError

CLASSES = [
    cls
    for _, cls in inspect.getmembers(exceptions, inspect.isclass)
    if cls.__module__ == exceptions.__name__ and cls is not LocoError
]


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_every_error_is_a_loco_error_and_a_built_in(cls):
    assert issubclass(cls, LocoError)
    assert any(base.__module__ == "builtins" for base in cls.__bases__)


LONG = {
    "word": "x" * 5000,
    "quoted": repr("a word " * 900),
    "list": repr(list(range(3000))),
    "mapping": repr({f"k{i}": [i, {"a": "b"}] for i in range(900)}),
    "open list": repr(list(range(3000)))[:-1],
    "bytes": repr(b"a\0\xff'\" " * 900),
    "path": "/a" * 3000,
}


def kinds():
    found, todo = [], [LocoError]
    while todo:
        found.append(todo.pop())
        todo += found[-1].__subclasses__()
    return found


@pytest.mark.parametrize("value", LONG.values(), ids=LONG)
def test_values_are_cut_in_the_messages_of_all_classes(value):
    for cls in kinds():
        if cls is NameUnknownError:
            error = cls("effect", value, ["push"])
        else:
            error = cls(f"robot must be a text, got {value} (the robot's own)")
            assert str(error).endswith(" (the robot's own)") or value is LONG["open list"]
            assert str(error).startswith("robot must be a text, got ")
        assert "…" in str(error)
        assert len(str(error)) < exceptions.MOST + 100
        again = pickle.loads(pickle.dumps(error))
        assert (type(again), str(again)) == (cls, str(error))


def test_short_messages_and_long_prose_stay_as_they_are():
    prose = "the robot's joints and the model's links " * 20
    for text in (prose, "a 'b' [1, 2] {3: 4}", "it's " * 60 + "over", "'" + "a b " * 40 + "'"):
        assert str(LocoError(text)) == text
    assert len(str(LocoError("word " * 10**5))) == 2000
    assert OSError(2, "no", "a").filename == "a"
    assert exceptions.MissingFileError("x").args == ("x",)


class Unprintable:
    def __repr__(self):
        raise RuntimeError


@pytest.mark.parametrize(
    "value", [10**5000, Unprintable(), "x" * 10**7, [10**5000]], ids=["number", "object", "text", "list"]
)
def test_any_value_can_be_shown(value):
    assert len(exceptions.shown(value)) <= 60
    assert len(str(NameUnknownError("robot", value, ["a"]))) < 300


def test_unknown_name_lists_the_names_and_guesses():
    error = NameUnknownError("effect", "joint_frction", ["push", "joint_friction"])
    assert str(error) == (
        "no effect named 'joint_frction' (did you mean 'joint_friction'?); "
        "available: joint_friction, push"
    )


def test_unknown_name_says_when_there_is_none():
    assert str(NameUnknownError("bag", "x", [])).endswith("available: none")
