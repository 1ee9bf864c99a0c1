# SPDX-License-Identifier: Apache-2.0
"""Experiment: one YAML file with all settings of a run, checked before it starts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.gait.generator import GaitParams
from loco_control.gait.oscillators import Cpg, CpgParams
from loco_control.params import Params, from_dict, parameter, to_dict
from loco_control.reading import understood
from loco_control.stance.controller import StanceParams
from loco_control.stance.trunk import TrunkParams
from loco_sim import effects as sim_effects
from loco_sim.params import SimParams
from loco_sim.plant import model as models
from loco_sim.robot import robot as robots
from loco_sim.robot.robot import Robot

from ..params import OUTPUT_JOINTS, CriterionParams, JointLearnerParams, LearnerParams
from ..plain import Collection, flat
from . import gait_file, quadruped

if TYPE_CHECKING:
    from .network_experiment import NetworkExperiment

WALKING = {"gait": GaitParams, "trunk": TrunkParams, "stance": StanceParams}
BLOCKS = {**WALKING, "target": CpgParams}
EXPERIMENT_TYPES = ("hyq", "joint", "msd")  # kinds of experiments in earlier versions
NETWORK = ("network", "preset", "loop")  # keys of mass-spring-damper networks only
FILES = Collection(
    "experiment", "experiments", hint="; `loco list experiments` shows those by name"
)
names = FILES.names


def _free(kind: type, doc: str) -> Any:
    """Field whose content is checked by another package."""
    return field(default_factory=kind, metadata={"doc": doc, "unit": "-"})


def _block(doc: str) -> Any:
    """Field of optional parameters."""
    return field(default=None, metadata={"doc": doc, "unit": "-", "optional": True})


@dataclass(frozen=True)
class Experiment(Params):
    """Everything that decides a run; two runs of equal experiments are equal bit by bit.

    A robot with legs walks by a `gait`, with a trunk controller and a stance estimator; any
    robot can follow oscillators, its `target`. An experiment has one of the two, by default the
    gait if the robot has legs. Open settings are filled in on construction, so that a
    saved experiment is self-contained: a ``model.yaml`` is replaced by its robot,
    overrides and effects (those of the experiment come after), a `control_rate` of 0
    by the robot's, and the physics engine is named.
    """

    name: str = parameter("unnamed", "name in logs and reports")
    description: str = parameter("", "purpose of the experiment, free text")
    robot: str = parameter("hyq", "name of a robot, or path of a robot.yaml or model.yaml")
    seed: int = parameter(0, "seed of learner and effects", "-", 0, 2**31 - 1)
    control_rate: float = parameter(0.0, "ticks per second; 0: value of the robot", "Hz", 0.0, 1e4)
    duration: float = parameter(0.0, "simulated time; 0: all phases of the learner", "s", 0.0, 1e6)
    gait: GaitParams | None = _block("gait of a robot with legs")
    trunk: TrunkParams | None = _block("trunk controller, with a gait")
    stance: StanceParams | None = _block("stance estimator, with a gait")
    target: CpgParams | None = _block("oscillators of the driven joints, without a gait")
    learner: LearnerParams | JointLearnerParams | None = _block("reflex network")
    sim: dict[str, Any] = _free(dict, "parameters of the plant that replace those of the robot")
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
        sim_effects.from_list(self.effects)  # raises if a name or value is invalid
        self._set(sim={**self.sim, "engine": self.sim_params.engine})  # likewise
        self._settle()

    def _merged_model(self) -> models.Model:
        """The model named by `robot`, with overrides and effects of the experiment added."""
        # A plain name is not loaded here: `plant` reads the robot, once.
        is_shipped = self.robot in robots.names()
        base = models.Model(self.robot) if is_shipped else models.load_any(self.robot)
        named = base.robot in robots.names()
        return models.Model(
            base.robot if named else str(Path(base.robot).resolve()),  # absolute, for moved bags
            {**flat(base.overrides), **flat(self.overrides or {})},
            [*base.effects, *(self.effects or ())],
        )

    def _settle(self) -> None:
        """Fill in the blocks for a gait or for oscillators, and reject a mixture."""
        walking = [key for key in WALKING if getattr(self, key) is not None]
        if self.target is not None and walking:
            raise ParameterError(
                f"an experiment has a target of oscillators, or a gait with trunk and stance, "
                f"not both; this one has target and {', '.join(walking)}"
            )
        if walking or (self.target is None and self.plant.legs is not None):
            for key, params in quadruped.defaults(self.plant).items():
                self._set(**{key: getattr(self, key) or params})
            duty, planned = self.gait.duty_factor, self.trunk.mpc.duty_factor
            if self.trunk.mapping == "mpc" and planned != duty:
                raise ParameterError(
                    f"trunk.mpc.duty_factor is {planned:g}, set it to that of the gait, {duty:g}"
                )
        else:
            self._set(target=self.target or CpgParams())
            self._set(learner=self.learner or JointLearnerParams())
            self.make_target()  # raises if a list has a wrong length
        params_class = LearnerParams if self.gait else JointLearnerParams
        if not isinstance(self.learner, params_class):
            raise ParameterError(f"learner must be {params_class.__name__}, got {self.learner!r}")

    def _set(self, **values: Any) -> None:
        for key, value in values.items():
            object.__setattr__(self, key, value)

    @property
    def node_set(self) -> str:
        """Set of nodes that runs the experiment."""
        return "hyq" if self.gait else "joint"

    @cached_property
    def plant(self) -> Robot:
        """The robot, with overrides."""
        return models.Model(self.robot, self.overrides, []).make_robot()

    @cached_property
    def sim_params(self) -> SimParams:
        """Parameters of the plant: the robot's, with the changes of `sim`."""
        return from_dict(SimParams, {**to_dict(self.plant.sim), **self.sim}, "sim")

    @property
    def draws(self) -> bool:
        """True if a run depends on the seed: by learning, noisy sensors or a random effect."""
        learns = self.learner.enabled and not self.learner.weights
        has_noise = self.plant.sensors is not None and not self.plant.sensors.exact
        effects = sim_effects.from_list(self.effects)
        return (
            learns or has_noise or any(effect.draws and not effect.absent() for effect in effects)
        )

    @property
    def outputs(self) -> np.ndarray:
        """Indices of the joints that the network moves, among the driven ones."""
        return OUTPUT_JOINTS if self.gait else np.arange(len(self.plant.driven))

    def make_target(self) -> Cpg:
        """New oscillators for the driven joints of the robot."""
        return Cpg(self.target, len(self.plant.driven), self.dt)

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return 1.0 / self.control_rate

    @property
    def ticks(self) -> int:
        """Control periods from start to end."""
        return round((self.duration or self.learner.duration) * self.control_rate)


