# SPDX-License-Identifier: Apache-2.0
"""Node sets (YAML), and the ROS parameter file generated from an experiment."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.params import to_dict
from loco_control.reading import read_yaml, understood
from loco_control.ros.messages.joint_topics import TABLES  # imports ROS
from loco_learning.runs.experiment import Experiment

from .processes import NO_RESTART, Restart

_FOLDER = "node_sets"
_PARTS = ("robot", "sim", "effects", "seed", "tick", "gait", "learner", "stance",
          "trunk", "legs", "weights", "plant", "joints", "target", "network", "loop",
          "faults", "hardware")  # fmt: skip


@dataclass(frozen=True)
class NodeSpec:
    """One node of a set: its name, its class and the experiment parts it needs."""

    name: str
    cls: str  # [FOLDER/]MODULE:CLASS
    parameters: tuple[str, ...]
    executable: str  # for ``ros2 run``, in the package of the class
    restart: Restart = NO_RESTART  # restart policy


FAULTS = NodeSpec("faults", "loco_control.ros.fault_node:FaultNode", ("faults",), "faults")
# Replaces the plant.
DRIVER = NodeSpec(
    "robot_sim", "loco_sim.ros.driver_node:DriverNode", ("plant", "tick", "hardware"), "driver"
)


def load(name: str) -> list[NodeSpec]:
    """Node set by name or path.

    Raises:
        NameUnknownError: There is no such set, or it names a part that experiments do not have.
        ParameterError: The file is not a node set.
    """
    return _read(name)[1]


def table_of(name: str) -> str:
    """Key in `joint_topics.TABLES` of the topic table of a node set (name or path)."""
    return _read(name)[0]


@understood("whole node set")
def _read(name: str) -> tuple[str, list[NodeSpec]]:
    path = Path(name)
    if path.suffix != ".yaml":
        folder = resources.files("loco_bringup") / _FOLDER
        path = Path(str(folder / f"{name}.yaml"))
        if not path.is_file():
            names = [p.stem for p in Path(str(folder)).glob("*.yaml")]
            raise NameUnknownError("node set", name, names)
    try:
        content = read_yaml(path, "node set")
        rows, table = content["nodes"], content.get("table", "hyq")
        specs = [
            NodeSpec(
                r["name"],
                _class(r["class"], path.parent),
                tuple(r.get("parameters", ())),
                r.get("executable", r["name"]),
                _restart(r["name"], r.get("restart", "never"), r.get("restarts_per_minute")),
            )
            for r in rows
        ]
    except (TypeError, LookupError, AttributeError) as error:
        raise ParameterError(
            f"{path} is not a node set (nodes: [name, class, parameters]): {error}"
        ) from None
    for part in (part for spec in specs for part in spec.parameters):
        if part not in _PARTS:
            raise NameUnknownError("experiment part", part, _PARTS)
    if table not in TABLES:
        raise NameUnknownError("topic table", str(table), TABLES)
    return table, specs


def _class(name: str, folder: Path) -> str:
    """MODULE:CLASS of a node, prefixed with the folder of the node set if it has the module."""
    top = name.partition(":")[0].partition(".")[0]
    is_local = (folder / f"{top}.py").is_file() or (folder / top / "__init__.py").is_file()
    return f"{folder.resolve()}/{name}" if is_local else name


def _restart(node: str, policy: Any, per_minute: Any) -> Restart:
    """Restart policy of a node: ``never``, or ``on_failure`` with a limit per minute (3)."""
    if policy not in ("never", "on_failure"):
        raise ParameterError(f"restart of {node} must be never or on_failure, got {policy!r}")
    if policy == "never":
        return NO_RESTART
    per_minute = 3 if per_minute is None else per_minute
    if type(per_minute) is not int or not 1 <= per_minute <= 60:
        raise ParameterError(
            f"restarts_per_minute of {node} must be a whole number in [1, 60], got {per_minute!r}"
        )
    return Restart(per_minute)


def grouped(specs: list[NodeSpec], layout: str) -> dict[str, list[NodeSpec]]:
    """Nodes of each process of a layout, by its name."""
    return {"nodes": specs} if layout == "composed" else {spec.name: [spec] for spec in specs}


def parameter_file(
    specs: list[NodeSpec],
    experiment: Experiment,
    tick: dict[str, Any],
    run: dict[str, Any],
) -> dict[str, Any]:
    """Content of the ROS parameter YAML for a run.

    Args:
        specs: The node set.
        experiment: Checked experiment.
        tick: Clock, speed, duration … of `TickParams`.
        run: `recorded` for every node, `recorder` (parameters of the recorder, none if it
            has its own file), `weights` (file that the reflex network writes), `faulted`
            (topics that the node `faults` damages, if any), `faults` (parameters of that node),
            `realtime` (changes of `RealtimeParams`, if any) and `hardware` (wiring file).
    """
    content: dict[str, Any] = {}
    for spec in specs:
        parameters: dict[str, Any] = {
            "recorded": run["recorded"],
            "control_rate": experiment.control_rate,
        }
        if run.get("faulted"):
            parameters["allow_faults"] = True
        if run.get("faulted") and spec != FAULTS:
            parameters["faulted"] = list(run["faulted"])  # a copy: the YAML gets no aliases
        if run.get("realtime"):
            parameters["realtime"] = dict(run["realtime"])
        for part in spec.parameters:
            parameters.update(_part(part, experiment, tick, run))
        content[f"/**/{spec.name}"] = {"ros__parameters": parameters}
    if run.get("recorder"):
        content |= recorder_parameters(run["recorder"])
    return content


def recorder_parameters(values: dict[str, Any]) -> dict[str, Any]:
    """Content of a ROS parameter YAML for the recorder."""
    return {"/**/recorder": {"ros__parameters": {"recorded": True, **values}}}


def _part(part: str, experiment: Any, tick: dict[str, Any], run: dict[str, Any]) -> dict:
    """ROS parameters of a part of an experiment."""
    if part == "tick":
        return tick
    if part == "faults":
        return run["faults"]
    if part == "hardware":
        return {"hardware": run["hardware"]}
    if part == "weights":
        return {"save_weights": run["weights"]}
    needed = {"plant": "target", "joints": "target", "robot": "gait", "legs": "gait"}
    if getattr(experiment, needed.get(part, part), None) is None:
        raise ParameterError(
            f"the node set wants {part!r}, which experiment {experiment.name} has not; "
            f"its node set is {experiment.node_set}"
        )
    if part == "plant":
        keys = ("overrides", "effects", "sim")
        return {"robot": experiment.robot, **{k: json.dumps(getattr(experiment, k)) for k in keys}}
    if part == "joints":
        joints = experiment.plant.joints
        driven = [joints[i] for i in experiment.plant.driven]
        return {"joints": list(joints), "driven": driven or [""]}  # ROS has no empty lists
    if part == "robot":
        overrides = json.dumps(experiment.overrides)
        feet = list(experiment.gait.origin)
        return {"robot": experiment.robot, "overrides": overrides, "standing_feet": feet}
    if part == "legs":
        return {"legs": experiment.plant.legs.ravel().tolist()}
    if part == "seed":
        return {"seed": experiment.seed}
    value = experiment.sim_params if part == "sim" else getattr(experiment, part)
    if part == "effects":
        return {"effects": json.dumps([dict(e) for e in value])}
    return {part: _ros(to_dict(value))}


def _ros(values: dict[str, Any]) -> dict[str, Any]:
    """Parameter values for ROS: non-numeric lists become JSON text, as `declare` expects."""
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
