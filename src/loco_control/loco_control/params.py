# SPDX-License-Identifier: Apache-2.0
"""One place per parameter: frozen dataclasses whose fields carry unit and range.

YAML overrides the defaults (`from_dict`); the ROS parameters
(`loco_control.ros.parameters`) and the tables in ``docs/`` are generated from
these classes, so nothing is listed twice.
"""

from __future__ import annotations

import dataclasses
import functools
import math
import typing
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from .exceptions import NameUnknownError, ParameterError
from .reading import shown

T = TypeVar("T", bound="Params")


def parameter(
    default: Any,
    doc: str,
    unit: str = "-",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] | None = None,
    any_length: bool = False,
) -> Any:
    """Field of a `Params` class with its meaning, unit and legal values.

    Args:
        default: Default value, of the type of the field, or a function that returns it.
        doc: Meaning of the parameter, for tables and ROS parameter descriptions.
        unit: SI unit, ``-`` when there is none.
        low: Smallest legal value (each element for tuples).
        high: Largest legal value (each element for tuples).
        choices: Legal values, for fields that are names.
        any_length: Whether a tuple may have any number of values from one, instead of as many as
            `default`.
    """
    meta = {"doc": doc, "unit": unit, "low": low, "high": high, "choices": choices}
    meta["any_length"] = any_length
    if dataclasses.is_dataclass(default):
        return field(default_factory=lambda: default, metadata=meta)
    if callable(default):
        return field(default_factory=default, metadata={**meta, "factory": default})
    return field(default=default, metadata=meta)


def limits(kind: type, name: str) -> tuple[float, float]:
    """Smallest and largest legal value of a field made by `parameter`; infinite if unbounded."""
    meta = kind.__dataclass_fields__[name].metadata
    low, high = meta.get("low"), meta.get("high")
    return -math.inf if low is None else low, math.inf if high is None else high


@dataclass(frozen=True)
class Params:
    """Base of every parameter class: checks type and range when constructed."""

    def __post_init__(self) -> None:
        for f in dataclasses.fields(self):
            value = getattr(self, f.name)
            object.__setattr__(self, f.name, _checked(type(self).__name__, f, value))

    def replace(self: T, **changes: Any) -> T:
        """Copy with some fields changed; the copy is checked again."""
        return dataclasses.replace(self, **changes)


# Cached, since reading annotations dominates the run time.
_field_types = functools.cache(typing.get_type_hints)


def from_dict(cls: type[T], values: dict[str, Any] | None, where: str = "") -> T:
    """Build nested parameters from plain values, refusing unknown keys.

    Args:
        cls: The `Params` class to build.
        values: Mapping as read from YAML; None means all defaults.
        where: Path of the mapping in the file, for messages.

    Raises:
        ParameterError: A value has the wrong type or is out of range.
        NameUnknownError: A key is not a field of `cls`.
    """
    if values is None:
        return cls()
    if not isinstance(values, dict):
        raise ParameterError(f"{where or cls.__name__} must be a mapping, got {values!r}")
    fields = {f.name: f for f in dataclasses.fields(cls)}
    types = _field_types(cls)
    arguments = {}
    for key, value in values.items():
        if key not in fields:
            raise NameUnknownError(f"parameter in {where or cls.__name__}", key, fields)
        path = f"{where}.{key}" if where else key
        kind = types[key]
        if dataclasses.is_dataclass(kind):
            arguments[key] = from_dict(kind, value, path)
        else:
            arguments[key] = _checked(where or cls.__name__, fields[key], value)
    return cls(**arguments)


def to_dict(params: Params) -> dict[str, Any]:
    """Nested plain values for YAML: tuples become lists, blocks that are None are omitted."""
    values = {}
    for f in dataclasses.fields(params):
        value = getattr(params, f.name)
        if value is None and f.metadata.get("optional"):
            continue
        if dataclasses.is_dataclass(value):
            values[f.name] = to_dict(value)
        else:
            values[f.name] = list(value) if isinstance(value, tuple) else value
    return values


def _checked(owner: str, f: dataclasses.Field, value: Any) -> Any:
    """Value of a field, converted to the type of its default; raises ParameterError if illegal."""
    factory = f.metadata.get("factory", lambda: None)
    default = f.default if f.default is not dataclasses.MISSING else factory()
    if value is default or default is None or dataclasses.is_dataclass(value):
        return value
    name = f"{owner}.{f.name}"
    if isinstance(default, tuple):
        many = f.metadata.get("any_length", False)
        listed = isinstance(value, (list, tuple, np.ndarray))
        if not listed or (many and not len(value)):
            size = "one or more" if many else len(default)
            raise ParameterError(f"{name} must be a list of {size} numbers, got {shown(value)}")
        if len(default) and len(value) != len(default) and not many:
            raise ParameterError(f"{name} must have {len(default)} values, got {len(value)}")
        kind = default[0] if default else 0.0
        return tuple(_scalar(f"{name}[{i}]", kind, v, f.metadata) for i, v in enumerate(value))
    return _scalar(name, default, value, f.metadata)


def _scalar(name: str, default: Any, value: Any, meta: Any) -> Any:
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise ParameterError(f"{name} must be true or false, got {shown(value)}")
        return value
    if isinstance(default, str):
        if not isinstance(value, str):
            raise ParameterError(f"{name} must be text, got {shown(value)}")
        choices = meta.get("choices")
        if choices and value not in choices:
            raise NameUnknownError(f"choice for {name}", value, choices)
        return value
    unit = meta.get("unit", "-")
    huge = isinstance(value, int) and abs(value) >= 10**300  # beyond the range of floating point
    if huge or isinstance(value, bool) or not isinstance(value, (int, float, np.number)):
        raise ParameterError(f"{name} must be a number [{unit}], got {shown(value)}")
    low, high = meta.get("low"), meta.get("high")
    too_low = low is not None and value < low
    too_high = high is not None and value > high
    # Infinity is legal only where it is the default, e.g. for "never".
    infinite = math.isinf(value) and not math.isinf(default)
    if math.isnan(value) or too_low or too_high or infinite:
        low = "-inf" if low is None else f"{low:g}"
        high = "inf" if high is None else f"{high:g}"
        finite = " and finite" if infinite else ""
        raise ParameterError(
            f"{name} must be in [{low}, {high}] {unit}{finite}, got {shown(value)}"
        )
    if isinstance(default, int):
        if value != int(value) or abs(value) >= 2**63:  # larger integers do not fit into arrays
            raise ParameterError(f"{name} must be a whole number below 2**63, got {shown(value)}")
        return int(value)
    return float(value)
