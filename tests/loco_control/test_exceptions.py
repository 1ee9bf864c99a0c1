# SPDX-License-Identifier: Apache-2.0
"""Errors are of two kinds at once and tell the legal choices."""

import inspect

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


def test_unknown_name_lists_the_names_and_guesses():
    error = NameUnknownError("effect", "joint_frction", ["push", "joint_friction"])
    assert str(error) == (
        "no effect named 'joint_frction' (did you mean 'joint_friction'?); "
        "available: joint_friction, push"
    )


def test_unknown_name_says_when_there_is_none():
    assert str(NameUnknownError("bag", "x", [])).endswith("available: none")
