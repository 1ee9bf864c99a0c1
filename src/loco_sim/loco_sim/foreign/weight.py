# SPDX-License-Identifier: Apache-2.0
"""Repair of masses and inertias of imported robots that are zero or physically impossible.

Links at the end of a limb with zero or negligible mass cannot be simulated behind a joint: their
joints are locked. A massless link within a limb, as between the two axes of a universal joint,
gets a small mass.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from ..geometry import added
from ..robot.urdf_check import MOVING, TENSOR, inertia_fault, inertia_matrix, mass_of
from .notes import Notes
from .shapes import link_points, solid_inertia

POINT = 1e-9  # inertia per mass below which a tensor counts as missing, a body of 0.03 mm [m²]
FEATHER = 1e-3  # mass given to a massless link, share of the robot's mass
MOST_LINKS = 127  # limit of PyBullet
DUST = 1e-5  # negligible mass behind a joint, share of the robot's mass


def robot_mass(root: ET.Element) -> float:
    """Mass of all links [kg]."""
    return added(mass_of(link) for link in root.findall("link"))


def weigh(link: ET.Element, mass: float) -> None:
    """Set the mass of a link [kg] and the inertia of a ball of 3 cm."""
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value=f"{mass:.9g}")
    _set_tensor(ET.SubElement(inertial, "inertia"), 0.4 * mass * 0.03**2 * np.eye(3))


def cure(root: ET.Element, folder: Path, notes: Notes) -> None:
    """Lock joints of massless links, and give the other links possible inertias.

    Args:
        root: Element of the robot, changed in place.
        folder: Folder of relative mesh files.
        notes: Collects what was changed.
    """
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is not None and inertial.find("mass") is None:
            link.remove(inertial)
            notes.add("without an inertia, as it names no mass", link.get("name") or "")
    _merge(root, notes)
    _frames(root, notes)
    moved = {_child(j) for j in root.findall("joint") if j.get("type") in MOVING}
    fixed = {_child(j) for j in root.findall("joint")} - moved
    for link in root.findall("link"):
        if mass_of(link) > 0.0:
            _tensor(link, folder, (link.get("name") or "") in fixed, notes)


def _child(joint: ET.Element) -> str | None:
    return None if joint.find("child") is None else joint.find("child").get("link")


def _merge(root: ET.Element, notes: Notes) -> None:
    """Lock joints that move negligible masses, and give light links between joints a mass."""
    links = {link.get("name"): link for link in root.findall("link")}
    above = {_child(j): j for j in root.findall("joint") if j.find("parent") is not None}
    if len(links) != len(root.findall("link")) or len(above) != len(root.findall("joint")):
        return  # invalid names or parents, which the check of the URDF refuses
    dust, body, moved_mass = DUST * robot_mass(root), dict.fromkeys(links, 0.0), {}
    for name, link in links.items():
        mass, fixed, at = mass_of(link), True, name
        if mass < 0.0:
            return
        body[at] += mass
        passed = {at}
        while at in above:
            joint, parent = above[at], above[at].find("parent").get("link")
            moved_mass[at] = moved_mass.get(at, 0.0) + mass
            fixed &= joint.get("type") not in MOVING
            if parent in passed or parent not in links:
                return
            at = parent
            passed.add(at)
            if fixed:
                body[at] += mass
    for name, joint in above.items():
        if joint.get("type") not in MOVING or name not in links or not dust > 0.0:
            continue
        what = "nothing" if moved_mass[name] == 0.0 else "dust"
        if moved_mass[name] <= dust:
            joint.set("type", "fixed")
            for extra in [*joint.findall("mimic"), *joint.findall("limit")]:
                joint.remove(extra)
            notes.add(f"locked, as what they move weighs {what}", joint.get("name") or "")
        elif body[name] <= dust:
            weigh(links[name], FEATHER * robot_mass(root))
            notes.add("massless between two joints, weighed with a thousandth of the robot", name)


def _frames(root: ET.Element, notes: Notes) -> None:
    """Remove massless links without shapes if there are too many links for the engine.

    Links at the ends are removed first, then their parents.
    """
    links = {link.get("name") or "": link for link in root.findall("link")}
    removable = True
    while len(links) > MOST_LINKS and removable:
        joints = root.findall("joint")
        carrying = {j.find("parent").get("link") for j in joints if j.find("parent") is not None}
        removable = [
            (name, joint)
            for joint in joints
            if joint.get("type") == "fixed" and (name := _child(joint) or "") in links
            and name not in carrying and mass_of(links[name]) == 0.0
            and links[name].find("collision") is None and links[name].find("visual") is None
        ]  # fmt: skip
        for name, joint in removable:
            root.remove(joint)
            root.remove(links.pop(name))
            notes.add(f"frames are left out, as PyBullet takes {MOST_LINKS} links", name)


def _tensor(link: ET.Element, folder: Path, fixed: bool, notes: Notes) -> None:
    """Give a link with mass a physically possible inertia."""
    name, mass, tensor = link.get("name") or "", mass_of(link), link.find("inertial/inertia")
    if tensor is None:
        tensor = ET.SubElement(link.find("inertial"), "inertia")
    try:
        values = [float(tensor.get(key, 0.0)) for key in TENSOR]
    except ValueError:
        return
    if not all(map(math.isfinite, values)):
        return
    if np.linalg.eigvalsh(inertia_matrix(values))[2] < POINT * mass:
        if not fixed:
            _solid(link, folder, tensor, notes)
        elif any(values):
            _set_tensor(tensor, np.zeros((3, 3)))
            notes.add("inertia left out, as no body is so small", name)
    elif inertia_fault(values):
        _set_tensor(tensor, possible(values))
        notes.add("inertia raised to what a body can have", name)


def _solid(link: ET.Element, folder: Path, tensor: ET.Element, notes: Notes) -> None:
    try:
        points = link_points(link, folder)
        if not len(points):
            points = link_points(link, folder, "visual")
    except (AttributeError, StopIteration, TypeError, ValueError):
        return  # a broken shape, reported by the check of the URDF
    _set_tensor(tensor, np.diag(solid_inertia(mass_of(link), points)))
    origin = link.find("inertial/origin")
    if origin is not None:
        origin.attrib.pop("rpy", None)
    notes.add("inertia guessed from the shape", link.get("name") or "")


def possible(values: list[float]) -> np.ndarray:
    """Inertia tensor, (3, 3), with its smaller moments raised until it is physically possible."""
    moments, axes = np.linalg.eigh(inertia_matrix(values))
    moments = np.maximum(moments, 0.0)
    moments[:2] += 0.5 * max(0.0, moments[2] - moments[0] - moments[1]) + 1e-4 * moments[2]
    return axes @ np.diag(moments) @ axes.T


def _set_tensor(element: ET.Element, tensor: np.ndarray) -> None:
    for key, value in zip(TENSOR, tensor[np.triu_indices(3)], strict=True):
        element.set(key, f"{value:.9g}")
