# SPDX-License-Identifier: Apache-2.0
"""Consistency check of the units of a robot (m, kg, kg·m², rad).

A body of mass m with a bounding box of diagonal d has a moment of inertia of at most m d² / 4, and
a density between foam and lead. If most links are far outside, the file uses other units, which is
noted with the likely unit. Only meshes in mm are scaled, as other lengths show the right size.
"""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..robot.frames import numbers
from ..robot.urdf_check import TENSOR, inertia_matrix, mass_of
from .notes import Notes
from .shapes import link_points

LARGE = 10.0  # lengths beyond this are not in m [m]
MESH_RATIO = 30.0  # ratio of the size of a mesh in mm to all other lengths
MILLI = 1e-3
SHARE = 0.15  # typical moment of inertia / (m d² / 4)
IMPOSSIBLE = 3.0  # impossible value of the same ratio
WRONG = 30.0  # value of the same ratio at which an inertia is noted: 1000 SHARE is g·m²
DENSE = 3e4  # density of the bounding box of a link: heavier than lead [kg/m³]
BULKY = 2e4  # mass / cube of the largest length, for a robot without shapes [kg/m³]
FILLERS = 3  # links with equal, impossible moments: placeholders
# number of units per kg·m²
UNITS = {1e3: "g·m²", 1e4: "kg·cm²", 1e6: "kg·mm²", 1e7: "g·cm²", 1e9: "g·mm²"}
LENGTHS = {1e3: "mm", 1e2: "cm"}  # number of units per m
THIN = 1e-2  # mass / cube of the largest joint distance: thinner than air [kg/m³]
USUAL_LENGTH, USUAL_DENSITY = 0.3, 200.0  # joint distance [m] and mass / its cube [kg/m³] (taste)
DEGREES = 4.0 * np.pi, 720.0  # range of limits of hinges that are more likely degrees [rad]


