# SPDX-License-Identifier: Apache-2.0
"""Repair of common small faults in robot files, each with a note.

Faults without an obvious repair (duplicate link names, negative masses) are left for `urdf_check`,
which refuses them.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from ..robot.frames import origin_of, set_pose
from ..robot.urdf_check import mass_of
from . import geometry, joints, units, weight
from .notes import Notes
from .read import read


class Tidied:
    """A repaired URDF.

    Attributes:
        root: Element of the robot: links, joints and materials, meshes by absolute path.
        rotors: Joint properties of an MJCF that a URDF cannot hold.
    """

    def __init__(self, path: Path):
        """Read and repair a robot.

        Raises:
            ParameterError: The file is not a readable robot description.
        """
        self._notes, self._suspects = Notes(), Notes()
        self.root, self.rotors = read(path, self._notes)
        folder = path.resolve().parent
        self._vectors()
        geometry.cure(self.root, folder, self._notes)
        units.check(self.root, folder, self._notes, self._suspects)
        joints.cure(self.root, self._notes)
        weight.cure(self.root, folder, self._notes)

    @property
    def notes(self) -> list[str]:
        """Suspected units, then repairs with the names of the repaired links or joints."""
        return [*self.suspects, *self._notes.sentences()]

    @property
    def suspects(self) -> list[str]:
        """Units of the file that are probably others, which most other faults follow from."""
        return self._suspects.sentences()

    def _vectors(self) -> None:
        """Remove commas from vectors, and numbers after the third."""
        for element in self.root.iter():
            for key in {"xyz", "rpy", "scale", "size"} & set(element.keys()):
                numbers = element.get(key).replace(",", " ").split()
                if numbers != element.get(key).split() or len(numbers) > 3:
                    text = f"{key} {element.get(key)!r} is read as its first three numbers"
                    self._notes.add(text)
                    element.set(key, " ".join(numbers[:3]))

    def mass(self) -> float:
        """Mass of all links [kg]."""
        return weight.robot_mass(self.root)

    def link(self, name: str) -> ET.Element:
        """Element of a link."""
        return next(e for e in self.root.findall("link") if e.get("name") == name)

    def float_root(self, root: str) -> None:
        """Give the massless root of a floating robot a mass."""
        link = self.link(root)
        if mass_of(link) == 0.0:
            weight.weigh(link, weight.FEATHER * self.mass())
            self._notes.add("massless root weighed with a thousandth of the robot", root)

    def turn_root(self, root: str, rotation: np.ndarray) -> None:
        """Rotate the frame of the root link.

        Args:
            root: Name of the root link.
            rotation: Rotation from the old frame to the new one, (3, 3).
        """
        link = self.link(root)
        elements = [link.find("inertial"), *link.findall("collision"), *link.findall("visual")]
        elements += [j for j in self.root.findall("joint") if j.find("parent").get("link") == root]
        for place in elements:
            if place is not None:
                _turn_origin(place, rotation)


def _turn_origin(place: ET.Element, rotation: np.ndarray) -> None:
    origin = place.find("origin")
    turn, offset = origin_of(place)
    if origin is None:
        origin = ET.Element("origin")
        place.insert(0, origin)
    set_pose(origin, rotation @ offset, rotation @ turn)
