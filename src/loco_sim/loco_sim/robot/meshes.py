# SPDX-License-Identifier: Apache-2.0
"""Mesh files."""

from __future__ import annotations

import logging
from functools import lru_cache
from pathlib import Path

import numpy as np
import trimesh

log = logging.getLogger(__name__)


@lru_cache(maxsize=16)
def read_mesh(path: Path) -> trimesh.Trimesh | None:
    """All of a mesh file as one mesh in its own units; None if it cannot be read, told once."""
    try:
        return trimesh.load(path, force="mesh")
    except Exception as error:  # noqa: BLE001  (readers of meshes raise anything)
        log.warning("cannot read the mesh %s: %s", path, error)
        return None


@lru_cache(maxsize=64)
def mesh_points(path: Path) -> np.ndarray:
    """Corners of a mesh in its own units, (k, 3); none if the file cannot be read."""
    mesh = read_mesh(path)
    return np.zeros((0, 3)) if mesh is None else np.unique(np.asarray(mesh.vertices, float), axis=0)
