# SPDX-License-Identifier: Apache-2.0
"""A ``model.yaml``: a robot, values of it that were calibrated, and effects.

    format: 1
    robot: tigrillo
    overrides: {masses.front_body: 0.674, "springs.?h_kfe_joint.stiffness": 440.6}
    effects: [{name: command_delay, delay: 0.1}]

Whoever takes the name of a robot takes the path of such a file (`load_any`).
"""

from __future__ import annotations

import os
import tempfile
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError

from . import effects, robot
from .effects.base import Effect

FORMAT = 1
KEYS = ("format", "robot", "overrides", "effects")


@dataclass(frozen=True)
class Model:
    """What to simulate.

    Attributes:
        robot: Name, or path of a ``robot.yaml``.
        overrides: Values of ``robot.yaml`` to change, by dotted name.
        effects: As in an experiment's list.
    """

    robot: str
    overrides: dict[str, Any] = field(default_factory=dict)
    effects: list[dict[str, Any]] = field(default_factory=list)

    def make_robot(self) -> robot.Robot:
        """The robot with its overrides."""
        return robot.load(self.robot, self.overrides)

    def make_effects(self) -> list[Effect]:
        """The effects, new ones."""
        return effects.from_list(self.effects)

    def dumps(self) -> str:
        """Text of a ``model.yaml``, for `loads`."""
        values = {"format": FORMAT, "robot": self.robot}
        values |= {"overrides": dict(self.overrides), "effects": list(self.effects)}
        return "# SPDX-License-Identifier: Apache-2.0\n" + yaml.safe_dump(values, sort_keys=False)

    def save(self, path: str | Path) -> None:
        """Write a ``model.yaml``, whole or not at all."""
        path, text = Path(path), self.dumps()
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as file:
                file.write(text)
            os.chmod(temporary, 0o644)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise


def load(path: str | Path) -> Model:
    """Read and check a ``model.yaml``; the path of a robot in it starts at its folder.

    Raises:
        MissingFileError: There is no such file.
        ParameterError: It is not a model, or one of another version.
        NameUnknownError: It names a key, robot, joint, link, effect or parameter that is
            not there.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError:
        raise MissingFileError(f"there is no model at {path}") from None
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path} is not YAML: {error}") from None
    return loads(text, path)


def loads(text: str, path: str | Path = "model.yaml") -> Model:
    """Check the text of a ``model.yaml``; `path` is where it lies, for names and messages.

    Raises:
        LocoError: As `load`.
    """
    path = Path(path)
    try:
        values = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise ParameterError(f"{path} is not YAML: {error}") from None
    if not isinstance(values, dict) or "robot" not in values:
        raise ParameterError(f"{path} must be a mapping with 'format' and 'robot'")
    for key in values:
        if key not in KEYS:
            raise NameUnknownError(f"key in {path}", str(key), KEYS)
    if values.get("format") != FORMAT:
        raise ParameterError(
            f"{path} has format {values.get('format')!r}; this version reads {FORMAT}"
        )
    overrides, listed = values.get("overrides") or {}, values.get("effects") or []
    if not isinstance(overrides, dict) or not isinstance(listed, list):
        raise ParameterError(f"{path}: overrides must be a mapping and effects a list")
    beside = path.parent / str(values["robot"])
    named = str(values["robot"]) in robot.names()
    model = Model(str(values["robot"] if named else beside), overrides, listed)
    model.make_robot()
    model.make_effects()
    return model


def load_any(name_or_path: str | Path) -> Model:
    """Model of a robot's name, the path of a robot, or the path of a ``model.yaml``.

    Raises:
        LocoError: As `load` and `robot.load`.
    """
    path = Path(name_or_path)
    if path.is_file() and path.suffix in (".yaml", ".yml") and _is_model(path):
        return load(path)
    robot.load(name_or_path)
    return Model(str(name_or_path))


def _is_model(path: Path) -> bool:
    """A robot names its URDF, a model does not."""
    try:
        values = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError):
        return False
    return isinstance(values, dict) and "urdf" not in values
