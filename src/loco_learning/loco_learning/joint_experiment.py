# SPDX-License-Identifier: Apache-2.0
"""Experiments whose robot is any URDF: oscillators on the driven joints, a learner on top.

``kind: joint`` in an experiment YAML selects this class; `experiment.load` reads both kinds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar

from loco_control.exceptions import ParameterError
from loco_control.oscillators import Cpg, CpgParams
from loco_control.params import Params, from_dict, parameter, to_dict
from loco_sim import effects as sim_effects
from loco_sim import model as models
from loco_sim import robot as robots
from loco_sim.params import SimParams
from loco_sim.robot import Robot

from .joint_reflex import JointLearnerParams
from .params import CriterionParams


def _free(kind: type, doc: str) -> Any:
    """Field whose content another package checks."""
    return field(default_factory=kind, metadata={"doc": doc, "unit": "-"})


@dataclass(frozen=True)
class JointExperiment(Params):
    """Everything that decides a run of a robot given by joints and drives.

    What `robot` leaves open is settled when the object is made, so that a saved
    experiment stands for itself: a ``model.yaml`` dissolves into the robot it names,
    its overrides and its effects (those of the experiment come after), and a
    `control_rate` of 0 becomes the robot's.
    """

    node_set: ClassVar[str] = "joint"

    kind: str = parameter("joint", "which class of experiments", choices=("joint",))
    name: str = parameter("unnamed", "name in logs and reports")
    description: str = parameter("", "what it shows, for people")
    robot: str = parameter("tigrillo", "name of a robot, or path of a robot.yaml or model.yaml")
    seed: int = parameter(0, "seed of learner and effects", "-", 0, 2**31 - 1)
    control_rate: float = parameter(0.0, "ticks per second; 0: the robot's", "Hz", 0.0, 1e4)
    duration: float = parameter(0.0, "simulated time; 0: all phases of the learner", "s", 0.0, 1e6)
    target: CpgParams = parameter(CpgParams(), "oscillators of the driven joints")
    learner: JointLearnerParams = parameter(JointLearnerParams(), "network that closes the loop")
    sim: dict[str, Any] = _free(dict, "parameters of the plant that differ from the robot's")
    effects: tuple[dict[str, Any], ...] = _free(
        tuple, "effects of the plant, in order: a list of {name, parameters...}"
    )
    overrides: dict[str, Any] = _free(
        dict, "values of robot.yaml by dotted name, e.g. springs.l?_kfe_joint.stiffness: 440.6"
    )
    criterion: CriterionParams = parameter(CriterionParams(), "when a trial has failed")

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("sim", "overrides"):
            if not isinstance(getattr(self, key), (Mapping, type(None))):
                raise ParameterError(f"{key} must be a mapping, got {getattr(self, key)!r}")
        if not isinstance(self.effects, (list, tuple, type(None))):
            raise ParameterError(f"effects must be a list of mappings, got {self.effects!r}")
        model = self._merged_model()
        self._set(robot=model.robot, overrides=model.overrides, effects=tuple(model.effects))
        self._set(sim=dict(self.sim or {}))
        self._set(control_rate=self.control_rate or float(self.plant.control_rate))
        sim_effects.from_list(self.effects)  # raises where a name or value is wrong
        self.sim_params  # noqa: B018 (the same)
        self.make_target()

    def _merged_model(self) -> models.Model:
        """The model that `robot` names, with overrides and effects of the experiment on top."""
        # A plain name is not looked into here: `plant` reads the robot, once.
        plain = self.robot in robots.names()
        base = models.Model(self.robot) if plain else models.load_any(self.robot)
        return models.Model(
            base.robot,
            {**flat(base.overrides), **flat(self.overrides or {})},
            [*base.effects, *(self.effects or ())],
        )

    def _set(self, **values: Any) -> None:
        for key, value in values.items():
            object.__setattr__(self, key, value)

    @cached_property
    def plant(self) -> Robot:
        """The robot, overrides included."""
        return models.Model(self.robot, self.overrides, []).make_robot()

    @cached_property
    def sim_params(self) -> SimParams:
        """Parameters of the plant: the robot's with `sim` on top."""
        return from_dict(SimParams, {**to_dict(self.plant.sim), **self.sim}, "sim")

    def make_target(self) -> Cpg:
        """New target generator for the driven joints of the robot."""
        return Cpg(self.target, len(self.plant.driven), self.dt)

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return 1.0 / self.control_rate

    @property
    def ticks(self) -> int:
        """Control periods from start to end."""
        return round((self.duration or self.learner.duration) * self.control_rate)


def from_values(values: Mapping[str, Any], where: str = "") -> JointExperiment:
    """Experiment from nested plain values (what `to_dict` makes).

    `target` may be the name or path of a gait, or have one as its key ``gait`` beside
    values that differ from it.
    """
    values = dict(values)
    target = values.get("target")
    if isinstance(target, str):
        target = {"gait": target}
    if isinstance(target, Mapping) and "gait" in target:
        from .gait_file import load  # reads experiments itself

        changes = {key: value for key, value in target.items() if key != "gait"}
        values["target"] = {**to_dict(load(str(target["gait"])).target), **changes}
    return from_dict(JointExperiment, values, where)


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings as one of dotted names: ``{a: {b: 1}}`` is ``{"a.b": 1}``."""
    out: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            out |= flat(value, f"{prefix}{key}.")
        else:
            out[f"{prefix}{key}"] = value
    return out
