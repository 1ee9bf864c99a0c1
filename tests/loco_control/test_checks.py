# SPDX-License-Identifier: Apache-2.0
"""Values that do not fit an annotation are one line with place, wish and value."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypedDict

import numpy as np
import pytest

from loco_control.checks import Between, Naming, check, check_file, checked, keys_of
from loco_control.exceptions import ParameterError


class Row(TypedDict):
    name: str
    size: int


class More(Row, total=False):
    note: str


@dataclass
class Part:
    speed: float
    note: str = ""


@dataclass
class Whole:
    parts: tuple[Part, ...]
    table: dict[str, float]


RIGHT = [
    (3, int), (np.int64(3), int), (3, float), (np.float32(0.5), float), (True, bool), ("a", str),
    (None, None | str), (None, type(None)), ([1, 2], list[int]), ((1, 2), tuple[int, ...]),
    ((1, "a"), tuple[int, str]), ([], Sequence[str]), ({"a": 1.0}, dict[str, float]),
    ({}, Mapping[str, int]), ("a", Literal["a", "b"]), (len, Callable[[str], int]),
    (Path("a"), str | Path), (Path("a/" + "b" * 255), Annotated[str | Path, Naming()]), (4, Annotated[int, Between(1, 4)]), ({"name": "a", "size": 1}, Row),
    ({"name": "a", "size": 1, "other": []}, Row), ({"name": "a", "size": 1, "note": "b"}, More),
    (object(), Any),
]  # fmt: skip
WRONG = [
    ("3", int, "x must be a whole number, got '3'"),
    (True, int, "whole number, got True"),
    (2**63, int, "whole number, got 9223372036854775808"),
    (10**400, float, "a finite number"),
    (float("nan"), float, "a finite number, got nan"),
    (float("inf"), float, "a finite number, got inf"),
    (1, bool, "true or false, got 1"),
    (b"a", str, "a text"),
    (None, str, "a text, got None"),
    (3, str | Path, "x must be a text or a path, got 3"),
    ("ab", list[str], "x must be a list, each a text, got 'ab'"),
    ([1, "a"], list[int], r"x\[1\] must be a whole number, got 'a'"),
    ((1,), tuple[int, str], "x must have 2 values"),
    ({"a": "b"}, dict[str, int], "x.a must be a whole number"),
    ({3: 1}, dict[str, int], "a key of x must be a text, got 3"),
    ("c", Literal["a", "b"], "one of 'a', 'b', got 'c'"),
    (3, Callable[[str], int], "a function of 1 values, got 3"),
    (lambda: 0, Callable[[str], int], "a function of 1 values"),
    (int, Callable[[str, str, str], int], "a function of 3 values"),
    (0, Annotated[int, Between(1, 4)] | None, r"x must be in \[1, 4\], got 0"),
    ("", Annotated[str | Path, Naming()] | None, "x must be a name or path"),
    ("", Annotated[str | Path, Naming()], "x must be a name or path, .* got ''"),
    ("a\0b", Annotated[str | Path, Naming()], "x must be a name or path"),
    (Path("a/" + "b" * 256), Annotated[str | Path, Naming()], "at most 255 bytes"),
    (np.zeros(3), Literal["a", "b"], "one of 'a', 'b'"),
    (5, Annotated[int, Between(1, 4)], r"x must be in \[1, 4\], got 5"),
    ({"name": "a"}, Row, "x lacks the key 'size', wanted is a whole number"),
    ({"name": "a", "size": 1, "note": 2}, More, "x.note must be a text, got 2"),
    ([], Row, "x must be a mapping"),
    ({"rows": [{"name": 1, "size": 1}]}, dict[str, list[Row]], r"x.rows\[0\].name must be a text"),
    ([{"name": 1, "size": 1}], list[Row] | None, r"x\[0\].name must be a text"),
    ("y" * 10**6, int, "got 'y+…$"),
]


@pytest.mark.parametrize(("value", "hint"), RIGHT)
def test_what_fits_passes(value, hint):
    check(value, hint, "x")


@pytest.mark.parametrize(("value", "hint", "words"), WRONG, ids=range(len(WRONG)))
def test_what_does_not_fit_is_one_short_line(value, hint, words):
    with pytest.raises(ParameterError, match=words) as error:
        check(value, hint, "x")
    assert "\n" not in str(error.value) and len(str(error.value)) < 300


def test_values_of_a_file_name_file_and_key():
    check_file({"name": "a", "size": 1}, Row, "a.json")
    for values, words in (
        ({"name": "a", "size": math.nan}, "a.json: size must be a whole number, got nan"),
        ({"name": "a"}, "a.json: it lacks the key 'size'"),
        ([], r"a.json: it must be a mapping, got \[\]"),
    ):
        with pytest.raises(ParameterError, match=words):
            check_file(values, Row, "a.json")


def test_keys_of_a_file_are_the_fields_of_its_dataclass():
    keys = keys_of(Whole, count=int)
    right = {"parts": [{"speed": math.nan}], "table": {"a": 1}, "count": 2}
    check(right, keys, "")
    for wrong, words in (
        ({"parts": [{}]}, r"parts\[0\] lacks the key 'speed'"),
        ({"parts": [{"speed": "a"}]}, r"parts\[0\].speed must be a number"),
        ({"table": {"a": "b"}}, "table.a must be a number"),
        ({"count": 1.5}, "count must be a whole number"),
    ):
        with pytest.raises(ParameterError, match=words):
            check({**right, **wrong}, keys, "")


@checked
def add(a: int, b: float = 0.5, *rest: int, c: str | None = None, **options: float) -> float:
    """Sum."""
    return a + b + sum(rest) + len(c or "") + sum(options.values())


def test_arguments_are_those_of_the_annotations():
    assert add(1) == 1.5
    assert add(1, 2, 3, 4, c="ab", d=1.0) == 13.0
    for arguments, more, words in (
        (("1",), {}, "a must be a whole number, got '1'"),
        ((1, None), {}, "b must be a finite number, got None"),
        ((1, 2, 3, "4"), {}, r"rest\[1\] must be a whole number"),
        ((1,), {"c": 3}, "c must be a text or nothing, got 3"),
        ((1,), {"d": "e"}, "options.d must be a finite number"),
        ((), {}, "add: missing a required argument: 'a'"),
        ((1,), {"a": 2}, "add: multiple values for argument 'a'"),
    ):
        with pytest.raises(ParameterError, match=words):
            add(*arguments, **more)
