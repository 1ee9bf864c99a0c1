# SPDX-License-Identifier: Apache-2.0
"""Safe reading of mesh files with limits: STL, OBJ and COLLADA.

The engines do not validate meshes (an OBJ of 16 bytes crashes PyBullet), so they never receive the
original file: it is read here, its size, counts, numbers and indices are checked, and the engine
receives a rewritten mesh. Only triangles are read; materials, textures and referenced files are
ignored.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Callable
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from loco_control.exceptions import LocoError, ParameterError
from loco_control.reading import read_bytes, shown, understood

from . import collada

log = logging.getLogger(__name__)

MOST_BYTES = 64 * 2**20  # limit of a mesh file; the largest known mesh has 12 MiB
MOST_FACES = 500_000  # triangles; MuJoCo itself accepts 200,000 in an STL
MOST_LINE = 2**20  # bytes of a line of an OBJ
MOST_GROUPS = 1_000  # objects of one OBJ, each a convex hull in PyBullet
FARTHEST = 1e9  # largest absolute coordinate, as for all lengths of a URDF
_SOLID = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)")


class Mesh(NamedTuple):
    """Triangles of a mesh file, in its own units.

    Attributes:
        vertices: Unique corners, (k, 3).
        faces: Indices of the corners of each triangle, (f, 3).
        groups: Object number of each triangle, (f,).
    """

    vertices: np.ndarray
    faces: np.ndarray
    groups: np.ndarray

    @property
    def triangles(self) -> np.ndarray:
        """Corners of each triangle, (f, 3, 3)."""
        return self.vertices[self.faces]


def load(path: Path) -> Mesh:
    """All triangles of a mesh file.

    Args:
        path: A file whose name ends in one of `READERS`.

    Raises:
        LocoError: The file is not a mesh of a supported format, or exceeds a limit of this module.
    """
    result = _read(path, _date(path))
    if isinstance(result, LocoError):
        raise result
    return result


def read_mesh(path: Path) -> Mesh | None:
    """As `load`; None, with one warning, if the file cannot be read."""
    return _read_or_warn(path, _date(path))


def mesh_points(path: Path) -> np.ndarray:
    """Corners of a mesh in its own units, (k, 3); none if the file cannot be read."""
    mesh = read_mesh(path)
    return np.zeros((0, 3)) if mesh is None else mesh.vertices


def rewritten(path: Path) -> tuple[str, bytes]:
    """A mesh file rewritten for an engine: file name extension, and contents.

    The result is an OBJ for an OBJ, whose objects PyBullet separates, else a binary STL.

    Raises:
        LocoError: The file is not a mesh of a supported format, or exceeds a limit of this module.
    """
    load(path)
    return _rewritten(path, _date(path))


def _date(path: Path) -> int:
    """Modification time of a file [ns], to detect changes."""
    return path.stat().st_mtime_ns if path.is_file() else 0


@lru_cache(maxsize=64)
def _read(path: Path, date: int) -> Mesh | LocoError:
    try:
        return _parse(path)
    except LocoError as error:
        return error


@lru_cache(maxsize=64)
def _read_or_warn(path: Path, date: int) -> Mesh | None:
    result = _read(path, date)
    if isinstance(result, LocoError):
        log.warning("without a mesh: %s", result)
        return None
    return result


@lru_cache(maxsize=64)
def _rewritten(path: Path, date: int) -> tuple[str, bytes]:
    mesh, file = load(path), io.BytesIO()
    if path.suffix.lower() != ".obj":
        solid = np.zeros(len(mesh.faces), _SOLID)
        solid["corners"] = mesh.triangles
        return ".stl", bytes(80) + len(solid).to_bytes(4, "little") + solid.tobytes()
    np.savetxt(file, mesh.vertices, "v %.9g %.9g %.9g")
    for group in np.unique(mesh.groups):
        file.write(b"o part\n")
        np.savetxt(file, mesh.faces[mesh.groups == group] + 1, "f %d %d %d")
    return ".obj", file.getvalue()


@understood("mesh")
def _parse(path: Path) -> Mesh:
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        suffixes = ", ".join(READERS)
        raise ParameterError(f"the mesh {path} is of kind {path.suffix!r}; read are {suffixes}")
    with np.errstate(all="ignore"):  # infinite values are refused below
        corners, faces, groups = reader(read_bytes(path, "mesh", MOST_BYTES), path)
    return _checked(np.asarray(corners, float), np.asarray(faces), np.asarray(groups), path)


def _checked(corners: np.ndarray, faces: np.ndarray, groups: np.ndarray, path: Path) -> Mesh:
    """Mesh with unique corners, after checking all numbers."""
    _check_count(len(faces), path)
    if len(faces) == 0:
        raise ParameterError(f"the mesh {path} has no faces")
    outside = faces[(faces < 0) | (faces >= len(corners))]
    if len(outside):
        raise ParameterError(
            f"the mesh {path}: a face names corner {outside[0]}, counted from 0, "
            f"of {len(corners)} corners"
        )
    used, faces = np.unique(faces, return_inverse=True)
    corners = corners[used] + 0.0  # turns -0.0 into 0.0
    wrong = ~(np.abs(corners) <= FARTHEST)  # True for NaN, too
    if wrong.any():
        raise ParameterError(
            f"the mesh {path}: a coordinate is {corners[wrong][0]:g}, must be a number of at most "
            f"{FARTHEST:g}"
        )
    vertices, order = np.unique(corners, axis=0, return_inverse=True)
    faces = order.reshape(-1)[faces.reshape(-1, 3)]
    for array in (vertices, faces, groups):
        array.flags.writeable = False  # cached and shared
    return Mesh(vertices, faces, groups)


def _check_count(count: int, path: Path) -> None:
    if count > MOST_FACES:
        raise ParameterError(
            f"the mesh {path} has {count} triangles or more, at most {MOST_FACES} are read; "
            "simplify it"
        )


def _stl(data: bytes, path: Path) -> collada.Shape:
    if data[:5] == b"solid" and b"facet" in data[:1000]:
        return _stl_text(data, path)
    count = int.from_bytes(data[80:84], "little")
    if len(data) < 84 + _SOLID.itemsize * count or len(data) < 84:
        raise ParameterError(
            f"the mesh {path} is cut off: {len(data)} bytes, {count} triangles need "
            f"{84 + _SOLID.itemsize * count}"
        )
    _check_count(count, path)
    corners = np.frombuffer(data, _SOLID, count, 84)["corners"].reshape(-1, 3)
    return corners, np.arange(len(corners)).reshape(-1, 3), np.zeros(count, int)


def _stl_text(data: bytes, path: Path) -> collada.Shape:
    if b"endsolid" not in data[-1000:]:
        raise ParameterError(f"the mesh {path} is cut off: its end lacks 'endsolid'")
    rows = islice(_VERTEX.finditer(data), 3 * MOST_FACES + 1)
    corners = [[_number(token, path) for token in row.groups()] for row in rows]
    _check_count(-(-len(corners) // 3), path)
    if len(corners) % 3:
        raise ParameterError(f"the mesh {path} has {len(corners)} corners, three for each facet")
    faces = np.arange(len(corners)).reshape(-1, 3)
    return np.reshape(corners, (-1, 3)), faces, np.zeros(len(faces), int)


def _wavefront(data: bytes, path: Path) -> collada.Shape:
    corners: list[list[float]] = []
    faces: list[list[int]] = []
    groups: list[int] = []
    group = 0
    for line in io.BytesIO(data.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")):
        if len(line) > MOST_LINE:
            raise ParameterError(f"the mesh {path} has a line of more than {MOST_LINE} bytes")
        tokens = line.partition(b"#")[0].split()
        kind = tokens[0] if tokens else b""
        if kind == b"v":
            corners.append([_number(token, path) for token in tokens[1:4]])
            if len(tokens) < 4:
                raise ParameterError(f"the mesh {path}: a corner has {len(tokens) - 1} numbers")
            _check_count(len(corners) // 3, path)
        elif kind == b"f":
            ring = [_index(token, len(corners), path) for token in tokens[1:]]
            triangles = [[ring[0], b, c] for b, c in zip(ring[1:], ring[2:], strict=False)]
            faces += triangles
            groups += [group] * len(triangles)
            _check_count(len(faces), path)
        elif kind in (b"o", b"g") and groups and groups[-1] == group:
            group += 1
            if group >= MOST_GROUPS:
                raise ParameterError(f"the mesh {path} has {MOST_GROUPS} objects or more")
    return np.reshape(corners, (-1, 3)), np.reshape(faces, (-1, 3)).astype(int), np.array(groups)


def _index(token: bytes, count: int, path: Path) -> int:
    """Index of a corner from 0; OBJ counts from 1, or backwards from the last corner."""
    try:
        number = int(token.partition(b"/")[0])
    except ValueError:
        number = 0
    if number == 0 or not -count <= number < 2**31:
        raise ParameterError(f"the mesh {path}: a face names corner {shown(token)} of {count}")
    return number - 1 if number > 0 else count + number


def _number(token: bytes, path: Path) -> float:
    try:
        return float(token)
    except ValueError:
        raise ParameterError(f"the mesh {path}: {shown(token)} is no number") from None


READERS: dict[str, Callable[[bytes, Path], collada.Shape]] = {
    ".stl": _stl, ".obj": _wavefront,
    ".dae": lambda data, path: collada.read(data, path, MOST_FACES),
}  # fmt: skip