@understood("whole experiment")
def load(
    name_or_path: str | Path, overrides: Mapping[str, Any] | None = None
) -> Experiment | NetworkExperiment:
    """Read an experiment, of class `NetworkExperiment` for a network of masses and springs.

    The path of a robot's YAML file, and of trained weights, is first taken relative to the
    experiment.

    Args:
        name_or_path: One of `names()`, or a path that ends in ``.yaml``.
        overrides: Values by dotted name, such as ``{"learner.memory": 50}``.

    Raises:
        NameUnknownError: The experiment, or a parameter, does not exist.
        MissingFileError: The file does not exist.
        ParameterError: Broken YAML, a wrong type or a value out of range.
    """
    path = FILES.find(name_or_path)
    values = FILES.read(path, _extended)
    for key, value in (overrides or {}).items():
        values = merge(values, _nested(key, value))
    values.setdefault("name", path.stem)
    adjacent = path.parent / str(values.get("robot", ""))
    if adjacent.suffix == ".yaml" and adjacent.is_file():
        values["robot"] = str(adjacent)
    learner = values.get("learner")
    weights = learner.get("weights") if isinstance(learner, Mapping) else None
    if isinstance(weights, str) and weights and (path.parent / weights).is_file():
        values = merge(values, {"learner": {"weights": str(path.parent / weights)}})
    return from_values(values, where=path.stem)


def from_values(values: Mapping[str, Any], where: str = "") -> Experiment | NetworkExperiment:
    """Experiment from nested plain values, the inverse of `to_dict`.

    `target` may be the name or path of a gait file, or contain one as its key ``gait`` beside
    changed values. Files and bags of earlier versions are supported: they have a key
    ``kind``, and HyQ's gains under ``impedance``.
    """
    values = {key: value for key, value in values.items() if value is not None}
    kind = values.pop("kind", None)
    if kind not in (None, *EXPERIMENT_TYPES):
        raise NameUnknownError("kind of experiment", str(kind), EXPERIMENT_TYPES)
    if kind == "msd" or is_network(values):
        from . import network_experiment  # loads SciPy

        return network_experiment.from_values(values, where)
    if values.get("impedance"):
        values["overrides"] = gains_as_overrides(values)
    values.pop("impedance", None)
    if "target" in values:
        values["target"] = _target(values["target"])
    follows = "target" in values or kind == "joint"
    walks = not (follows and values.keys().isdisjoint(WALKING))
    if walks:  # missing values are filled in for the robot's size
        sections = quadruped.defaults(_robot(values))
        values = merge({name: to_dict(params) for name, params in sections.items()}, values)
    learner = LearnerParams if walks else JointLearnerParams
    for key, params in {**BLOCKS, "learner": learner}.items():
        if key in values:
            values[key] = from_dict(params, values[key], f"{where}.{key}" if where else key)
    if not walks:
        values.setdefault("target", CpgParams())
    return from_dict(Experiment, values, where)


