# SPDX-License-Identifier: Apache-2.0
"""Node sets (YAML) and the ROS parameter file that an experiment becomes."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import to_dict
from loco_learning.experiment import Experiment

_FOLDER = "node_sets"
_PARTS = ("robot", "sim", "impedance", "effects", "seed", "tick", "gait", "learner", "stance",
          "trunk", "weights")  # fmt: skip


@dataclass(frozen=True)
class NodeSpec:
    """One node of a set: its name, its class and the experiment parts it needs."""

    name: str
    cls: str
    parameters: tuple[str, ...]


def load(name: str) -> list[NodeSpec]:
    """Node set by name or path.

    Raises:
        NameUnknownError: No such set, or a part that experiments do not have.
        ParameterError: The file is not a node set.
    """
    path = Path(name)
    if path.suffix != ".yaml":
        folder = resources.files("loco_bringup") / _FOLDER
        path = Path(str(folder / f"{name}.yaml"))
        if not path.is_file():
            known = [p.stem for p in Path(str(folder)).glob("*.yaml")]
            raise NameUnknownError("node set", name, known)
    try:
        rows = yaml.safe_load(path.read_text())["nodes"]
        specs = [NodeSpec(r["name"], r["class"], tuple(r.get("parameters", ()))) for r in rows]
    except (OSError, yaml.YAMLError, TypeError, KeyError) as error:
        raise ParameterError(
            f"{path} is not a node set (nodes: [name, class, parameters]): {error}"
        ) from None
    for part in (part for spec in specs for part in spec.parameters):
        if part not in _PARTS:
            raise NameUnknownError("experiment part", part, _PARTS)
    return specs


def parameter_file(
    specs: list[NodeSpec], experiment: Experiment, tick: dict[str, Any], run: dict[str, Any]
) -> dict[str, Any]:
    """Content of the ROS parameter YAML for a run.

    Args:
        specs: The node set.
        experiment: Checked experiment.
        tick: Clock, speed, duration … of `TickParams`.
        run: `recorded` for every node, `recorder` (parameters of the recorder) and
            `weights` (file that the reflex network writes).
    """
    content: dict[str, Any] = {}
    for spec in specs:
        parameters: dict[str, Any] = {
            "recorded": run["recorded"],
            "control_rate": experiment.control_rate,
        }
        for part in spec.parameters:
            parameters.update(_part(part, experiment, tick, run))
        content[f"/**/{spec.name}"] = {"ros__parameters": parameters}
    content["/**/recorder"] = {"ros__parameters": {"recorded": True, **run["recorder"]}}
    return content


def _part(part: str, experiment: Experiment, tick: dict[str, Any], run: dict[str, Any]) -> dict:
    if part == "tick":
        return tick
    if part == "robot":
        return {"robot": experiment.robot, "standing_feet": list(experiment.gait.origin)}
    if part == "seed":
        return {"seed": experiment.seed}
    if part == "weights":
        return {"save_weights": run["weights"]}
    value = getattr(experiment, part)
    if part == "effects":
        return {"effects": json.dumps([dict(e) for e in value])}
    return {part: _ros(to_dict(value))}


def _ros(values: dict[str, Any]) -> dict[str, Any]:
    """Lists that are not numbers travel as JSON text, as `declare` expects them."""
    out: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, dict):
            out[key] = _ros(value)
        elif isinstance(value, (list, tuple)):
            numbers = value and all(isinstance(v, float) for v in value)
            out[key] = list(value) if numbers else json.dumps(list(value))
        elif value is not None:
            out[key] = value
    return out
