# SPDX-License-Identifier: Apache-2.0
"""Reader of the triangles of a COLLADA file, with bounded loops.

It reads the geometries of the scene, transformed by its nodes and scaled by the unit. Skins,
lights, materials and the up axis are ignored, as in PyBullet and RViz.
"""

from __future__ import annotations

import io
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.reading import DEEPEST, shown

# Corners (k, 3), corner indices of triangles (f, 3), and the object number of each (f,).
Shape = tuple[np.ndarray, np.ndarray, np.ndarray]

MOST_ELEMENTS = 1_000_000  # XML elements
MOST_NODES = 10_000  # nodes of the scene, instances included
_LINES = ("lines", "linestrips")  # have no faces
_COUNTS = {"matrix": 16, "translate": 3, "rotate": 4, "scale": 3}


def read(data: bytes, path: Path, max_triangles: int) -> Shape:
    """All triangles of the scene [m].

    Args:
        data: Contents of the file.
        path: Name of the file, for messages.
        max_triangles: Largest number of triangles.

    Raises:
        ParameterError: The file is not COLLADA, has a broken reference, or exceeds a limit.
    """
    file = _File(_parse(data, path), path, max_triangles)
    for scene in file.all("scene/instance_visual_scene"):
        file.show(file.named(scene.get("url")), np.eye(4), 0)
    corners = np.concatenate([np.zeros((0, 3)), *file.corners])
    faces = np.concatenate([np.zeros((0, 3), int), *file.faces])
    return corners * file.unit(), faces, np.zeros(len(faces), int)


def _parse(data: bytes, path: Path) -> ET.Element:
    """Root of the XML, tags without name spaces.

    Raises:
        ParameterError: The data is not XML, defines entities, or has too many or too deep elements.
    """
    depth = count = 0
    root = None
    try:
        if b"<!DOCTYPE" in data:
            raise ParameterError(f"the mesh {path} has a DOCTYPE, which is not read; remove it")
        for event, element in ET.iterparse(io.BytesIO(data), ("start", "end")):
            depth += 1 if event == "start" else -1
            count += event == "start"
            element.tag = str(element.tag).rpartition("}")[2]
            root = element if root is None else root
            if depth > DEEPEST or count > MOST_ELEMENTS:
                raise ParameterError(
                    f"the mesh {path} has more than {MOST_ELEMENTS} elements, or more than "
                    f"{DEEPEST} within each other"
                )
    except (ET.ParseError, ValueError, LookupError) as error:
        if isinstance(error, ParameterError):
            raise
        raise ParameterError(f"the mesh {path} is not XML: {error}") from None
    if root is None or root.tag != "COLLADA":
        raise ParameterError(f"the mesh {path} is not COLLADA")
    return root


