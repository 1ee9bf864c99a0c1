# SPDX-License-Identifier: Apache-2.0
"""Message types by name, messages from typed YAML, and messages as YAML in ROS's format."""

from __future__ import annotations

import importlib
import re
from collections.abc import Mapping
from typing import Any

import yaml

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.reading import parse_yaml

from ..logs.export import to_plain


def type_of(name: str, group: str) -> Any:
    """Class of ``package/group/Type``; the middle part may be left out.

    Args:
        name: Name on the command line.
        group: ``msg``, ``srv`` or ``action``.

    Raises:
        NameUnknownError: No such type is installed.
    """
    match = re.fullmatch(rf"(\w+)/(?:{group}/)?(\w+)", name)
    if match is None:
        raise NameUnknownError(f"{group} type", name, [])
    try:
        return getattr(importlib.import_module(f"{match[1]}.{group}"), match[2])
    except (ImportError, AttributeError):
        raise NameUnknownError(f"installed {group} type", name, []) from None


def filled(cls: Any, text: str) -> Any:
    """Message with fields set from a YAML text.

    Args:
        cls: Class of the message, goal or request.
        text: YAML mapping of fields, such as ``{twist: {linear: {x: 0.1}}}``.

    Raises:
        ParameterError: The text is no mapping, or a value does not match its field.
        NameUnknownError: There is no such field.
    """
    values = parse_yaml(text, "the message")
    message = cls()
    _fill(message, {} if values is None else values, "the message")
    return message


def _fill(message: Any, values: Any, where: str) -> None:
    if not isinstance(values, Mapping):
        raise ParameterError(f"{where} must be a mapping of fields, such as '{{data: 1.0}}'")
    types = message.get_fields_and_field_types()
    message._check_fields = True  # else sending a wrong type would crash the process
    for name, value in values.items():
        if name not in types:
            raise NameUnknownError(f"field of {where}", str(name), types)
        try:
            setattr(message, name, _value(getattr(message, name), types[name], value, str(name)))
        except (AssertionError, TypeError, ValueError) as error:
            if isinstance(error, ParameterError):
                raise
            raise ParameterError(f"{name} is of type {types[name]}, got {value!r}") from None


def _value(current: Any, kind: str, value: Any, name: str) -> Any:
    if hasattr(current, "get_fields_and_field_types"):
        _fill(current, value, name)
        return current
    element = re.sub(r"^sequence<|[>,\[].*$", "", kind)
    if "/" in element and isinstance(value, list):
        values = []
        for item in value:
            values.append(type_of(element, "msg")())
            _fill(values[-1], item, name)
        return values
    if element in ("double", "float"):
        return [float(v) for v in value] if isinstance(value, list) else float(value)
    return value


def as_yaml(message: Any, indent: int = 0) -> str:
    """YAML text of a message, with indented lines."""
    text = yaml.safe_dump(to_plain(message), sort_keys=False, allow_unicode=True, width=10_000)
    return "".join(" " * indent + line for line in text.splitlines(keepends=True))
