# SPDX-License-Identifier: Apache-2.0
"""Declaration of ROS parameters from the dataclasses of each ``params.py``.

Type, description and range of a ROS parameter are those of the dataclass
field, so ``ros2 param describe`` and loco's error messages agree.
"""

from __future__ import annotations

import dataclasses
import json
from typing import Any, TypeVar

import numpy as np
import rclpy
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from ..exceptions import LocoError, ParameterError
from ..legs.geometry import HYQ
from ..params import Params

T = TypeVar("T", bound=Params)


def declare(node: Node, defaults: T, prefix: str = "", live: frozenset[str] = frozenset()) -> T:
    """Declare each field of `defaults` as a parameter and return the values that were set.

    Args:
        node: Node on which the parameters are declared.
        defaults: Values for parameters that neither the command line nor the YAML sets.
        prefix: Prefix of every name, e.g. ``"gait."``.
        live: Full names that may change while the node runs; all others are read-only.

    Raises:
        ParameterError: A value that was set has the wrong type or is out of range.
    """
    values = {}
    for f in dataclasses.fields(defaults):
        name, value = prefix + f.name, getattr(defaults, f.name)
        if dataclasses.is_dataclass(value):
            values[f.name] = declare(node, value, name + ".", live)
            continue
        values[f.name] = _declare_one(node, name, value, f.metadata, name not in live)
    return dataclasses.replace(defaults, **values)


def declare_legs(node: Node) -> np.ndarray:
    """Geometry of the robot's legs from the parameter ``legs``, (4, 16); HyQ's by default.

    Raises:
        ParameterError: The parameter has a wrong number of values.
    """
    text = "geometry of the legs, by rows: a row per leg, columns as in legs.geometry"
    descriptor = ParameterDescriptor(description=text, read_only=True)
    values = node.declare_parameter("legs", HYQ.ravel().tolist(), descriptor).value
    if len(values) != HYQ.size:
        raise ParameterError(f"parameter legs needs {HYQ.size} numbers, got {len(values)}")
    return np.array(values, dtype=float).reshape(HYQ.shape)


def _declare_one(node: Node, name: str, value: Any, meta: Any, read_only: bool) -> Any:
    # Lists of mappings (schedules) have no ROS type: they are passed as JSON text.
    as_text = not isinstance(value, (bool, int, float, str)) and not _is_numbers(value)
    default = json.dumps(value) if as_text else value
    if isinstance(default, tuple):
        default = [float(v) for v in default]
    try:
        got = node.declare_parameter(name, default, _descriptor(name, value, meta, read_only)).value
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        raise ParameterError(f"parameter {name} [{meta.get('unit', '-')}]: {error}") from None
    if as_text:
        return _from_json(name, got)
    return tuple(got) if isinstance(value, tuple) else got


def _descriptor(name: str, value: Any, meta: Any, read_only: bool) -> ParameterDescriptor:
    text = f"{meta.get('doc', name)} [{meta.get('unit', '-')}]"
    if meta.get("choices"):
        text += f"; one of {', '.join(meta['choices'])}"
    descriptor = ParameterDescriptor(description=text, read_only=read_only)
    low, high = meta.get("low"), meta.get("high")
    if type(value) is float and low is not None and high is not None:
        span = FloatingPointRange(from_value=float(low), to_value=float(high))
        descriptor.floating_point_range = [span]
    return descriptor


def seal(node: Node) -> set[str]:
    """Make all declared parameters read-only, except those whose names are added to the result.

    To be called when the node is created. It also protects ``use_sim_time``, with which the node's
    timers would follow a clock published by other nodes.
    """
    live: set[str] = set()

    def changed(parameters: list[Parameter]) -> SetParametersResult:
        declared = [p.name for p in parameters if node.has_parameter(p.name)]
        fixed = [name for name in declared if name not in live]
        text = f"{', '.join(fixed)} cannot change while the node runs"
        return SetParametersResult(successful=not fixed, reason=text if fixed else "")

    node.add_on_set_parameters_callback(changed)
    return live


def sealed_node(name: str, **options: Any) -> Node:
    """A node from `rclpy.create_node`, with its options, whose parameters are read-only."""
    node = rclpy.create_node(name, **options)
    seal(node)
    return node


def on_change(node: Any, apply: dict[str, Any]) -> None:
    """Call ``apply[name](value)`` when a live parameter is set; a LocoError refuses it.

    Args:
        node: A `LocoNode`.
        apply: Functions by full name of the parameter.
    """
    node.changeable.update(apply)

    def changed(parameters: list[Parameter]) -> SetParametersResult:
        for p in parameters:
            try:
                if p.name in apply:
                    apply[p.name](p.value)
            except LocoError as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(changed)


def _is_numbers(value: Any) -> bool:
    return (
        isinstance(value, tuple)
        and bool(value)
        and all(isinstance(v, (int, float)) and not isinstance(v, bool) for v in value)
    )


def _from_json(name: str, text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise ParameterError(f"parameter {name} must be JSON text, got {text!r}: {error}") from None