@dataclass(frozen=True)
class Size:
    """Lengths of a link according to different parts of the file.

    Attributes:
        name: Name of the link.
        mass: Mass [kg].
        moment: Largest moment of inertia [kg·m²].
        written: Moment of inertia in the file [kg·m²] if equal about all axes, else NaN.
        box: Sides of the box around its shapes [m], (3,); zeros without shapes.
        joints: Largest distance of a joint on it from its origin [m].
    """

    name: str
    mass: float
    moment: float
    written: float
    box: np.ndarray
    joints: float

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box, at least the distance of its joints [m]."""
        return max(float(np.linalg.norm(self.box)), self.joints)


def check(root: ET.Element, folder: Path, notes: Notes, suspects: Notes) -> None:
    """Scale meshes that are in mm, and note numbers in other units.

    Args:
        root: Element of the robot; the scale of meshes is changed in place.
        folder: Folder of relative mesh files.
        notes: Collects changes and findings of single links.
        suspects: Collects units of the whole file that are probably others.
    """
    try:
        _meshes(root, folder, notes)
        sizes = [_size(root, link, folder) for link in root.findall("link")]
        limits = {kind: _largest_limits(root, kind) for kind in ("revolute", "prismatic")}
    except (AttributeError, IndexError, StopIteration, TypeError, ValueError):
        return  # not a number; reported by the check of the URDF
    sizes = [size for size in sizes if size.mass > 0.0 and np.isfinite(size.moment)]
    mass_scale = 1e3 if _masses(sizes, suspects) else 1.0
    length_scale, mass_scale = _lengths(sizes, suspects) or (1.0, mass_scale)
    scaled = [
        replace(size, mass=size.mass / mass_scale, box=size.box / length_scale,
                joints=size.joints / length_scale)
        for size in sizes
    ]  # fmt: skip
    _inertias(scaled, notes, suspects)
    longest = max(LARGE, MESH_RATIO * max((size.diagonal for size in scaled), default=0.0))
    _ranges(limits["revolute"], *DEGREES, "rad", ("joint limits in degrees", "by 57.3"), suspects)
    _ranges(limits["prismatic"], longest, np.inf, "m", ("slides in mm", "by 1000"), suspects)


def factors(root: ET.Element, folder: Path) -> tuple[float, str, float]:
    """Numbers per kg of masses, unit of inertias, and numbers of it per kg·m², of a description.

    They are 1, and the unit empty, where the file is in kg and kg·m², or does not tell.

    Args:
        root: Element of the robot.
        folder: Folder of relative mesh files.
    """
    sizes = [_size(root, link, folder) for link in root.findall("link")]
    sizes = [size for size in sizes if size.mass > 0.0 and np.isfinite(size.moment)]
    masses = 1e3 if _masses(sizes, Notes()) else 1.0
    ratio = _ratios([replace(size, mass=size.mass / masses) for size in sizes], Notes())
    unit = _unit(float(np.median(list(ratio.values())))) if ratio else 0.0
    return masses, UNITS.get(unit, ""), unit or 1.0


def _joint_reach(root: ET.Element, link: str) -> float:
    """Largest distance of a joint on a link from its origin [m]."""
    child_joints = [j for j in root.findall("joint") if j.find("parent").get("link") == link]
    offsets = [numbers(joint.find("origin"), "xyz", "0 0 0") for joint in child_joints]
    return max((float(np.linalg.norm(place)) for place in offsets), default=0.0)


def _moment(link: ET.Element) -> float:
    """Largest moment of inertia of a link [kg·m²], 0 if it has none."""
    tensor = link.find("inertial/inertia")
    if tensor is None:
        return 0.0
    return float(np.linalg.eigvalsh(inertia_matrix([float(tensor.get(k, 0.0)) for k in TENSOR]))[2])


def _size(root: ET.Element, link: ET.Element, folder: Path) -> Size:
    points = link_points(link, folder)
    points = points if len(points) else link_points(link, folder, "visual")
    box = np.ptp(points, axis=0) if len(points) else np.zeros(3)
    name = link.get("name") or ""
    tensor = link.find("inertial/inertia")
    axes = {0.0} if tensor is None else {float(tensor.get(k, 0.0)) for k in ("ixx", "iyy", "izz")}
    written = axes.pop() if len(axes) == 1 else np.nan
    return Size(name, mass_of(link), _moment(link), written, box, _joint_reach(root, name))


def _meshes(root: ET.Element, folder: Path, notes: Notes) -> None:
    """Scale meshes that are far larger than all other lengths of the robot."""
    meshes = [
        (link, shape, shape.find("geometry/mesh"))
        for link in root.findall("link")
        for kind in ("collision", "visual")
        for shape in link.findall(kind)
        if shape.find("geometry/mesh") is not None
    ]
    lengths = [_joint_reach(root, link.get("name") or "") for link in root.findall("link")]
    for link in root.findall("link"):
        mass, place = mass_of(link), link.find("inertial/origin")
        lengths.append(float(np.linalg.norm(numbers(place, "xyz", "0 0 0"))))
        lengths.append(float(np.sqrt(abs(_moment(link)) / mass)) if mass > 0.0 else 0.0)
    usual = max((length for length in lengths if 0.0 < length < LARGE), default=0.0)
    long = {}
    for _, shape, mesh in meshes:
        holder = ET.Element("link")
        holder.append(shape)
        points = link_points(holder, folder, shape.tag)
        long[mesh] = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    largest = max(long.values(), default=0.0)
    if not (usual > 0.0 and largest > max(LARGE, MESH_RATIO * usual)):
        return
    for link, _, mesh in meshes:
        if long[mesh] > 3.0 * usual:
            scale = [float(number) for number in mesh.get("scale", "1 1 1").split()]
            mesh.set("scale", " ".join(f"{MILLI * value:.9g}" for value in scale))
            notes.add(
                f"meshes are taken to be in mm (scale {MILLI:g}), as they are up to "
                f"{largest:.3g} m long where all else is within {usual:.2g} m",
                link.get("name") or "",
            )


def _lengths(sizes: list[Size], suspects: Notes) -> tuple[float, float] | None:
    """Factors by which lengths and masses are too large; None if lengths are in m.

    Of all units of both, those are taken with which size and density are most usual.
    """
    total, length = sum(size.mass for size in sizes), max((s.joints for s in sizes), default=0.0)
    if not (length > LARGE and 0.0 < total < THIN * length**3):
        return None

    def unusual(length_scale: float, mass_scale: float) -> float:
        density = total / mass_scale / (length / length_scale) ** 3 / USUAL_DENSITY
        return abs(np.log(density)) / 3.0 + abs(np.log(length / length_scale / USUAL_LENGTH))

    length_scale, mass_scale = min(
        itertools.product(LENGTHS, (1.0, 1e3)), key=lambda units: unusual(*units)
    )
    masses = (" and masses in g", " and all masses by 1000") if mass_scale > 1.0 else ("", "")
    suspects.add(
        f"lengths in {LENGTHS[length_scale]}{masses[0]}? Joints are {length:.4g} m apart in a "
        f"robot of {total:.4g} kg; if so, divide all lengths by {length_scale:.4g}{masses[1]}"
    )
    return length_scale, mass_scale


def _largest_limits(root: ET.Element, kind: str) -> dict[str, float]:
    """Largest limit of each joint of a type that has limits [rad or m]."""
    largest = {}
    for joint in root.findall("joint"):
        limit = joint.find("limit") if joint.get("type") == kind else None
        values = [0.0 if limit is None else float(limit.get(k, 0.0)) for k in ("lower", "upper")]
        largest[joint.get("name") or ""] = max(map(abs, values))
    return {name: value for name, value in largest.items() if value > 0.0}


def _ranges(
    limits: dict[str, float], low: float, high: float, unit: str, labels: tuple[str, str],
    suspects: Notes,
) -> None:  # fmt: skip
    """Note limits of joints in another unit, if most are in a range that joints do not have.

    Args:
        limits: Largest limit of each joint [rad or m].
        low: Start of that range.
        high: End of that range, above which limits mean none.
        unit: Unit of these.
        labels: The other unit, and by what to divide.
        suspects: Collects the finding.
    """
    outside = {name: end for name, end in limits.items() if low < end <= high}
    if 2 * len(outside) > len(limits):
        name = max(outside, key=outside.get)
        sentence = f"{labels[0]}? {name} moves up to {outside[name]:.4g} {unit}"
        suspects.add(f"{sentence}; if so, divide them {labels[1]}")


def _masses(sizes: list[Size], suspects: Notes) -> bool:
    """Whether masses are in g, which is noted."""
    boxed = [size for size in sizes if size.box.min() > 0.0]
    total = sum(size.mass for size in sizes)
    if boxed:
        dense = float(np.median([size.mass / size.box.prod() for size in boxed]))
        heaviest = max(boxed, key=lambda size: size.mass)
        length, limit = float(np.linalg.norm(heaviest.box)), DENSE
        what = f"{heaviest.name} weighs {heaviest.mass:.4g} kg at a length of {length:.2g} m"
    else:
        length = max((size.joints for size in sizes), default=0.0)
        dense, limit = (total / length**3 if length > 0.0 else 0.0), BULKY
        what = f"the robot weighs {total:.4g} kg with joints {length:.2g} m apart"
    if not dense > limit:
        return False
    suspects.add(f"masses in g? {what}, {dense:.2g} kg/m³; if so, divide all masses by 1000")
    return True


def _inertias(sizes: list[Size], notes: Notes, suspects: Notes) -> None:
    """Note inertias in other units, implausible inertias of single links, and placeholders of 1.

    Args:
        sizes: Links with a mass, in kg and m.
        notes: Collects findings of single links.
        suspects: Collects another unit of all inertias.
    """
    ratio = _ratios(sizes, notes)
    if not ratio:
        return
    middle = float(np.median(list(ratio.values())))
    if unit := _unit(middle):
        suspects.add(
            f"inertias in {UNITS[unit]}? They are {middle:.2g} times m d²/4 of the links, of which "
            f"no body has more than 1; if so, divide them by {unit:.0e}".replace("e+0", "e")
        )
        return
    for name, value in ratio.items():
        if value > WRONG:
            notes.add("an inertia far beyond what a body of that size and mass can have", name)


def _unit(middle: float) -> float:
    """Number of units per kg·m² of inertias that are so many times m d²/4; 0 for kg·m²."""
    if not middle > WRONG:
        return 0.0
    return min(UNITS, key=lambda times: abs(np.log10(middle / times / SHARE)))


def _ratios(sizes: list[Size], notes: Notes) -> dict[str, float]:
    """Moment of inertia over m d²/4 of each link, without placeholders, which are noted."""
    usable = [size for size in sizes if size.diagonal > 0.0 and size.moment > 0.0]
    ratio = {s.name: s.moment / (s.mass * s.diagonal**2 / 4.0) for s in usable}
    repeated = Counter(size.written for size in usable if size.written == size.written)
    for size in usable:
        filler = size.written == 1.0 or repeated[size.written] >= FILLERS
        if filler and ratio[size.name] > IMPOSSIBLE:
            text = f"an inertia of {size.written:g} kg·m² about each axis fills a gap of the file"
            notes.add(text, size.name)
            del ratio[size.name]
    return ratio
