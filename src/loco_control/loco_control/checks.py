# SPDX-License-Identifier: Apache-2.0
"""Checks of values against type annotations: contents of input files, arguments of functions.

The annotation is the schema: a `TypedDict` for the keys of a file, the signature of a function for
its arguments. The error is one line that names the location, the expected type and the value.
"""

from __future__ import annotations

import collections.abc
import dataclasses
import functools
import inspect
import math
import numbers
import os
import types
import typing
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from .exceptions import ParameterError
from .reading import shown

F = TypeVar("F", bound=Callable[..., Any])

_FILE = "it"  # name of the whole file in messages
_LARGEST = 2**63  # integers below this bound fit into arrays and messages
_TYPE_NAMES = {
    numbers.Real: "a number", bool: "true or false", int: "a whole number", float: "a finite number", str: "a text",
    Any: "any value", type(None): "nothing", dict: "a mapping", list: "a list",
}  # fmt: skip
_type_hints = functools.cache(functools.partial(typing.get_type_hints, include_extras=True))


@dataclass(frozen=True)
class Between:
    """Range of a number, as in ``Annotated[int, Between(1, 64)]``; both ends are legal."""

    low: float
    high: float


@dataclass(frozen=True)
class Naming:
    """Name or path that a file system accepts, as in ``Annotated[str | Path, Naming()]``."""

    longest: int = 255  # longest path component [bytes]
    max_path: int = 4095  # longest path [bytes]


def check(value: Any, hint: Any, name: str) -> None:
    """Refuse a value that does not fit an annotation.

    Numbers must be finite, integers below 2**63 in magnitude; a boolean is not a number. A mapping
    may have keys beyond those of its `TypedDict`; with ``total=False`` all keys are optional.

    Args:
        value: The value.
        hint: A type, a union, ``list[...]``, ``dict[str, ...]``, a `TypedDict` and the like.
        name: Location of the value, for the message.

    Raises:
        ParameterError: The value does not fit.
    """
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if hint is Any:
        return
    if origin is typing.Annotated:
        check(value, inner[0], name)
        _check_marks(value, inner[1:], name)
    elif origin in (typing.Union, types.UnionType):
        _check_union(value, hint, inner, name)
    elif typing.is_typeddict(hint):
        _check_keys(value, hint, name)
    elif origin in (collections.abc.Mapping, dict):
        _demand(isinstance(value, collections.abc.Mapping), value, hint, name)
        for key, entry in value.items():
            _demand(isinstance(key, inner[0]), key, inner[0], f"a key of {name or _FILE}")
            check(entry, inner[1], _inside(name, shown(key)[1:-1]))
    elif origin in (collections.abc.Sequence, list, tuple):
        _check_list(value, hint, inner, name)
    elif origin is collections.abc.Callable and isinstance(inner[0], list):
        _demand(_takes(value, len(inner[0])), value, hint, name)
    elif origin is typing.Literal:
        _demand(any(type(value) is type(one) and value == one for one in inner), value, hint, name)
    else:
        _demand(_is(value, origin or hint), value, hint, name)


def check_file(values: Any, hint: Any, path: str | Path) -> None:
    """Refuse values of a file that do not fit an annotation; see `check`.

    Raises:
        ParameterError: A value does not fit; the message names file and key.
    """
    try:
        check(values, hint, "")
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def keys_of(kind: type, **added: Any) -> Any:
    """`TypedDict` of the values of a dataclass in a file: its fields without a default.

    A number may be NaN; the annotation of a nested dataclass is that of its fields.

    Args:
        kind: The dataclass.
        added: Annotations of further keys, or in place of those of the fields.
    """
    fields = [f.name for f in dataclasses.fields(kind) if f.default is f.default_factory]
    keys = {name: _in_file(_type_hints(kind)[name]) for name in fields}
    return typing.TypedDict(kind.__name__, {**keys, **added})  # type: ignore[operator]


def _in_file(hint: Any) -> Any:
    if dataclasses.is_dataclass(hint):
        return keys_of(hint)
    inner = tuple(map(_in_file, typing.get_args(hint)))
    return typing.get_origin(hint)[inner] if inner else numbers.Real if hint is float else hint


def _inside(name: str, key: str) -> str:
    return f"{name}.{key}" if name else key


def _is(value: Any, kind: Any) -> bool:
    """Whether a value has a type; numbers must be finite, a boolean is not a number."""
    if kind in (int, float):
        real = isinstance(value, numbers.Integral if kind is int else numbers.Real)
        bound = _LARGEST if isinstance(value, numbers.Integral) else math.inf
        return real and not isinstance(value, bool) and -bound < value < bound
    if kind is collections.abc.Callable:
        return callable(value)
    return isinstance(value, kind)


