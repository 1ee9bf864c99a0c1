# SPDX-License-Identifier: Apache-2.0
"""Small faults of URDFs in the wild that have one obvious cure, cured and listed.

What has none (two links of one name, a missing mesh, a negative mass) stays as it is, for
`urdf_check` to refuse.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from loco_control.reading import read_bytes

from ..bolted.tree import pose
from ..geometry import added
from ..robot.urdf_check import (
    MOST,
    MOVING,
    SIZES,
    TENSOR,
    inertia_fault,
    inertia_matrix,
    mass_of,
    mesh_path,
    parse,
)
from .shapes import link_points, solid_inertia

KEPT = ("link", "joint", "material")
WORLDS = ("world", "map", "odom", "ground")
SLIDE = 1.0  # travel to each side of a slide that names none [m]
POINT = 1e-9  # inertia per mass below which a tensor is none, a body of 0.03 mm [m²]
FEATHER = 1e-3  # mass of a link that needs one, as a share of the robot's


class Tidied:
    """A URDF after its cures.

    Attributes:
        root: Element of the robot: links, joints and materials, meshes by absolute path.
        notes: A sentence for each kind of cure.
    """

    def __init__(self, path: Path):
        """Read and cure a URDF.

        Raises:
            ParameterError: The file is not XML or not a robot.
        """
        self._folder, self._notes = path.resolve().parent, {}
        text = read_bytes(path, "URDF", MOST).decode(errors="replace")
        left = re.compile(r"\$\(optenv \S+ ?([^)]*)\)")
        if left.search(text):
            self._note("$(optenv ...) is read as its default")
        self.root = parse(left.sub(r"\1", text), str(path))
        for element in [e for e in self.root if e.tag not in KEPT]:
            self.root.remove(element)
        self._vectors()
        self._meshes()
        self._joints()
        self._tensors()

    @property
    def notes(self) -> list[str]:
        """Cures, each with the names that it was applied to."""
        return [
            f"{text}: {listed(names)}" if names else text for text, names in self._notes.items()
        ]

    def _note(self, text: str, name: str = "") -> None:
        names = self._notes.setdefault(text, [])
        if name and name not in names:
            names.append(name)

    def _named(self, tag: str) -> list[tuple[str, ET.Element]]:
        return [(e.get("name") or "", e) for e in self.root.findall(tag)]

    def _vectors(self) -> None:
        """Commas in vectors, and numbers beyond the third."""
        for element in self.root.iter():
            for key in {"xyz", "rpy", "scale", "size"} & set(element.keys()):
                words = element.get(key).replace(",", " ").split()
                if words != element.get(key).split() or len(words) > 3:
                    self._note(f"{key} {element.get(key)!r} is read as its first three numbers")
                    element.set(key, " ".join(words[:3]))

    def _meshes(self) -> None:
        for name, link in self._named("link"):
            for kind in ("collision", "visual"):
                for shape in link.findall(kind):
                    self._mesh(name, link, shape)

    def _mesh(self, name: str, link: ET.Element, shape: ET.Element) -> None:
        geometry = shape.find("geometry")
        body = None if geometry is None else next(iter(geometry), None)
        path = None
        if body is not None and body.tag == "mesh":
            path = mesh_path(body.get("filename", ""), self._folder)
        if path is not None:
            body.set("filename", str(path.resolve()))
        elif shape.tag == "visual" and (
            body is None or body.tag not in SIZES or body.tag == "mesh"
        ):
            link.remove(shape)
            self._note("without a mesh to draw", name)

    def _joints(self) -> None:
        for name, joint in self._named("joint"):
            kind = joint.get("type")
            if kind == "spherical":
                self._split(joint)
                self._note("ball joints are three hinges each", name)
            elif kind in ("floating", "planar"):
                self._free(name, joint)
            elif kind in ("revolute", "prismatic"):
                self._range(name, joint)

    def _free(self, name: str, joint: ET.Element) -> None:
        """A floating joint under an empty root says that the robot floats; others are fixed."""
        parent = joint.find("parent").get("link") if joint.find("parent") is not None else None
        root = next((e for n, e in self._named("link") if n == parent), None)
        others = [j for _, j in self._named("joint") if j is not joint]
        ends = [j.find(end) for j in others for end in ("parent", "child")]
        alone = all(end is None or end.get("link") != parent for end in ends)
        if root is not None and alone and root.find("inertial") is None:
            self.root.remove(root)
            self.root.remove(joint)
            self._note(f"without the {joint.get('type')} joint to {parent!r}, as any base floats")
            return
        joint.set("type", "fixed")
        self._note("floating and planar joints are fixed", name)

    def _range(self, name: str, joint: ET.Element) -> None:
        limit = joint.find("limit")
        given = {} if limit is None else limit.attrib
        try:
            low, high = (float(given.get(key, 0.0)) for key in ("lower", "upper"))
        except ValueError:
            return
        if {"lower", "upper"} & set(given) and low == high:
            joint.set("type", "fixed")
            self._note("fixed, as the limits are equal", name)
        elif not {"lower", "upper"} & set(given) or low > high:
            if joint.get("type") == "revolute":
                joint.set("type", "continuous")
                self._note("turn without limits, as they name none", name)
                return
            limit = ET.SubElement(joint, "limit") if limit is None else limit
            limit.set("lower", str(-SLIDE))
            limit.set("upper", str(SLIDE))
            self._note(f"slide ±{SLIDE:g} m, as they name no limits", name)

    def _split(self, joint: ET.Element) -> None:
        """Three hinges about x, y and z in place of a ball joint, with feathers in between."""
        name, child = joint.get("name"), joint.find("child")
        if child is None:
            return
        index, last = list(self.root).index(joint), child.get("link")
        parts = [joint]
        for axis, part in (("1 0 0", "x"), ("0 1 0", "y"), ("0 0 1", "z")):
            if part != "x":
                parts.append(ET.Element("joint"))
                ET.SubElement(parts[-1], "parent", link=f"{name}_{parts[-2].get('name')[-1]}")
                ET.SubElement(parts[-1], "child", link=last)
            hinge = parts[-1]
            hinge.set("name", f"{name}_{part}")
            hinge.set("type", "revolute")
            for old in [*hinge.findall("axis"), *hinge.findall("limit")]:
                hinge.remove(old)
            ET.SubElement(hinge, "axis", xyz=axis)
            ET.SubElement(hinge, "limit", lower="-1.5", upper="1.5")
            if part != "z":
                hinge.find("child").set("link", f"{name}_{part}")
                self.root.insert(index, ET.Element("link", name=f"{name}_{part}"))
                _weigh(self.root[index], FEATHER * self.mass())
                index += 1
        for hinge in parts[:0:-1]:
            self.root.insert(index + 1, hinge)

    def mass(self) -> float:
        """Mass of all links [kg]."""
        return added(mass_of(link) for link in self.root.findall("link"))

    def _tensors(self) -> None:
        moved = {
            j.find("child").get("link")
            for j in self.root.findall("joint")
            if j.get("type") in MOVING and j.find("child") is not None
        }
        fixed = {
            j.find("child").get("link")
            for j in self.root.findall("joint")
            if j.find("child") is not None
        } - moved
        for name, link in self._named("link"):
            mass, tensor = mass_of(link), link.find("inertial/inertia")
            if not mass > 0.0:
                continue
            if tensor is None:
                tensor = ET.SubElement(link.find("inertial"), "inertia")
            try:
                values = [float(tensor.get(key, 0.0)) for key in TENSOR]
            except ValueError:
                continue
            if not all(map(math.isfinite, values)):
                continue
            if np.linalg.eigvalsh(inertia_matrix(values))[2] < POINT * mass:
                if name not in fixed:
                    self._solid(name, link, mass, tensor)
                elif any(values):
                    _set_tensor(tensor, np.zeros((3, 3)))
                    self._note("inertia left out, as no body is so small", name)
            elif inertia_fault(values):
                _set_tensor(tensor, possible(values))
                self._note("inertia raised to what a body can have", name)

    def _solid(self, name: str, link: ET.Element, mass: float, tensor: ET.Element) -> None:
        try:
            points = link_points(link, self._folder)
            if not len(points):
                points = link_points(link, self._folder, "visual")
        except (AttributeError, StopIteration, TypeError, ValueError):
            return  # a broken shape, which the check of the URDF names
        moments = solid_inertia(mass, points)
        _set_tensor(tensor, np.diag(moments))
        origin = link.find("inertial/origin")
        if origin is not None:
            origin.attrib.pop("rpy", None)
        self._note("inertia guessed from the shape", name)

    def link(self, name: str) -> ET.Element:
        """Element of a link."""
        return next(e for n, e in self._named("link") if n == name)

    def float_root(self, root: str) -> None:
        """Give the root of a floating robot a mass if it has none."""
        link = self.link(root)
        if mass_of(link) == 0.0:
            _weigh(link, FEATHER * self.mass())
            self._note("massless root weighed with a thousandth of the robot", root)

    def turn_root(self, root: str, rotation: np.ndarray) -> None:
        """Turn the frame of the root link.

        Args:
            root: Name of the root link.
            rotation: Rotation from the old frame to the new one, (3, 3).
        """
        link = self.link(root)
        places = [link.find("inertial"), *link.findall("collision"), *link.findall("visual")]
        places += [j for _, j in self._named("joint") if j.find("parent").get("link") == root]
        for place in places:
            if place is not None:
                _turn_origin(place, rotation)


def possible(values: list[float]) -> np.ndarray:
    """Tensor whose smaller moments are raised until a body can have them, (3, 3)."""
    moments, axes = np.linalg.eigh(inertia_matrix(values))
    moments = np.maximum(moments, 0.0)
    moments[:2] += 0.5 * max(0.0, moments[2] - moments[0] - moments[1]) + 1e-4 * moments[2]
    return axes @ np.diag(moments) @ axes.T


def _set_tensor(element: ET.Element, tensor: np.ndarray) -> None:
    for key, value in zip(TENSOR, tensor[np.triu_indices(3)], strict=True):
        element.set(key, f"{value:.9g}")


def _weigh(link: ET.Element, mass: float) -> None:
    """Give a link the inertia of a ball of 3 cm."""
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value=f"{mass:.9g}")
    _set_tensor(ET.SubElement(inertial, "inertia"), 0.4 * mass * 0.03**2 * np.eye(3))


def _turn_origin(place: ET.Element, rotation: np.ndarray) -> None:
    origin = place.find("origin")
    offset, turn = pose(origin)
    if origin is None:
        origin = ET.Element("origin")
        place.insert(0, origin)
    offset, turn = rotation @ offset, rotation @ turn
    pitch = math.asin(max(-1.0, min(1.0, -turn[2, 0])))
    if abs(turn[2, 0]) < 1.0 - 1e-12:
        roll, yaw = math.atan2(turn[2, 1], turn[2, 2]), math.atan2(turn[1, 0], turn[0, 0])
    else:
        roll, yaw = math.atan2(-turn[1, 2], turn[1, 1]), 0.0
    origin.set("xyz", " ".join(f"{v:.12g}" for v in offset + 0.0))
    origin.set("rpy", " ".join(f"{v:.12g}" for v in (roll, pitch, yaw)))


def listed(names: list[str]) -> str:
    """The first of some names, and how many there are more."""
    shown = ", ".join(names[:4])
    return shown if len(names) <= 4 else f"{shown} and {len(names) - 4} more"
