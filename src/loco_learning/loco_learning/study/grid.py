# SPDX-License-Identifier: Apache-2.0
"""Axes of a study's grid, and settings of its maps.

axes:
  learner.memory: [20, 50, 80]                   # a parameter by its dotted name
  kp: {logspace: [0, 4, 60], unit: N·m/rad,      # powers of ten, both ends included
       sets: [overrides.drives.*_hfe_joint.kp, overrides.drives.*_kfe_joint.kp]}
  M: {linspace: [10, 90, 5], whole: true, sets: [learner.memory]}
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.reading import shown

SPACINGS = {"linspace": np.linspace, "logspace": np.logspace}
AXIS_KEYS = ("values", *SPACINGS, "whole", "sets", "unit")
MAP_KEYS = ("x", "y", "metrics", "legal", "iso_damping", "regions")
MOST_POINTS = 10_000  # largest number of points on an axis
MOST_CASES = 1_000_000


@dataclass(frozen=True)
class Axis:
    """One axis of a grid: its values, and the parameters that are set to them."""

    name: str
    values: tuple[Any, ...]
    sets: tuple[str, ...]  # dotted names of the parameters
    unit: str = ""
    spacing: tuple[str, float, float, bool] | None = None  # key of `SPACINGS`, ends, whole numbers

    @property
    def label(self) -> str:
        """Name with the unit in brackets."""
        return f"{self.name} [{self.unit or '-'}]"

    def with_points(self, count: int) -> Axis:
        """Copy with another number of points in the same range; a list of values is unchanged.

        Raises:
            ParameterError: Fewer than 1 or more than 10,000 points.
        """
        if self.spacing is None:
            return self
        return replace(self, values=_spaced(self.name, *self.spacing, count))

    @property
    def logarithmic(self) -> bool:
        """True if its values are logarithmically spaced."""
        return self.spacing is not None and self.spacing[0] == "logspace"


@dataclass(frozen=True)
class MapSpec:
    """Axes, metrics and lines of the maps of a grid."""

    x: str
    y: str
    metrics: tuple[str, ...]
    legal: dict[str, tuple[float, float]]  # permitted range by metric
    iso_damping: tuple[float, ...] = ()  # kappa of the lines y = kappa sqrt(x)
    regions: dict[str, dict[str, dict[str, tuple[float, float]]]] = field(default_factory=dict)


def read_axes(values: Any, where: str) -> tuple[Axis, ...]:
    """Axes from the key ``axes`` of a study.

    Raises:
        ParameterError: There is no mapping, or an axis has no values or invalid ones.
        NameUnknownError: An axis has an unknown key.
    """
    if not isinstance(values, Mapping):
        raise ParameterError(f"{where}.axes must be a mapping of axes, got {shown(values)}")
    axes = tuple(_axis(str(name), spec, f"{where}.axes.{name}") for name, spec in values.items())
    if math.prod(len(axis.values) for axis in axes) > MOST_CASES:
        raise ParameterError(f"{where}.axes make more than {MOST_CASES:,} points; take fewer")
    return axes


def _axis(name: str, spec: Any, where: str) -> Axis:
    spec = spec if isinstance(spec, Mapping) else {"values": spec}
    for key in spec:
        if key not in AXIS_KEYS:
            raise NameUnknownError(f"key in {where}", str(key), AXIS_KEYS)
    keys = [key for key in ("values", *SPACINGS) if key in spec]
    values = spec[keys[0]] if len(keys) == 1 else None
    if not isinstance(values, (list, tuple)) or not values:
        raise ParameterError(
            f"{where} has no values: give a list, {{linspace: [first, last, points]}} or "
            f"{{logspace: [first exponent, last exponent, points]}}, got {shown(dict(spec))}"
        )
    spacing, sets = None, spec.get("sets", [name])
    if not isinstance(sets, (list, tuple)) or not all(isinstance(s, str) for s in sets):
        raise ParameterError(f"{where}.sets must be a list of parameters, got {shown(sets)}")
    if keys[0] in SPACINGS:
        numbers = len(values) == 3 and all(type(v) in (int, float) for v in values)
        if not numbers or type(values[2]) is not int:
            raise ParameterError(
                f"{where}.{keys[0]} must be [first, last, points], got {shown(values)}"
            )
        spacing = keys[0], float(values[0]), float(values[1]), bool(spec.get("whole", False))
        values = _spaced(where, *spacing, values[2])
    for value in values:
        if not isinstance(value, (int, float, str)):
            raise ParameterError(
                f"{where} must have numbers or texts, got {shown(value)}; an entry of a list is "
                f"set by its number: sets: [{sets[0] if sets else name}.0]"
            )
    return Axis(name, tuple(values), tuple(sets), str(spec.get("unit", "")), spacing)


def _spaced(
    where: str, kind: str, first: float, last: float, integer: bool, count: int
) -> tuple[float, ...]:
    if not 1 <= count <= MOST_POINTS:
        raise ParameterError(f"{where} needs 1 to {MOST_POINTS:,} points, got {count}")
    values = (float(v) for v in SPACINGS[kind](first, last, count))
    return tuple(dict.fromkeys(map(round, values))) if integer else tuple(values)


def points(axes: tuple[Axis, ...]) -> Iterator[tuple[int, ...]]:
    """Indices of the points of a grid, last axis fastest; one empty point without axes."""
    return itertools.product(*(range(len(axis.values)) for axis in axes))


def settings(axes: tuple[Axis, ...], point: tuple[int, ...]) -> dict[str, Any]:
    """Parameters of a point by dotted name."""
    pairs = zip(axes, point, strict=True)
    return {name: axis.values[i] for axis, i in pairs for name in axis.sets}


def read_map(values: Any, axes: tuple[Axis, ...], where: str, quantities: Any) -> MapSpec | None:
    """Settings from the key ``map`` of a study; by default a map of the first two axes, if any.

    Args:
        values: Value of the key, None if it is absent.
        axes: Axes of the grid.
        where: Name of the study.
        quantities: Names of metrics.

    Raises:
        ParameterError: It is not a mapping, a range is not two numbers, or there are no two axes.
        NameUnknownError: A key, an axis or a metric is unknown.
    """
    names = [axis.name for axis in axes]
    if len(axes) < 2:
        if values is not None:
            raise ParameterError(f"{where}.map needs a grid of two axes or more")
        return None
    values = {} if values is None else values
    if not isinstance(values, Mapping):
        raise ParameterError(f"{where}.map must be a mapping, got {shown(values)}")
    for key in values:
        if key not in MAP_KEYS:
            raise NameUnknownError(f"key in {where}.map", str(key), MAP_KEYS)
    x, y = (str(values.get(key, name)) for key, name in zip(("x", "y"), names, strict=False))
    for name in (x, y):
        if name not in names:
            raise NameUnknownError(f"axis of {where}", name, names)
    legal = ranges(values.get("legal", {}), f"{where}.map.legal")
    metrics = tuple(values.get("metrics", legal or ("survived",)))
    for name in (*metrics, *legal):
        if name not in quantities and name != "survived":
            raise NameUnknownError("metric", str(name), quantities)
    regions = {
        str(name): {part: ranges(dict(rule).get(part, {}), f"{where}.map.regions.{name}.{part}")
                    for part in ("where", "what")}
        for name, rule in dict(values.get("regions", {})).items()
    }  # fmt: skip
    damping = tuple(float(v) for v in values.get("iso_damping", ()))
    return MapSpec(x, y, metrics, legal, damping, regions)


def ranges(values: Any, where: str) -> dict[str, tuple[float, float]]:
    """Ranges by name; null means no limit.

    Raises:
        ParameterError: A range is not two numbers.
    """
    if not isinstance(values, Mapping):
        raise ParameterError(f"{where} must be a mapping of ranges, got {shown(values)}")
    intervals = {}
    for name, pair in values.items():
        limits = pair if isinstance(pair, (list, tuple)) else ()
        if len(limits) != 2 or not all(v is None or type(v) in (int, float) for v in limits):
            raise ParameterError(f"{where}.{name} must be [low, high], got {shown(pair)}")
        low, high = limits
        intervals[str(name)] = (
            -math.inf if low is None else float(low), math.inf if high is None else float(high),
        )  # fmt: skip
    return intervals
