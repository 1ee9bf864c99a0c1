# SPDX-License-Identifier: Apache-2.0
"""Corners of mesh files."""

from __future__ import annotations

import logging
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

log = logging.getLogger(__name__)


@lru_cache(maxsize=64)
def mesh_points(path: Path) -> np.ndarray:
    """Corners of a mesh in its own units, (k, 3); none if the file cannot be read."""
    try:
        return np.unique(np.asarray(trimesh.load(path, force="mesh").vertices, float), axis=0)
    except Exception as error:  # noqa: BLE001  (readers of meshes raise anything)
        log.warning("cannot read %s: %s", path, error)
        return np.zeros((0, 3))
