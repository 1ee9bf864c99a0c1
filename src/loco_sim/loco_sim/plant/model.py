# SPDX-License-Identifier: Apache-2.0
"""Models (``model.yaml``): a robot with changed parameter values, and effects.

    format: 1
    robot: tigrillo
    overrides: {masses.front_body: 0.674, "springs.?h_kfe_joint.stiffness": 440.6}
    effects: [{name: command_delay, delay: 0.1}]

Where the name of a robot is accepted, the path of such a file is, too (`load_any`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_control.files import write_whole
from loco_control.reading import parse_yaml, read_text, read_yaml, shown, understood

from .. import effects
from ..effects.base import Effect
from ..effects.catalogue.learned import LearnedResidual
from ..robot import robot

FORMAT = 1
KEYS = ("format", "robot", "overrides", "effects")
HEAD = "# SPDX-License-Identifier: Apache-2.0\n"
LEARNED = "# learned_residual is a correction: it closes a gap and explains nothing\n"


@dataclass(frozen=True)
class Model:
    """A robot with changed parameter values and effects, sufficient for a simulation.

    Attributes:
        robot: Name, or path of a ``robot.yaml``.
        overrides: Values of ``robot.yaml`` to change, by dotted name.
        effects: One mapping per effect, as in the list `effects` of an experiment.
    """

    robot: str
    overrides: dict[str, Any] = field(default_factory=dict)
    effects: list[dict[str, Any]] = field(default_factory=list)

    def make_robot(self, overrides: Mapping[str, Any] | None = None) -> robot.Robot:
        """The robot with the overrides of the model, and further ones that precede them."""
        return robot.load(self.robot, {**self.overrides, **(overrides or {})})

    def make_effects(self) -> list[Effect]:
        """New instances of the effects."""
        return effects.from_list(self.effects)

    def dumps(self) -> str:
        """Text of a ``model.yaml``, readable by `loads`."""
        values = {"format": FORMAT, "robot": self.robot}
        values |= {"overrides": dict(self.overrides), "effects": list(self.effects)}
        learned = any(effect.get("name") == LearnedResidual.name for effect in self.effects)
        head = HEAD + LEARNED if learned else HEAD
        return head + yaml.safe_dump(values, sort_keys=False)

    def save(self, path: str | Path) -> None:
        """Write a ``model.yaml`` atomically."""
        write_whole(path, self.dumps())


@understood("whole model")
def load(path: str | Path) -> Model:
    """Read and check a ``model.yaml``; the path of its robot is relative to the file.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: The file is not a model, or has another format version.
        NameUnknownError: It names a key, robot, joint, link, effect or parameter that does not
            exist.
    """
    return loads(read_text(path, "model"), path)


def loads(text: str, path: str | Path = "model.yaml") -> Model:
    """Model from the text of a ``model.yaml``; `path` is its file, for relative paths and messages.

    Raises:
        LocoError: The text is not a model, or names objects that do not exist.
    """
    return from_values(parse_yaml(text, path), path)


def from_values(values: Any, path: str | Path = "model.yaml") -> Model:
    """Model from the values of a ``model.yaml``; `path` is its file, for paths and messages.

    Raises:
        LocoError: The values are not a model, or name objects that do not exist.
    """
    path = Path(path)
    if not isinstance(values, dict) or "robot" not in values:
        raise ParameterError(f"{path} must be a mapping with 'format' and 'robot'")
    for key in values:
        if key not in KEYS:
            raise NameUnknownError(f"key in {path}", str(key), KEYS)
    if values.get("format") != FORMAT:
        raise ParameterError(
            f"{path} has format {shown(values.get('format'))}; this version reads {FORMAT}"
        )
    overrides, listed = values.get("overrides") or {}, values.get("effects") or []
    if not isinstance(overrides, dict) or not isinstance(listed, list):
        raise ParameterError(f"{path}: overrides must be a mapping and effects a list")
    robot_path = path.parent / str(values["robot"])
    named = str(values["robot"]) in robot.names()
    model = Model(str(values["robot"] if named else robot_path), overrides, listed)
    model.make_robot()
    model.make_effects()
    return model


@understood("robot or model")
def load_any(name_or_path: str | Path) -> Model:
    """Model from the name or path of a robot, or from the path of a ``model.yaml``.

    Raises:
        LocoError: The file is missing, cannot be read, or describes neither a robot nor a model.
    """
    path = Path(name_or_path)
    if path.is_file() and path.suffix in (".yaml", ".yml") and _is_model(path):
        return load(path)
    robot.load(name_or_path)
    return Model(str(name_or_path))


def _is_model(path: Path) -> bool:
    """Whether a YAML file is a model; a robot has the key `urdf`, a model does not."""
    try:
        values = read_yaml(path)
    except LocoError:
        return False
    return isinstance(values, dict) and "urdf" not in values
