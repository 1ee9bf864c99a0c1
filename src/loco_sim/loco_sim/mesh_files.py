# SPDX-License-Identifier: Apache-2.0
"""The files that a URDF means by the names of its meshes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

NEAR = 2  # folders above a URDF in which a mesh without a package is looked for


def mesh_path(filename: str, folder: Path) -> Path | None:
    """File that a URDF means by the name of a mesh, None if there is none.

    ``package://NAME/REST`` is looked for in the folders of ``AMENT_PREFIX_PATH`` and
    ``ROS_PACKAGE_PATH``, then in and above the folder of the URDF. What is nowhere there is looked
    for near the URDF by the end of its path: files are copied without their package.

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
    nearby = _nearby([part for part in path.split("/") if part not in ("", ".", "..")], folder)
    return next(filter(_is_file, (*candidates, *nearby)), None)


def _in_packages(rest: str, folder: Path) -> Iterator[Path]:
    inside = rest.partition("/")[2]
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    places = [Path(p) / "share" for p in prefixes if p]
    places += [Path(p) for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p]
    above = [folder.resolve(), *folder.resolve().parents]
    yield from (place / rest for place in (*places, *above))
    for place in above:  # the clone of a package need not be named like it
        if (place / "package.xml").is_file():
            yield place / inside
    yield folder / inside


def _nearby(parts: list[str], folder: Path) -> Iterator[Path]:
    """Files with the same end of path up to two folders above; with the name alone only beside."""
    around = [folder.resolve(), *folder.resolve().parents][: NEAR + 1]
    for k in range(len(parts) - 1):
        yield from (place.joinpath(*parts[k:]) for place in around)
    for place in (folder, folder / "meshes", *(place / "meshes" for place in around[1:])):
        yield from (place / part for part in parts[-1:])


def _is_file(path: Path) -> bool:
    """Whether there is such a file; a name that no file can have is that of none."""
    try:
        return path.is_file()
    except OSError:
        return False


def is_pointer(path: Path) -> bool:
    """Whether Git LFS has left a few lines of text where the file should be."""
    return path.stat().st_size < 1024 and b"git-lfs" in path.read_bytes()[:64]


def whole_stl(path: Path) -> bool:
    """A binary STL has as many triangles as it says; the engine reads on beyond its end."""
    data = path.read_bytes()
    if data[:5] == b"solid" and b"facet" in data[:1000]:
        return b"endsolid" in data[-1000:]
    return len(data) >= 84 and len(data) >= 84 + 50 * int.from_bytes(data[80:84], "little") > 84
