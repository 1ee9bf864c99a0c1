# SPDX-License-Identifier: Apache-2.0
"""Validation of a URDF before it is passed to an engine.

Engines do not validate their input: duplicate link names crash the process, a physically
impossible inertia is silently ignored, a link without mass gets 1 kg. `problems` lists all such
faults; `check` raises the first.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

import numpy as np

from loco_control.exceptions import LocoError, ParameterError

from ..mesh_files import is_pointer, mesh_path
from ..meshes.read import load

MOVING = ("revolute", "continuous", "prismatic")
TYPES = (*MOVING, "fixed")
TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MAX_SIZE = 64 * 2**20  # largest size of a URDF [bytes]
LARGEST = 1e9  # largest mass [kg], inertia [kg·m²] and length [m]
SMALLEST = 1e-12  # smallest mass other than 0 [kg]
PLACEHOLDER = 1e-7  # mass of the heaviest link under which masses are made up [kg] (taste)
ROUNDING = 1e-6  # tolerance of the triangle inequality of moments, share of the largest one
SIZES = {"box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"),
         "capsule": ("radius", "length"), "mesh": ()}  # fmt: skip


def check(urdf: str, folder: Path, name: str, bolted: bool = False) -> None:
    """Refuse a URDF on which the engine would crash, or which it would misinterpret.

    Args:
        urdf: Text of the URDF.
        folder: Folder of relative mesh files.
        name: File name for the message.
        bolted: Whether the base is fixed to the world, so that its inertia does not matter.

    Raises:
        ParameterError: The URDF has faults; names the file, the first fault and how many more.
    """
    faults = list(problems(parse(urdf, name), folder, bolted))
    if faults:
        suffix = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ParameterError(f"{name}: {faults[0]}{suffix}")


def without_lost_meshes(urdf: str, folder: Path, name: str) -> str:
    """Text without collision shapes whose mesh file is missing, for a robot that touches nothing.

    Args:
        urdf: Text of the URDF.
        folder: Folder of relative mesh files.
        name: Name of the description, for messages.
    """
    root, lost = parse(urdf, name), False
    for link in root.findall("link"):
        for shape in link.findall("collision"):
            mesh = shape.find("geometry/mesh")
            if mesh is not None and mesh_path(mesh.get("filename", ""), folder) is None:
                link.remove(shape)
                lost = True
    return ET.tostring(root, encoding="unicode") if lost else urdf


def parse(urdf: str, name: str = "the robot description") -> ET.Element:
    """Root element of a URDF, ignoring blanks and zero bytes around it.

    Raises:
        ParameterError: The text is not XML or not a robot.
    """
    root = parse_xml(urdf, name)
    if root.tag != "robot":
        raise ParameterError(f"{name}: a URDF starts with <robot>, this one with <{root.tag}>")
    if is_xacro(root):
        raise ParameterError(f"{name} is xacro, which makes a URDF: xacro {name} > robot.urdf")
    return root


def parse_xml(text: str, name: str) -> ET.Element:
    """Root element of an XML text, ignoring blanks and zero bytes around it.

    Undeclared namespace prefixes, as used by extensions for Drake or Gazebo, are declared.

    Raises:
        ParameterError: The text is not XML.
    """
    try:
        return ET.fromstring(_with_namespaces(text.strip("\0\ufeff \t\r\n")))
    except ET.ParseError as error:
        raise ParameterError(f"{name} is not XML: {error}") from None
    except ValueError as error:  # an unknown encoding
        raise ParameterError(f"{name} cannot be read: {error}") from None


@lru_cache(maxsize=8)  # a search parses the same text for each simulation
def _with_namespaces(text: str) -> str:
    """The text with its undeclared namespace prefixes declared."""
    used = set(re.findall(r"[<\s]/?([A-Za-z_][\w.-]*):[\w.-]+[\s/>=]", text)) - {"xmlns", "xml"}
    missing = sorted(prefix for prefix in used if f"xmlns:{prefix}=" not in text)
    declared = "".join(f' xmlns:{prefix}="{prefix}"' for prefix in missing)
    return re.sub(r"<(\w+)", rf"<\1{declared}", text, count=1)


def is_xacro(root: ET.Element) -> bool:
    """Whether a text contains xacro macros that are not expanded."""
    return any("xacro}" in str(element.tag) for element in root.iter())


def problems(root: ET.Element, folder: Path, bolted: bool = False) -> Iterator[str]:
    """Sentences about all faults; faults that make further checks meaningless are listed alone.

    Args:
        root: Element of the robot.
        folder: Folder of relative mesh files.
        bolted: Whether the base is fixed to the world.
    """
    tree = [*_names(root), *_joints(root)] or list(_tree(root))
    if tree:
        yield from tree
        return
    for joint in root.findall("joint"):
        yield from _joint_numbers(joint)
    free = _free_links(root, bolted)
    faults = []
    for link in root.findall("link"):
        faults += _inertial(link, link.get("name") in free)
    yield from faults or _weightless(root, free)
    for link in root.findall("link"):
        name = link.get("name")
        for kind in ("collision", "visual"):
            for shape in link.findall(kind):
                yield from shape_problems(shape, f"link {name!r}", folder, kind == "collision")


def _free_links(root: ET.Element, bolted: bool) -> set[str]:
    """Links with their own degrees of freedom: of moving joints, and the root unless bolted."""
    joints = root.findall("joint")
    children = {j.find("child").get("link") for j in joints}
    moved = {j.find("child").get("link") for j in joints if j.get("type") in MOVING}
    roots = {link.get("name") for link in root.findall("link")} - children
    return moved if bolted else moved | roots


def _names(root: ET.Element) -> Iterator[str]:
    for tag in ("link", "joint"):
        names = [element.get("name") or "" for element in root.findall(tag)]
        if tag == "link" and not names:
            yield "there is no <link>"
        if "" in names:
            yield f"a <{tag}> has no name"
        for name, count in Counter(names).items():
            if name and count > 1:
                yield f"{count} {tag}s are named {name!r}; each needs a name of its own"


def _joints(root: ET.Element) -> Iterator[str]:
    """Faults of type, parent and child of each joint."""
    links = {link.get("name") for link in root.findall("link")}
    joint_of: dict[str, str] = {}
    for joint in root.findall("joint"):
        what, kind = f"joint {joint.get('name')!r}", joint.get("type")
        if kind not in TYPES:
            yield f"{what} is of type {kind!r}; the engine moves {', '.join(TYPES)}"
        connected = {}
        for end in ("parent", "child"):
            element = joint.find(end)
            connected[end] = None if element is None else element.get("link")
            if connected[end] is None:
                yield f'{what} has no <{end} link="...">'
            elif connected[end] not in links:
                yield f"{what}: its {end} {connected[end]!r} is not a link of the robot"
        child = connected["child"]
        if child is not None and child == connected["parent"]:
            yield f"{what} makes link {child!r} its own parent"
        elif child in joint_of:
            yield (
                f"link {child!r} has two parents, by joints {joint_of[child]!r} and "
                f"{joint.get('name')!r}; the engine knows no closed chains"
            )
        elif child is not None:
            joint_of[child] = joint.get("name")


def _tree(root: ET.Element) -> Iterator[str]:
    """Faults of the tree, which needs one root from which all links are reached."""
    parents = {
        joint.find("child").get("link"): joint.find("parent").get("link")
        for joint in root.findall("joint")
    }
    links = [link.get("name") for link in root.findall("link")]
    roots = [name for name in links if name not in parents]
    for name in links:
        path = [name]
        while path[-1] in parents and parents[path[-1]] not in path:
            path.append(parents[path[-1]])
        if path[-1] in parents:
            ring = path[path.index(parents[path[-1]]) :]
            yield f"the links {', '.join(map(repr, ring))} carry each other in a ring"
            return
    if len(roots) > 1:
        yield (
            f"the links {', '.join(map(repr, roots))} hang on nothing; a robot has one root, "
            "fix the others to it by joints of type fixed"
        )


def _joint_numbers(joint: ET.Element) -> Iterator[str]:
    what, kind = f"joint {joint.get('name')!r}", joint.get("type")
    yield from _origin(joint.find("origin"), what)
    if kind not in MOVING:
        return
    axis = joint.find("axis")
    if axis is not None:
        values = _numbers(axis.get("xyz", ""), 3)
        if values is None:
            yield f"{what}: the axis {axis.get('xyz')!r} is not three numbers"
        elif not np.linalg.norm(values) > 1e-9:
            yield f"{what}: an axis of length 0 points nowhere"
    for tag, keys in {"limit": ("effort", "velocity"), "dynamics": ("damping", "friction")}.items():
        element = joint.find(tag)
        for key in () if element is None else keys:
            text = element.get(key)
            value = 0.0 if text is None else _number(text)
            upper = LARGEST if tag == "dynamics" else math.inf
            if not 0.0 <= value <= upper:
                yield f"{what}: {key} must be a number of at least 0, below {upper:g}, got {text!r}"
    limit = joint.find("limit")
    if limit is None and kind != "continuous":
        yield f"{what} is of type {kind!r} and needs a <limit>; `loco robot new` gives it one"
    elif kind != "continuous":
        low, high = (_number(limit.get(key, "0")) for key in ("lower", "upper"))
        if math.isnan(low) or math.isnan(high):
            bounds = " and ".join(repr(limit.get(key)) for key in ("lower", "upper"))
            yield f"{what}: its limits {bounds} are no numbers"
        elif low > high:
            yield f"{what}: its lower limit {low:g} is above its upper limit {high:g}"


def _inertial(link: ET.Element, free: bool) -> Iterator[str]:
    """Faults of mass and inertia, which are required for links in `free`."""
    what, inertial = f"link {link.get('name')!r}", link.find("inertial")
    if inertial is None:
        return
    yield from _origin(inertial.find("origin"), what)
    weight, tensor = inertial.find("mass"), inertial.find("inertia")
    if weight is None or tensor is None:
        missing = "mass" if weight is None else "inertia"
        yield f"{what}: its <inertial> has no <{missing}>"
        return
    mass = _number(weight.get("value", "0"))
    if not (mass == 0.0 or SMALLEST <= mass <= LARGEST):
        allowed = f"0, or in {SMALLEST:g} to {LARGEST:g} kg"
        yield f"{what}: its mass must be {allowed}, got {weight.get('value')!r}"
        return
    values = {key: _number(tensor.get(key, "0")) for key in TENSOR}
    for key, value in values.items():
        if not abs(value) <= LARGEST:
            allowed = f"a number of at most {LARGEST:g}"
            yield f"{what}: {key} of its inertia must be {allowed}, got {tensor.get(key)!r}"
            return
    if mass == 0.0 or (not any(values.values()) and not free):
        return
    fault = inertia_fault([values.get(key, 0.0) for key in TENSOR])
    if fault:
        yield f"{what}: {fault}; `loco robot new` mends it"


def _weightless(root: ET.Element, free: set[str]) -> Iterator[str]:
    """Faults of moving links without any mass, and of a floating root without mass."""
    masses = {link.get("name"): mass_of(link) for link in root.findall("link")}
    parents = {
        joint.find("child").get("link"): joint.find("parent").get("link")
        for joint in root.findall("joint")
    }
    total = dict(masses)
    for name, mass in masses.items():
        while name in parents:
            name = parents[name]
            total[name] += mass
    if free and not any(masses.values()):
        yield "no link of it has a mass: it is a drawing, and moves once links have an <inertial>"
        return
    if free and 0.0 < (heaviest := max(masses.values())) < PLACEHOLDER:
        yield (
            f"its heaviest link weighs {heaviest:g} kg: its masses are placeholders, as exporters "
            "write them where no part has a material; give the links their masses"
        )
        return
    for name in masses:
        if name in free and (total[name] == 0.0 or (name not in parents and masses[name] == 0.0)):
            moves = "moves" if name in parents else "is the root of a robot that is not bolted"
            mend = "`loco robot new` mends that" if name not in parents else "give it an <inertial>"
            yield f"link {name!r} {moves} but has no mass; {mend}"


def mass_of(link: ET.Element) -> float:
    """Mass of a link [kg], 0 if it is missing or not a number."""
    weight = link.find("inertial/mass")
    mass = 0.0 if weight is None else _number(weight.get("value", "0"))
    return mass if math.isfinite(mass) else 0.0


def inertia_matrix(tensor: Sequence[float]) -> np.ndarray:
    """Symmetric matrix, (3, 3), from the six values named in `TENSOR`."""
    ixx, ixy, ixz, iyy, iyz, izz = tensor
    return np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]])


def inertia_fault(tensor: list[float]) -> str:
    """Reason why an inertia tensor is physically impossible, "" if it is possible.

    Args:
        tensor: ixx, ixy, ixz, iyy, iyz, izz [kg·m²].
    """
    moments = np.linalg.eigvalsh(inertia_matrix(tensor))
    if not moments[2] > 0.0:
        return "it has mass but no inertia" if moments[0] == 0.0 else "its inertia is negative"
    if moments[0] < -ROUNDING * moments[2]:
        return f"its inertia is not positive, it has a moment of {moments[0]:.3g} kg·m²"
    if moments[2] > (moments[0] + moments[1]) + ROUNDING * moments[2]:
        return (
            f"no body has its moments of inertia {moments[0]:.4g}, {moments[1]:.4g} and "
            f"{moments[2]:.4g} kg·m²: the largest exceeds the sum of the others"
        )
    return ""


def shape_problems(shape: ET.Element, what: str, folder: Path, collides: bool) -> Iterator[str]:
    """Sentences about faults of a shape's geometry; visual meshes may be missing.

    Args:
        shape: Element ``collision`` or ``visual``.
        what: Owner of the shape, such as "link 'base'", at the beginning of sentences.
        folder: Folder of relative mesh files.
        collides: Whether the shape is a collision shape.
    """
    yield from _origin(shape.find("origin"), what)
    geometry = shape.find("geometry")
    body = None if geometry is None else next(iter(geometry), None)
    if body is None or body.tag not in SIZES:
        tags = ", ".join(SIZES)
        yield f"{what}: its <{shape.tag}> needs a <geometry> with one of {tags}"
        return
    for key in SIZES[body.tag]:
        values = _numbers(body.get(key, ""), 3 if key == "size" else 1)
        point = body.tag == "sphere" and values is not None and values[0] == 0.0  # a toe
        if values is None or not (np.all(values > 0.0) or point):
            yield f"{what}: {key} of its {body.tag} must be above 0, got {body.get(key)!r}"
    if body.tag == "mesh":
        scale = _numbers(body.get("scale", "1 1 1"), 3)
        if scale is None or not np.all(scale):
            yield f"{what}: the scale {body.get('scale')!r} of its mesh is not three numbers but 0"
        if collides:
            yield from _mesh(body.get("filename", ""), what, folder)


def _mesh(filename: str, what: str, folder: Path) -> Iterator[str]:
    path = mesh_path(filename, folder)
    if path is None:
        yield f"{what}: there is no mesh file {filename!r}"
        return
    if is_pointer(path):
        yield f"{what}: {path} is a pointer of Git LFS in place of the mesh: git lfs pull"
        return
    try:
        load(path)
    except LocoError as error:
        yield f"{what}: {error}"


def _origin(origin: ET.Element | None, what: str) -> Iterator[str]:
    for key in () if origin is None else ("xyz", "rpy"):
        if _numbers(origin.get(key, "0 0 0"), 3) is None:
            yield f"{what}: {key} {origin.get(key)!r} of an origin is not three numbers"


def _number(text: str) -> float:
    """A number; NaN if the text is not a number, or only in Python syntax, such as ``1_0``."""
    try:
        return float(text) if text.isascii() and "_" not in text else math.nan
    except ValueError:
        return math.nan


def _numbers(text: str, count: int) -> np.ndarray | None:
    """Numbers of an attribute; None unless there are `count`, all of magnitude up to `LARGEST`."""
    values = np.array([_number(token) for token in text.split()])
    return values if len(values) == count and np.all(np.abs(values) <= LARGEST) else None
