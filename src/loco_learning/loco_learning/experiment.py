# SPDX-License-Identifier: Apache-2.0
"""An experiment is one YAML file: everything a run depends on, checked before it starts."""

from __future__ import annotations

import importlib.resources
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import yaml

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.gait import GaitParams
from loco_control.impedance import ImpedanceParams
from loco_control.params import Params, from_dict, parameter, to_dict
from loco_control.stance import StanceParams
from loco_control.trunk import TrunkParams
from loco_sim import effects as sim_effects
from loco_sim.params import SimParams

from .params import CriterionParams, LearnerParams

if TYPE_CHECKING:
    from .joint_experiment import JointExperiment

ROBOTS = ("hyq",)
KINDS = ("hyq", "joint", "msd")  # of experiments: this class, `joint_…`, `msd_experiment`


@dataclass(frozen=True)
class Experiment(Params):
    """Everything that decides a run; two runs of equal experiments are equal bit by bit."""

    node_set: ClassVar[str] = "hyq"

    name: str = parameter("unnamed", "name in logs and reports")
    description: str = parameter("", "what it shows, for people")
    robot: str = parameter("hyq", "robot in the plant", choices=ROBOTS)
    seed: int = parameter(0, "seed of hidden weights and effects", "-", 0, 2**31 - 1)
    control_rate: float = parameter(250.0, "ticks per second", "Hz", 1.0, 1e4)
    duration: float = parameter(0.0, "simulated time; 0: all phases of the learner", "s", 0.0, 1e6)
    gait: GaitParams = parameter(GaitParams(), "target generator")
    impedance: ImpedanceParams = parameter(ImpedanceParams(), "joint impedance")
    trunk: TrunkParams = parameter(TrunkParams(), "trunk controller")
    stance: StanceParams = parameter(StanceParams(), "stance estimator")
    sim: SimParams = parameter(SimParams(), "plant")
    learner: LearnerParams = parameter(LearnerParams(), "reflex network")
    effects: tuple[dict[str, Any], ...] = parameter(
        (), "effects of the plant, in order: a list of {name, parameters...}"
    )
    criterion: CriterionParams = parameter(CriterionParams(), "when a trial has failed")

    def __post_init__(self) -> None:
        effects = self.effects
        if not isinstance(effects, (list, tuple)):
            raise ParameterError(f"effects must be a list of mappings, got {effects!r}")
        object.__setattr__(self, "effects", ())  # a list of mappings, not of numbers
        super().__post_init__()
        object.__setattr__(self, "effects", tuple(effects))
        sim_effects.from_list(effects)  # raises where a name or value is wrong

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return 1.0 / self.control_rate

    @property
    def ticks(self) -> int:
        """Control periods from start to end."""
        return round((self.duration or self.learner.duration) * self.control_rate)


def names() -> list[str]:
    """Names of the experiments that come with the package."""
    return sorted(path.name[:-5] for path in _folder().iterdir() if path.name.endswith(".yaml"))


def load(
    name_or_path: str | Path, overrides: Mapping[str, Any] | None = None
) -> Experiment | JointExperiment:
    """Read an experiment; ``kind: joint`` in it makes a `JointExperiment`.

    Args:
        name_or_path: One of `names()`, or a path that ends in ``.yaml``.
        overrides: Values by dotted name, such as ``{"learner.memory": 50}``.

    Raises:
        NameUnknownError: No such experiment, or a key that is no parameter.
        MissingFileError: No such file.
        ParameterError: Broken YAML, a wrong type or a value out of range.
    """
    path = _find(name_or_path, Path())
    values = _read(path, ())
    for key, value in (overrides or {}).items():
        values = merge(values, _nested(key, value))
    values.setdefault("name", path.stem)
    return from_values(values, where=path.stem)


def from_values(values: Mapping[str, Any], where: str = "") -> Experiment | JointExperiment:
    """Experiment from nested plain values (what `to_dict` makes)."""
    values = dict(values)
    kind = values.pop("kind", "hyq")
    if kind == "joint":
        from . import joint_experiment

        return joint_experiment.from_values(values, where)
    if kind == "msd":
        from . import msd_experiment

        return msd_experiment.from_values(values, where)
    if kind not in KINDS:
        raise NameUnknownError("kind of experiment", str(kind), KINDS)
    effects = values.pop("effects", None) or ()
    made = from_dict(Experiment, values, where)
    return made.replace(effects=effects) if effects else made


def override(
    experiment: Experiment | JointExperiment, overrides: Mapping[str, Any]
) -> Experiment | JointExperiment:
    """Copy of an experiment with some values changed, by dotted name."""
    values = to_dict(experiment)
    for key, value in overrides.items():
        values = merge(values, _nested(key, value))
    return from_values(values, where=experiment.name)


def merge(base: Mapping[str, Any], change: Mapping[str, Any]) -> dict[str, Any]:
    """Mapping `base` with `change` on top; mappings are merged, all else is replaced."""
    merged = dict(base)
    for key, value in change.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            value = merge(old, value)
        merged[key] = value
    return merged


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in a YAML file.

    Raises:
        MissingFileError: The file cannot be read.
        ParameterError: It is not YAML (with the line), or not a mapping.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise MissingFileError(f"cannot read {path}: {error}") from error
    try:
        values = yaml.load(text, Loader=_Loader)  # noqa: S506, a SafeLoader
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        raise ParameterError(f"{path}{line}: {getattr(error, 'problem', error)}") from error
    if not isinstance(values, dict):
        raise ParameterError(f"{path} must hold a mapping of parameters, got {values!r}")
    return values


def _read(path: Path, seen: tuple[Path, ...]) -> dict[str, Any]:
    """Values of a file on top of those it extends."""
    path = path.resolve()
    if path in seen:
        raise ParameterError(f"{path} extends itself: {' > '.join(p.stem for p in (*seen, path))}")
    values = read_yaml(path)
    base = values.pop("extends", None)
    if base is None:
        return values
    if not isinstance(base, str):
        raise ParameterError(f"{path}: extends must be the name of an experiment, got {base!r}")
    parent = _read(_find(base, path.parent), (*seen, path))
    for own in ("name", "description"):
        parent.pop(own, None)
    return merge(parent, values)


def _find(name_or_path: str | Path, folder: Path) -> Path:
    text = str(name_or_path)
    if text.endswith((".yaml", ".yml")):
        path = folder / text
        if not path.is_file():
            raise MissingFileError(f"no experiment file {path}")
        return path
    if text not in names():
        raise NameUnknownError("experiment", text, names())
    return Path(str(_folder() / f"{text}.yaml"))


def _folder() -> Any:
    return importlib.resources.files("loco_learning") / "experiments"


def _nested(key: str, value: Any) -> dict[str, Any]:
    for part in reversed(key.split(".")):
        value = {part: value}
    return value


class _Loader(yaml.SafeLoader):
    """Safe YAML that reads 1e-3 as a number and refuses a key given twice."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f"{key.value!r} is given twice", key.start_mark
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)