class _File:
    """Elements of a file by name, and the triangles collected so far.

    Attributes:
        corners: Corners of each geometry of the scene, each (k, 3).
        faces: Triangles of each geometry, as indices into all corners, each (f, 3).
    """

    def __init__(self, root: ET.Element, path: Path, max_triangles: int):
        self._root, self._path, self._limit = root, path, max_triangles
        self._named = {e.get("id"): e for e in root.iter() if e.get("id")}
        self._geometries: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        self._arrays: dict[ET.Element, np.ndarray] = {}
        self._nodes = self._corner_count = self._face_count = 0
        self.corners: list[np.ndarray] = []
        self.faces: list[np.ndarray] = []

    def all(self, path: str) -> list[ET.Element]:
        """Elements at a path below the root."""
        return self._root.findall(path)

    def unit(self) -> float:
        """Unit of length of the file [m]."""
        unit = self._root.find("asset/unit")
        length = 1.0 if unit is None else self._number(unit.get("meter", "1"))
        if not 0.0 < length < np.inf:
            raise self._wrong(f"its unit is {shown(unit.get('meter'))} m")
        return length

    def named(self, url: str | None) -> ET.Element:
        """Element with the id of a reference such as ``#name``.

        Raises:
            ParameterError: No element has this id.
        """
        element = self._named.get((url or "").removeprefix("#"))
        if element is None:
            raise self._wrong(f"it names {shown(url)}, which it does not hold")
        return element

    def show(self, node: ET.Element, place: np.ndarray, depth: int) -> None:
        """Add the triangles of a node and its descendants, in the parent frame `place`, (4, 4)."""
        self._nodes += 1
        if self._nodes > MOST_NODES or depth > DEEPEST:
            raise self._wrong(
                f"its scene has more than {MOST_NODES} nodes, or more than {DEEPEST} within "
                "each other"
            )
        for child in node:
            if child.tag in _COUNTS:
                place = place @ self._transform(child)
            elif child.tag in ("lookat", "skew"):
                raise self._wrong(f"<{child.tag}> is not read; export it with matrices")
            elif child.tag == "node":
                self.show(child, place, depth + 1)
            elif child.tag == "instance_node":
                self.show(self.named(child.get("url")), place, depth + 1)
            elif child.tag == "instance_geometry":
                self._add(*self._geometry(child.get("url") or ""), place)

    def _add(self, corners: np.ndarray, faces: np.ndarray, place: np.ndarray) -> None:
        self.corners.append(corners @ place[:3, :3].T + place[:3, 3])
        self.faces.append(faces + self._corner_count)
        self._corner_count += len(corners)
        self._face_count += len(faces)
        if max(self._face_count, self._corner_count / 3) > self._limit:
            raise self._wrong(f"its scene has more than {self._limit} triangles; simplify it")

    def _transform(self, element: ET.Element) -> np.ndarray:
        values = self._numbers(element)
        if len(values) != _COUNTS[element.tag] or not np.all(np.isfinite(values)):
            raise self._wrong(f"a <{element.tag}> is not {_COUNTS[element.tag]} numbers")
        if element.tag == "matrix":
            return values.reshape(4, 4)
        result = np.eye(4)
        if element.tag == "translate":
            result[:3, 3] = values
        elif element.tag == "scale":
            result[:3, :3] = np.diag(values)
        else:
            x, y, z = values[:3] / max(float(np.linalg.norm(values[:3])), 1e-300)
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            angle = np.deg2rad(values[3])
            result[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
        return result

    def _geometry(self, url: str) -> tuple[np.ndarray, np.ndarray]:
        """Corners (k, 3) and triangles (f, 3) of a geometry in its own frame."""
        if url not in self._geometries:
            mesh = self.named(url).find("mesh")
            parts = [self._primitive(p) for p in ([] if mesh is None else mesh) if _has_faces(p)]
            corners = [np.zeros((0, 3)), *(c for c, _ in parts)]
            starts = np.cumsum([len(c) for c in corners])
            faces = [f + start for (_, f), start in zip(parts, starts, strict=False)]
            self._geometries[url] = (
                np.concatenate(corners), np.concatenate([np.zeros((0, 3), int), *faces]),
            )  # fmt: skip
        return self._geometries[url]

    def _primitive(self, element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
        """Corners and triangles of one face list (primitive) of a geometry."""
        if element.tag not in ("triangles", "polylist", "polygons"):
            raise self._wrong(f"<{element.tag}> is not read; export it with triangles")
        inputs = element.findall("input")
        offsets = [self._integer(i.get("offset", "0"), 64) for i in inputs]
        at = [o for i, o in zip(inputs, offsets, strict=True) if i.get("semantic") == "VERTEX"]
        if not at:
            raise self._wrong(f"<{element.tag}> has no VERTEX")
        source = next(i for i in inputs if i.get("semantic") == "VERTEX").get("source")
        rings = list(self._rings(element, max(offsets) + 1, at[0]))
        corners = self._positions(self.named(source))
        faces = np.concatenate([np.zeros((0, 3), int), *map(_fan, rings)])
        if np.any((faces < 0) | (faces >= len(corners))):
            raise self._wrong(f"a face names corner {faces.max()} of {len(corners)}")
        used, faces = np.unique(faces, return_inverse=True)
        return corners[used], faces.reshape(-1, 3)

    def _rings(self, element: ET.Element, width: int, at: int) -> Iterator[np.ndarray]:
        """Corner indices of faces, grouped by number of corners, (count, number) each."""
        lists = [self._numbers(p) for p in element.findall("p")]
        if element.tag == "polygons":
            lengths = np.array([len(p) // width for p in lists], int)
        values = np.concatenate([np.zeros(0), *lists])
        if not np.all(np.abs(values) < 2**31) or len(values) % width:
            raise self._wrong(f"<{element.tag}> has {len(values)} indices, {width} for a corner")
        corners = values.astype(int).reshape(-1, width)[:, at]
        if element.tag == "triangles":
            lengths = np.full(len(corners) // 3, 3)
        elif element.tag == "polylist":
            counts = element.find("vcount")
            sizes = np.zeros(0) if counts is None else self._numbers(counts)
            if not np.all((sizes >= 3) & (sizes <= len(corners))):
                raise self._wrong("a face of its <vcount> has fewer than 3 corners, or too many")
            lengths = sizes.astype(int)
        if np.any(lengths < 3) or lengths.sum() != len(corners):
            raise self._wrong(f"the faces of <{element.tag}> are not those of its corners")
        if (lengths - 2).sum() > self._limit:
            raise self._wrong(f"it has more than {self._limit} triangles; simplify it")
        starts = np.cumsum(lengths) - lengths
        for length in np.unique(lengths):
            yield corners[starts[lengths == length][:, None] + np.arange(length)]

    def _positions(self, vertices: ET.Element) -> np.ndarray:
        """Corners of a <vertices> element or of a source, (k, 3)."""
        for entry in vertices.findall("input"):
            if entry.get("semantic") == "POSITION":
                vertices = self.named(entry.get("source"))
                break
        array = vertices.find("float_array")
        if array is None:
            raise self._wrong("a geometry has no <float_array> of corners")
        accessor = vertices.find("technique_common/accessor")
        stride = 3 if accessor is None else self._integer(accessor.get("stride", "3"), 64)
        if array not in self._arrays:  # cached: many face lists may reference one source
            self._arrays[array] = self._numbers(array)
        values = self._arrays[array]
        if stride < 3 or len(values) % stride:
            raise self._wrong(f"{len(values)} numbers are no corners of {stride} each")
        return values.reshape(-1, stride)[:, :3]

    def _numbers(self, element: ET.Element) -> np.ndarray:
        tokens = (element.text or "").split()
        return np.fromiter((self._number(token) for token in tokens), float, len(tokens))

    def _number(self, token: str) -> float:
        try:
            return float(token)
        except ValueError:
            raise self._wrong(f"{shown(token)} is no number") from None

    def _integer(self, token: str, maximum: int) -> int:
        value = self._number(token)
        if not 0 <= value <= maximum or value != int(value):
            raise self._wrong(f"{shown(token)} is no whole number of 0 to {maximum}")
        return int(value)

    def _wrong(self, reason: str) -> ParameterError:
        return ParameterError(f"the mesh {self._path}: {reason}")


def _has_faces(element: ET.Element) -> bool:
    return element.tag not in ("source", "vertices", "extra", *_LINES)


def _fan(rings: np.ndarray) -> np.ndarray:
    """Triangle fans of faces with n corners, (count, n): each fan starts at the first corner."""
    n = rings.shape[1]
    order = np.column_stack([np.zeros(n - 2, int), np.arange(1, n - 1), np.arange(2, n)])
    return rings[:, order].reshape(-1, 3)
