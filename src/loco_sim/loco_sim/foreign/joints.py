# SPDX-License-Identifier: Apache-2.0
"""Repair of joints of imported robots: unsupported joint types are replaced, with a note."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from ..robot.frames import lock
from ..robot.urdf_check import LARGEST, mass_of
from .notes import Notes
from .weight import FEATHER, robot_mass, weigh

WORLDS = ("world", "map", "odom", "ground")
SLIDE = 1.0  # range to each side of a prismatic joint without limits [m]


def cure(root: ET.Element, notes: Notes) -> None:
    """Give each joint a supported type and a valid range.

    Args:
        root: Element of the robot, changed in place.
        notes: Collects what was changed.
    """
    names = {joint.get("name") for joint in root.findall("joint")}
    for joint in root.findall("joint"):
        kind, name = joint.get("type"), joint.get("name") or ""
        for mimic in joint.findall("mimic"):
            if (leader := mimic.get("joint")) not in names - {name}:
                joint.remove(mimic)
                notes.add(f"moved alone, as its <mimic> names {leader!r}, which is no joint", name)
        if kind == "spherical":
            _split(root, joint)
            notes.add("ball joints are three hinges each", name)
        elif kind in ("floating", "planar"):
            _free(root, joint, notes)
        elif kind in ("revolute", "prismatic"):
            _range(joint, notes)


def _end(joint: ET.Element, end: str) -> str | None:
    element = joint.find(end)
    return None if element is None else element.get("link")


def _free(root: ET.Element, joint: ET.Element, notes: Notes) -> None:
    """Remove a floating joint at a massless root (the base floats anyway); lock others."""
    kind, name, parent = joint.get("type"), joint.get("name") or "", _end(joint, "parent")
    link = next((e for e in root.findall("link") if e.get("name") == parent), None)
    other_joints = [j for j in root.findall("joint") if j is not joint]
    is_isolated = all(parent != _end(j, end) for j in other_joints for end in ("parent", "child"))
    if link is not None and is_isolated and mass_of(link) == 0.0:
        root.remove(link)
        root.remove(joint)
        reason = "as a base that stands floats without it"
        notes.add(f"without the {kind} joint {name!r} to {parent!r}, {reason}")
        return
    joint.set("type", "fixed")
    notes.add(f"locked, as no drive moves a {kind} joint", name)


def _range(joint: ET.Element, notes: Notes) -> None:
    limit, name = joint.find("limit"), joint.get("name") or ""
    attributes = {} if limit is None else limit.attrib
    bounds = {"lower", "upper"} & set(attributes)
    try:
        low, high = (float(attributes.get(key, 0.0)) for key in ("lower", "upper"))
        dynamics = joint.findall("dynamics")
        drag = [float(e.get(k, 0.0)) for e in dynamics for k in ("damping", "friction")]
    except ValueError:
        return
    if max(drag, default=0.0) > LARGEST:  # some authors lock a joint in this way
        lock(joint, 0.0)
        notes.add("locked, as a damping or friction that no drive overcomes holds them", name)
    elif bounds and low == high != 0.0:
        lock(joint, low)
        notes.add("locked, as the limits are equal", name)
    elif not bounds or low >= high:
        reason = "name none" if not bounds else "are 0" if low == high else "are crossed"
        if joint.get("type") == "revolute":
            joint.set("type", "continuous")
            notes.add(f"turn without limits, as they {reason}", name)
            return
        limit = ET.SubElement(joint, "limit") if limit is None else limit
        limit.set("lower", str(-SLIDE))
        limit.set("upper", str(SLIDE))
        notes.add(f"slide ±{SLIDE:g} m, as their limits {reason}", name)
    elif len(bounds) == 1:
        notes.add(f"a limit that is not named is read as 0 ({low:g} to {high:g})", name)


def _split(root: ET.Element, joint: ET.Element) -> None:
    """Replace a ball joint by three hinges about x, y and z, with light links in between."""
    name, last = joint.get("name"), _end(joint, "child")
    if last is None:
        return
    index, parts = list(root).index(joint), [joint]
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
            root.insert(index, ET.Element("link", name=f"{name}_{part}"))
            weigh(root[index], FEATHER * robot_mass(root))
            index += 1
    for hinge in parts[:0:-1]:
        root.insert(index + 1, hinge)