def is_network(values: Mapping[str, Any]) -> bool:
    """True if the values are those of a network of masses and springs."""
    return values.get("kind") == "msd" or not values.keys().isdisjoint(NETWORK)


def _robot(values: Mapping[str, Any]) -> Robot:
    """The robot of an experiment, with overrides."""
    model, overrides = models.load_any(values.get("robot", "hyq")), values.get("overrides") or {}
    if not isinstance(overrides, Mapping):
        raise ParameterError(f"overrides must be a mapping, got {overrides!r}")
    return models.Model(model.robot, {**flat(model.overrides), **flat(overrides)}).make_robot()


def _target(value: Any) -> Any:
    """Values of oscillators, with those of a gait file inserted."""
    if isinstance(value, str):
        value = {"gait": value}
    if not isinstance(value, Mapping) or "gait" not in value:
        return value
    changes = {key: each for key, each in value.items() if key != "gait"}
    return {**to_dict(gait_file.load(str(value["gait"])).target), **changes}


def gains_as_overrides(values: Mapping[str, Any]) -> dict[str, Any]:
    """Overrides of an experiment of HyQ with gains under the key ``impedance``.

    Experiments and bags of earlier versions have ``swing_kp``, ``swing_kd``, ``stance_kp`` and
    ``stance_kd`` there, each a list for hip abduction, hip flexion and knee of every leg.

    Raises:
        ParameterError: A value is not such a list.
        NameUnknownError: The block has another key.
    """
    names = {"swing_kp": "swing_kp", "swing_kd": "swing_kd", "stance_kp": "kp", "stance_kd": "kd"}
    gains, joints = values["impedance"], ("haa", "hfe", "kfe")
    if not isinstance(gains, Mapping):
        raise ParameterError(f"impedance must be a mapping, got {gains!r}")
    overrides = flat(values.get("overrides") or {})
    for key, row in gains.items():
        if key not in names:
            raise NameUnknownError("parameter in impedance", str(key), names)
        if not isinstance(row, (list, tuple)) or len(row) != len(joints):
            raise ParameterError(f"impedance.{key} must be a list of 3 numbers, got {row!r}")
        for joint, gain in zip(joints, row, strict=True):
            name = f"drives.*_{joint}_joint.{names[key]}"
            overrides.pop(name, None)  # the last entry has priority
            overrides[name] = gain
    return overrides


def override(
    experiment: Experiment | NetworkExperiment, overrides: Mapping[str, Any]
) -> Experiment | NetworkExperiment:
    """Copy of an experiment with some values changed, by dotted name."""
    values = to_dict(experiment)
    for key, value in overrides.items():
        values = merge(values, _nested(key, value))
    return from_values(values, where=experiment.name)


def merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Mapping `base` with the values of `change`; mappings are merged, others replaced.

    An entry of a list is named by its index: ``effects.0.delay`` belongs to the first effect.

    Raises:
        ParameterError: A list has no entry of that index.
    """
    merged = dict(base)
    for key, value in change.items():
        old = merged.get(key)
        if isinstance(value, Mapping) and isinstance(old, (list, tuple)):
            numbered = {str(i): entry for i, entry in enumerate(old)}
            if lost := sorted(set(value) - set(numbered)):
                raise ParameterError(
                    f"{key}.{lost[0]} names no entry: {key} has {len(old)}, numbered from 0"
                )
            value = list(merge(numbered, value).values())
        elif isinstance(value, Mapping) and isinstance(old, Mapping):
            value = merge(old, value)
        merged[key] = value
    return merged


def _extended(base: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Values of an experiment, merged with those of the one that it extends."""
    named = ("name", "description")
    return merge({key: each for key, each in base.items() if key not in named}, values)


def _nested(key: str, value: Any) -> dict[str, Any]:
    for part in reversed(key.split(".")):
        value = {part: value}
    return value
