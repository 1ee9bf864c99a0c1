# SPDX-License-Identifier: Apache-2.0
"""Plain values: conversion to JSON types and to dotted names, and YAML files that hold them."""

from __future__ import annotations

import importlib.resources
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from loco_control import reading
from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.reading import shown


def plain(value: Any) -> Any:
    """Values as JSON types; NaN and infinities become None."""
    if isinstance(value, Mapping):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return plain(value.tolist())
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested mappings flattened to dotted names: ``{a: {b: 1}}`` is ``{"a.b": 1}``."""
    out: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            out |= flat(value, f"{prefix}{key}.")
        else:
            out[f"{prefix}{key}"] = value
    return out


def read_yaml(path: Path) -> dict[str, Any]:
    """Mapping in a YAML file.

    Raises:
        MissingFileError: The file cannot be read.
        ParameterError: The file is not YAML (with the line), or not a mapping.
    """
    values = reading.read_yaml(path)
    if not isinstance(values, dict):
        raise ParameterError(f"{path} must hold a mapping of parameters, got {shown(values)}")
    return values


@dataclass(frozen=True)
class Collection:
    """YAML files of one kind: those of the package by name, those of the user by path.

    Attributes:
        kind: Name of the kind of file, for messages.
        folder: Folder in the package.
        keys: Keys that a file may have; empty if its reader checks them.
        hint: Advice for the message about a missing file.
    """

    kind: str
    folder: str
    keys: tuple[str, ...] = ()
    hint: str = ""

    def names(self) -> list[str]:
        """Names of the files in the package."""
        return sorted(path.stem for path in self._shipped().glob("*.yaml"))

    def find(self, name_or_path: str | Path, relative_to: Path = Path()) -> Path:
        """Path of a file.

        Args:
            name_or_path: One of `names()`, or a path that ends in ``.yaml``.
            relative_to: Folder to which the path is relative, or otherwise the current one.

        Raises:
            NameUnknownError: The package has no such file.
            MissingFileError: There is no file at the path.
        """
        text = str(name_or_path)
        if not text.endswith((".yaml", ".yml")):
            if text not in self.names():
                raise NameUnknownError(self.kind, text, self.names())
            return self._shipped() / f"{text}.yaml"
        for path in (relative_to / text, Path(text)):
            if path.is_file():
                return path
        raise MissingFileError(f"there is no {self.kind} file {relative_to / text}{self.hint}")

    def read(
        self, path: Path, merge: Callable[[Any, Any], dict], visited: tuple[Path, ...] = ()
    ) -> dict[str, Any]:
        """Values of a file, merged with those of the file that its key ``extends`` names.

        Args:
            path: The file.
            merge: Function of the values of the other file and of this one.
            visited: Files that extend this one.

        Raises:
            ParameterError: Files extend each other, or `extends` is no name.
            NameUnknownError: A file has an unknown key, or extends an unknown file.
        """
        path = path.resolve()
        if path in visited:
            names = " > ".join(p.stem for p in (*visited, path))
            raise ParameterError(f"{self.kind} {path} extends itself: {names}")
        values = read_yaml(path)
        for key in values:
            if self.keys and key not in self.keys:
                raise NameUnknownError(f"key in {self.kind} {path.stem}", key, self.keys)
        base = values.pop("extends", None)
        if base is None:
            return values
        if not isinstance(base, str):
            raise ParameterError(
                f"{path}: extends must be the name of another {self.kind}, got {base!r}"
            )
        return merge(self.read(self.find(base, path.parent), merge, (*visited, path)), values)

    def _shipped(self) -> Path:
        return Path(str(importlib.resources.files("loco_learning"))) / self.folder