def _takes(value: Any, count: int) -> bool:
    """Whether a value is a function that can be called with `count` positional arguments."""
    if not callable(value):
        return False
    try:
        inspect.signature(value).bind(*[None] * count)
    except TypeError:
        return False
    except ValueError:  # some built-in functions have no signature
        return not isinstance(value, type)
    return True


def _check_marks(value: Any, marks: tuple, name: str) -> None:
    for mark in marks:
        if isinstance(mark, Naming) and isinstance(value, (str, Path)):
            text = str(value)
            longest = max(len(part.encode("utf-8", "replace")) for part in text.split("/"))
            if not text or "\0" in text or longest > mark.longest or len(text) > mark.max_path:
                raise ParameterError(
                    f"{name} must be a name or path, with at most {mark.longest} bytes between "
                    f"two / and without null bytes, got {shown(text)}"
                )
        if isinstance(mark, Between) and value is not None and not mark.low <= value <= mark.high:
            raise ParameterError(
                f"{name} must be in [{mark.low:g}, {mark.high:g}], got {shown(value)}"
            )


def _check_union(value: Any, hint: Any, types: tuple, name: str) -> None:
    """Refuse a value that fits no member of a union, with the error of the closest member."""
    deeper = None
    for kind in types:
        try:
            return check(value, kind, name)
        except ParameterError as error:
            if getattr(error, "place", None) != name:  # right container, wrong value inside
                deeper = error
    if deeper:
        raise deeper
    raise _wrong(value, hint, name)


def _check_keys(value: Any, hint: Any, name: str) -> None:
    _demand(isinstance(value, dict), value, dict, name)
    for key, kind in _type_hints(hint).items():
        if key in value:
            check(value[key], kind, _inside(name, key))
        elif key in hint.__required_keys__:
            raise ParameterError(f"{name or _FILE} lacks the key {key!r}, wanted is {phrase(kind)}")


def _check_list(value: Any, hint: Any, inner: tuple, name: str) -> None:
    listed = isinstance(value, (collections.abc.Sequence, collections.abc.Set))
    _demand(listed and not isinstance(value, (str, bytes)), value, hint, name)
    if typing.get_origin(hint) is tuple and inner[-1] is not ...:
        if len(value) != len(inner):
            raise ParameterError(f"{name} must have {len(inner)} values, got {shown(value)}")
        element_types = inner
    else:
        element_types = (inner[0],) * len(value)
    for k, (entry, kind) in enumerate(zip(value, element_types, strict=True)):
        check(entry, kind, f"{name}[{k}]")


def _demand(right: bool, value: Any, hint: Any, name: str) -> None:
    if not right:
        raise _wrong(value, hint, name)


def _wrong(value: Any, hint: Any, name: str) -> ParameterError:
    error = ParameterError(f"{name or _FILE} must be {phrase(hint)}, got {shown(value)}")
    error.place = name  # type: ignore[attr-defined]
    return error


def phrase(hint: Any) -> str:
    """Description of the values that an annotation allows, for messages."""
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return phrase(inner[0])
    if origin in (typing.Union, types.UnionType):
        return " or ".join(dict.fromkeys(phrase(kind) for kind in inner))
    if origin is typing.Literal:
        return f"one of {', '.join(map(repr, inner))}"
    if origin in (collections.abc.Mapping, dict) or typing.is_typeddict(hint):
        return "a mapping"
    if origin in (collections.abc.Sequence, list, tuple):
        return f"a list, each {phrase(inner[0])}" if inner else "a list"
    if origin is collections.abc.Callable:
        count = len(inner[0]) if isinstance(inner[0], list) else 0
        return f"a function of {count} values" if count else "a function"
    if isinstance(hint, type) and issubclass(hint, os.PathLike):
        return "a path"
    return _TYPE_NAMES.get(hint) or f"a {getattr(hint, '__name__', hint)}"


def checked(function: F) -> F:
    """Decorator: every argument is checked against its annotation before the function runs.

    Raises:
        ParameterError: An argument does not fit, is missing, or is not a parameter of the function.
    """
    signature = inspect.signature(function)

    @functools.wraps(function)
    def run(*arguments: Any, **keywords: Any) -> Any:
        type_hints = {"self": Any, **_type_hints(function)}
        try:
            bound = signature.bind(*arguments, **keywords)
        except TypeError as error:
            raise ParameterError(f"{function.__name__}: {error}") from None
        for name, value in bound.arguments.items():
            kind = signature.parameters[name].kind
            several = {
                inspect.Parameter.VAR_KEYWORD: dict[str, type_hints[name]],
                inspect.Parameter.VAR_POSITIONAL: tuple[type_hints[name], ...],
            }
            check(value, several.get(kind, type_hints[name]), name)
        return function(*arguments, **keywords)

    return run  # type: ignore[return-value]
