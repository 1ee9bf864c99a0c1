# SPDX-License-Identifier: Apache-2.0
"""Gait files: oscillator parameters, the body for which they were searched, and their result.

The block `target` is that of an experiment; for a robot with a trunk
controller it is the block `gait` of an experiment.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.files import write_whole
from loco_control.gait.generator import GaitParams
from loco_control.gait.oscillators import CpgParams
from loco_control.params import from_dict, to_dict
from loco_control.reading import shown, understood

from ..plain import Collection, read_yaml

FORMAT = 1
FILES = Collection("gait", "gaits")
names = FILES.names


@dataclass(frozen=True)
class Gait:
    """Result of a gait search."""

    name: str
    robot: str  # name, or path of a model.yaml
    target: CpgParams | GaitParams  # oscillators, or a foot trajectory generator
    parameters: dict[str, float]  # searched parameters
    speed: float  # forward, mean over the rollout [m/s]
    distance: float  # forward [m]
    duration: float  # duration of the rollout [s]
    seed: int  # seed of the search
    evaluations: int  # number of rollouts of the search
    overrides: dict[str, Any] = field(default_factory=dict)  # values of robot.yaml
    randomise: float = 0.0  # standard deviation of the bodies in the search, relative
    samples: int = 1  # number of bodies in the search
    check: dict[str, float] = field(default_factory=dict)  # results on other bodies

    def save(self, path: str | Path) -> None:
        """Write to a YAML file, completely or not at all."""
        values = {"format": FORMAT, "kind": "gait", **dataclasses.asdict(self)}
        values["target"] = to_dict(self.target)
        head = "# SPDX-License-Identifier: Apache-2.0\n# Written by `loco optimise`.\n"
        text = yaml.safe_dump(values, sort_keys=False, default_flow_style=None)
        write_whole(path, head + text)


@understood("whole gait")
def load(name_or_path: str | Path) -> Gait:
    """Read a gait by name or path.

    Raises:
        NameUnknownError: The package has no such gait, or a key is unknown.
        MissingFileError: The file does not exist.
        ParameterError: The file is not a gait, of another version, or a value is invalid.
    """
    path = FILES.find(name_or_path)
    values = read_yaml(path)
    header = (values.pop("kind", None), values.pop("format", None))
    if header != ("gait", FORMAT):
        raise ParameterError(
            f"{path} is of kind {shown(header[0])}, format {shown(header[1])}; "
            f"wanted is 'gait', format {FORMAT}"
        )
    fields = {f.name: f for f in dataclasses.fields(Gait)}
    for key in values:
        if key not in fields:
            raise NameUnknownError(f"key in gait {path}", key, fields)
    missing = [n for n, f in fields.items() if n not in values and f.default is f.default_factory]
    if missing:
        raise ParameterError(f"{path} lacks {', '.join(missing)}")
    legged = isinstance(values["target"], Mapping) and "pattern" in values["target"]
    kind = GaitParams if legged else CpgParams
    values["target"] = from_dict(kind, values["target"], f"{path}: target")
    return Gait(**values)
