# SPDX-License-Identifier: Apache-2.0
"""Repair of shapes of imported robots: shapes that no engine accepts are removed, with a note."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from ..mesh_files import is_pointer, mesh_path, whole_stl
from ..meshes.read import READERS, read_mesh
from ..robot.urdf_check import SIZES, shape_problems
from .notes import Notes

THIN = 1e-3  # thickness given to sides of length 0 [m]
SHAPE_NOTES = {"collision": "without a shape that touches", "visual": "without a shape to draw"}


def cure(root: ET.Element, folder: Path, notes: Notes) -> None:
    """Resolve the mesh files of all shapes, and remove invalid shapes.

    Args:
        root: Element of the robot, changed in place.
        folder: Folder of relative mesh files.
        notes: Collects what was changed.
    """
    for link in root.findall("link"):
        for kind, text in SHAPE_NOTES.items():
            for shape in link.findall(kind):
                name = link.get("name") or ""
                _thicken(shape, name, notes)
                reason, file = _fault(shape, folder, kind == "collision")
                if reason:
                    link.remove(shape)
                    notes.add(f"{text}, as {reason}", f"{name} ({file})" if file else name)


def _thicken(shape: ET.Element, name: str, notes: Notes) -> None:
    """Give plates and discs of zero thickness a thickness of `THIN`."""
    body = _body(shape)
    for key in SIZES.get("" if body is None else body.tag, ()):
        numbers = body.get(key, "").split()
        zeros = [text for text in numbers if _zero(text)]
        if zeros and (len(zeros) < len(numbers) or key == "length"):
            body.set(key, " ".join(f"{THIN:g}" if _zero(text) else text for text in numbers))
            notes.add(f"a side of length 0 is read as {1e3 * THIN:g} mm", name)


def _zero(text: str) -> bool:
    try:
        return float(text) == 0.0
    except ValueError:
        return False


def _body(shape: ET.Element) -> ET.Element | None:
    geometry = shape.find("geometry")
    return None if geometry is None else next(iter(geometry), None)


def _fault(shape: ET.Element, folder: Path, collides: bool) -> tuple[str, str]:
    """Reason why a shape is unusable, "" if it is usable, and its resolved mesh."""
    body = _body(shape)
    if body is not None and body.tag == "mesh":
        file = body.get("filename", "")
        path = mesh_path(file, folder)
        if path is None:
            return "its mesh is not there", file
        if is_pointer(path):
            return "its mesh is a pointer of Git LFS (git lfs pull)", path.name
        if path.suffix.lower() == ".stl" and not whole_stl(path):
            return "its mesh file is cut off", path.name
        if collides and path.suffix.lower() not in READERS:
            return f"no engine reads meshes of kind {path.suffix}", path.name
        if collides and read_mesh(path.resolve()) is None:
            return "its mesh cannot be read", path.name
        body.set("filename", str(path.resolve()))
    broken = next(shape_problems(shape, "", folder, False), "")
    return ("its size or place is none" if broken else ""), ""
