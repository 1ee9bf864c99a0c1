# SPDX-License-Identifier: Apache-2.0
"""Resolution of the mesh file names in a URDF to existing files."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

MAX_LEVELS = 2  # levels above a URDF's folder that are searched for a mesh whose package is unknown


def mesh_path(filename: str, folder: Path) -> Path | None:
    """File of a mesh named in a URDF; None if it does not exist.

    ``package://NAME/REST`` is searched in the folders of ``AMENT_PREFIX_PATH`` and
    ``ROS_PACKAGE_PATH``, then in and above the folder of the URDF. If it is not found there, the
    end of its path is searched near the URDF, for files copied without their package.

    Args:
        filename: Name of the file in the URDF: a path, ``file://`` or ``package://``.
        folder: Folder at which relative paths start.
    """
    scheme, _, path = filename.strip().replace("\\", "/").rpartition("://")
    if not path or scheme in ("http", "https"):
        return None
    if scheme in ("package", "model"):
        path = path.lstrip("/")
        candidates = _in_packages(path, folder)
    else:
        candidates = iter([folder / path])
    fallbacks = _search([part for part in path.split("/") if part not in ("", ".", "..")], folder)
    return next(filter(_is_file, (*candidates, *fallbacks)), None)


def _in_packages(rest: str, folder: Path) -> Iterator[Path]:
    inside = rest.partition("/")[2]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    roots = [Path(p) / "share" for p in prefixes if p]
    roots += [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    above = [folder.resolve(), *folder.resolve().parents]
    yield from (place / rest for place in (*roots, *above))
    for place in above:  # the folder of a package may have another name than the package
        if (place / "package.xml").is_file():
            yield place / inside
    yield folder / inside


def _search(parts: list[str], folder: Path) -> Iterator[Path]:
    """Files with the same end of path, up to two folders above; a bare name only beside."""
    around = [folder.resolve(), *folder.resolve().parents][: MAX_LEVELS + 1]
    for k in range(len(parts) - 1):
        yield from (place.joinpath(*parts[k:]) for place in around)
    for place in (folder, folder / "meshes", *(place / "meshes" for place in around[1:])):
        yield from (place / part for part in parts[-1:])


def _is_file(path: Path) -> bool:
    """Whether a file exists; False for names that no file can have."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_pointer(path: Path) -> bool:
    """Whether the file is a Git LFS pointer instead of the content."""
    return path.stat().st_size < 1024 and b"git-lfs" in path.read_bytes()[:64]


def whole_stl(path: Path) -> bool:
    """Whether a binary STL has as many triangles as it states; the engine reads beyond its end."""
    data = path.read_bytes()
    if data[:5] == b"solid" and b"facet" in data[:1000]:
        return b"endsolid" in data[-1000:]
    return len(data) >= 84 and len(data) >= 84 + 50 * int.from_bytes(data[80:84], "little") > 84
