# SPDX-License-Identifier: Apache-2.0
"""Conversion of values to JSON types and to dotted names."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from loco_control import reading
from loco_control.exceptions import ParameterError
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
