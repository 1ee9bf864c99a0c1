# SPDX-License-Identifier: Apache-2.0
"""Mesh files."""

from __future__ import annotations

import io
import logging
import xml.etree.ElementTree as ET
from functools import lru_cache
from pathlib import Path

import numpy as np

from .. import lazy

trimesh = lazy.module("trimesh")  # few robots have meshes
log = logging.getLogger(__name__)

# Parts of a COLLADA file that say what a shape looks like; a shape with a broken one is lost.
_LOOKS = {
    "library_images", "library_effects", "library_materials", "library_cameras", "library_lights",
    "library_animations", "bind_material", "instance_camera", "instance_light",
}  # fmt: skip


def read_mesh(path: Path) -> trimesh.Trimesh | None:
    """All of a mesh file as one mesh in its own units; None if it cannot be read, told once."""
    return _read(path, _date(path))


def mesh_points(path: Path) -> np.ndarray:
    """Corners of a mesh in its own units, (k, 3); none if the file cannot be read."""
    return _corners(path, _date(path))


def _date(path: Path) -> int:
    """Time at which a file was written [ns]: one that has changed is read again."""
    return path.stat().st_mtime_ns if path.is_file() else 0


@lru_cache(maxsize=16)
def _read(path: Path, date: int) -> trimesh.Trimesh | None:
    try:
        if path.suffix.lower() == ".dae":
            mesh = trimesh.load(io.BytesIO(_shapes(path)), file_type="dae", force="mesh")
        else:
            mesh = trimesh.load(path, force="mesh")
        if not len(mesh.faces):
            raise ValueError("it has no faces")
        return mesh
    except Exception as error:  # noqa: BLE001  (readers of meshes raise anything)
        log.warning("cannot read the mesh %s: %s", path, error)
        return None


def _shapes(path: Path) -> bytes:
    """A COLLADA file without what its shapes look like."""
    root = ET.parse(path).getroot()
    for element in root.iter():
        element.attrib.pop("material", None)
        for part in list(element):
            if part.tag.rpartition("}")[2] in _LOOKS:
                element.remove(part)
    return ET.tostring(root)


@lru_cache(maxsize=64)
def _corners(path: Path, date: int) -> np.ndarray:
    mesh = _read(path, date)
    return np.zeros((0, 3)) if mesh is None else np.unique(np.asarray(mesh.vertices, float), axis=0)
