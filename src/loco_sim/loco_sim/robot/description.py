# SPDX-License-Identifier: Apache-2.0
"""Editable URDF, from which the world is built."""

from __future__ import annotations

import copy
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError

from ..geometry import added
from ..mesh_files import mesh_path
from .frames import fixed_axes, lock, numbers
from .urdf_check import TENSOR, inertia_matrix, mass_of, parse


def add_point_mass(
    mass: float, com: np.ndarray, inertia: np.ndarray, extra: float, position: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia of a body with a point mass fixed to it.

    I' = I + m d(c - c') + m_extra d(r - c') with d(v) = |v|² 1 - v vᵀ (parallel axes).

    Args:
        mass: Mass of the body [kg].
        com: Centre of mass [m], (3,).
        inertia: Inertia about `com` [kg·m²], (3, 3).
        extra: Mass to add [kg].
        position: Position of the added mass [m], (3,), in the frame of `com`.
    """
    total = mass + extra
    if extra == 0.0:
        return mass, com, inertia
    new_com = (mass * com + extra * position) / total

    def shift(v: np.ndarray) -> np.ndarray:
        return v @ v * np.eye(3) - np.outer(v, v)

    moved = inertia + mass * shift(com - new_com) + extra * shift(position - new_com)
    return total, new_com, moved


class Description:
    """Access by name to the parts of a URDF that affect physics, for reading and editing."""

    def __init__(self, urdf: str):
        """Parse a URDF.

        Raises:
            ParameterError: The text is not XML or not a robot.
        """
        self._root = parse(urdf)

    def links(self) -> list[str]:
        """Names of the links, in the order of the file."""
        return [link.get("name", "") for link in self._root.iter("link")]

    def elements(self, tag: str) -> list[ET.Element]:
        """All links or joints of the robot, read-only."""
        return self._root.findall(tag)

    def root_link(self) -> str:
        """Name of the link without a parent."""
        children = {child.get("link") for child in self._root.iter("child")}
        return next(name for name in self.links() if name not in children)

    def below(self, link: str) -> list[str]:
        """A link and all its descendants, itself first."""
        self._find("link", link)
        links = [link]
        for name in links:  # grows during the iteration
            for joint in self._root.findall("joint"):
                if joint.find("parent").get("link") == name:
                    links.append(joint.find("child").get("link"))
        return links

    def above(self, link: str) -> list[str]:
        """Joints between a link and the root link, from the link upwards."""
        self._find("link", link)
        joints = {j.find("child").get("link"): j for j in self._root.findall("joint")}
        chain = []
        while (joint := joints.pop(link, None)) is not None:  # terminates for a loop of joints, too
            chain.append(joint.get("name", ""))
            link = joint.find("parent").get("link")
        return chain

    def efforts(self) -> dict[str, float]:
        """Torque limit [N·m] of each moving joint; infinite if the URDF has none."""
        limits = {}
        for joint in self._root.findall("joint"):
            if joint.get("type") in ("revolute", "continuous", "prismatic"):
                limit = joint.find("limit")
                effort = None if limit is None else limit.get("effort")
                limits[joint.get("name", "")] = math.inf if effort is None else float(effort)
        return limits

    def damping(self, joint: str) -> float:
        """Viscous damping of a joint [N·m·s/rad]."""
        return self._dynamics(joint, "damping")

    def friction(self, joint: str) -> float:
        """Dry friction of a joint [N·m or N]."""
        return self._dynamics(joint, "friction")

    def _dynamics(self, joint: str, key: str) -> float:
        dynamics = self._find("joint", joint).find("dynamics")
        return 0.0 if dynamics is None else float(dynamics.get(key, 0.0))

    def joint_types(self) -> dict[str, str]:
        """Type of each moving joint."""
        moving = ("revolute", "continuous", "prismatic")
        joints = self._root.findall("joint")
        return {j.get("name", ""): j.get("type") for j in joints if j.get("type") in moving}

    def mimics(self) -> dict[str, tuple[str, float, float]]:
        """Joint that each joint with a ``<mimic>`` follows, factor and offset [rad or m].

        Chains are resolved to the first leader; circular ``<mimic>`` references are ignored.
        """
        direct = {}
        for joint in self._root.findall("joint"):
            mimic = joint.find("mimic")
            if mimic is not None:
                factor = float(mimic.get("multiplier", 1.0))
                offset = float(mimic.get("offset", 0.0))
                direct[joint.get("name", "")] = mimic.get("joint", ""), factor, offset
        couplings = {}
        for name, (leader, factor, offset) in direct.items():
            passed = {name}
            while leader in direct and leader not in passed:
                passed.add(leader)
                leader, before, shift = direct[leader]
                factor, offset = factor * before, factor * shift + offset
            if leader not in passed:
                couplings[name] = leader, factor, offset
        return couplings

    def child(self, joint: str) -> str:
        """Name of the child link of a joint."""
        return self._find("joint", joint).find("child").get("link", "")

    def axis(self, joint: str) -> np.ndarray:
        """Axis of a joint in the frame of its child link, (3,)."""
        element = self._find("joint", joint).find("axis")
        return np.array(
            [float(v) for v in (element.get("xyz") if element is not None else "1 0 0").split()]
        )

    def lock(self, joint: str, position: float) -> None:
        """Fix a joint at a position [rad or m]."""
        lock(self._find("joint", joint), position)

    def split_root(self, x: float, axis: str) -> str:
        """Split the root link in two with a hinge; joints behind the cut move to the rear link.

        Each half has half the mass and inertia about the same centre, so with a locked
        hinge the robot is unchanged.

        Args:
            x: Position of the cut in the frame of the root link [m].
            axis: Axis of the hinge: x, y or z.

        Returns:
            Name of the rear link.
        """
        root = self.root_link()
        rear = f"{root}_rear"
        weight, tensor, origin = self._inertial(root)
        weight.set("value", repr(0.5 * float(weight.get("value", 0.0))))
        for key in TENSOR:
            tensor.set(key, repr(0.5 * float(tensor.get(key, 0.0))))
        link = ET.SubElement(self._root, "link", name=rear)
        inertial = ET.SubElement(link, "inertial")
        inertial.extend([_moved(origin, -x), ET.Element("mass", weight.attrib)])
        ET.SubElement(inertial, "inertia", tensor.attrib)
        for joint in self._root.findall("joint"):
            place = joint.find("origin")
            at = 0.0 if place is None else float(place.get("xyz", "0 0 0").split()[0])
            if joint.find("parent").get("link") == root and at < x:
                joint.find("parent").set("link", rear)
                joint.remove(place)
                joint.append(_moved(place, -x))
        hinge = ET.SubElement(self._root, "joint", name=f"{rear}_joint", type="continuous")
        ET.SubElement(hinge, "parent", link=root)
        ET.SubElement(hinge, "child", link=rear)
        ET.SubElement(hinge, "origin", xyz=f"{x!r} 0 0")
        ET.SubElement(hinge, "axis", xyz=" ".join("1" if a == axis else "0" for a in "xyz"))
        return rear

    def mass(self) -> float:
        """Mass of all links [kg]."""
        return added(float(m.get("value", 0.0)) for m in self._root.iterfind("link/inertial/mass"))

    def mass_of(self, link: str) -> float:
        """Mass of one link [kg]."""
        weight = self._find("link", link).find("inertial/mass")
        return 0.0 if weight is None else float(weight.get("value", 0.0))

    def limits(self, joint: str) -> tuple[float, float]:
        """Smallest and largest position of a joint [rad or m]; infinite if it has none."""
        element = self._find("joint", joint)
        limit = element.find("limit")
        unlimited = limit is None or not {"lower", "upper"} & set(limit.keys())
        if unlimited or element.get("type") == "continuous":  # as in the engine
            return -math.inf, math.inf
        return float(limit.get("lower", 0.0)), float(limit.get("upper", 0.0))

    def velocity(self, joint: str) -> float:
        """Velocity limit of a joint [rad/s or m/s]; 0 if the URDF has none."""
        limit = self._find("joint", joint).find("limit")
        return 0.0 if limit is None else float(limit.get("velocity", 0.0))

    def fastest(self) -> float:
        """Velocity limit of the engine [rad/s or m/s]: 100, or the largest limit of a joint."""
        limits = [joint.find("limit") for joint in self._root.findall("joint")]
        speeds = [float(limit.get("velocity", 0.0)) for limit in limits if limit is not None]
        return max(100.0, *speeds, 0.0)

    def set_lower_limit(self, joint: str, lower: float) -> None:
        """Set the lower limit of a joint [rad or m].

        Raises:
            ParameterError: The joint has no limits, or the upper limit is below the value.
        """
        if not lower < self.limits(joint)[1] < math.inf:
            raise ParameterError(
                f"the stop of {joint} must be below its upper limit of "
                f"{self.limits(joint)[1]:g}, got {lower:g}"
            )
        self._find("joint", joint).find("limit").set("lower", repr(float(lower)))

    def balls(self, link: str) -> list[tuple[list[float], float]]:
        """Centres in the frame of the link [m], and radii [m], of a link's collision spheres.

        Raises:
            NameUnknownError: There is no such link.
        """
        shapes = self._find("link", link).findall("collision")
        return [
            (numbers(shape.find("origin"), "xyz", "0 0 0").tolist(), float(ball.get("radius")))
            for shape in shapes
            for ball in shape.findall("geometry/sphere")
        ]

    def grow_ball(self, link: str, by: float) -> None:
        """Increase the radius of the sphere at the end of a link by `by` [m], or reduce it.

        Raises:
            NameUnknownError: There is no such link.
            ParameterError: The link has no sphere, or its radius would not be positive.
        """
        balls = self._find("link", link).findall("collision/geometry/sphere")
        if not balls:
            raise ParameterError(f"link {link} has no ball that touches the ground")
        for ball in balls:
            radius = float(ball.get("radius")) + by
            if not radius > 0.0:
                raise ParameterError(
                    f"the ball of {link} has a radius of {radius - by:g} m, {-by:g} m less is "
                    "not possible"
                )
            ball.set("radius", repr(radius))

    def add_mass(self, link: str, mass: float, position: tuple[float, float, float]) -> None:
        """Add a point mass [kg] to a link, at a position in its frame [m].

        Raises:
            NameUnknownError: There is no such link.
            ParameterError: The link has no inertia.
        """
        weight, tensor, origin = self._inertial(link)
        inertia = self.inertia_of(link)
        com = np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])
        total, com, inertia = add_point_mass(
            float(weight.get("value")), com, inertia, mass, np.asarray(position, dtype=float)
        )
        weight.set("value", repr(float(total)))
        origin.set("xyz", " ".join(repr(float(v)) for v in com))
        for key, value in zip(TENSOR, inertia[np.triu_indices(3)], strict=True):
            tensor.set(key, repr(float(value)))

    def set_mass(self, link: str, mass: float) -> None:
        """Set the mass of a link [kg]; its inertia is scaled in proportion.

        Raises:
            NameUnknownError: There is no such link.
            ParameterError: The link has no mass.
        """
        weight, tensor, _ = self._inertial(link)
        old = float(weight.get("value", 0.0))
        if old <= 0.0:
            raise ParameterError(f"link {link!r} needs a mass above 0 to be given another")
        weight.set("value", repr(float(mass)))
        for key in TENSOR:
            tensor.set(key, repr(float(tensor.get(key, 0.0)) * float(mass) / old))

    def scale_inertia(self, link: str, factor: float) -> None:
        """Multiply the inertia of a link about its centre of mass.

        Raises:
            NameUnknownError: There is no such link.
            ParameterError: The link has no inertia.
        """
        _, tensor, _ = self._inertial(link)
        for key in TENSOR:
            tensor.set(key, repr(float(tensor.get(key, 0.0)) * float(factor)))

    def fixed_to(self, link: str) -> list[str]:
        """A link and the links connected to it by fixed joints, from it outwards."""
        self._find("link", link)
        fixed = [j for j in self._root.findall("joint") if j.get("type") == "fixed"]
        links = [link]
        for name in links:  # grows during the iteration
            links += [
                j.find("child").get("link") for j in fixed if j.find("parent").get("link") == name
            ]
        return links

    def extent(self, link: str) -> float:
        """Largest distance of a joint on a link from the link's origin [m]; at least 0.01."""
        joints = [j for j in self._root.findall("joint") if j.find("parent").get("link") == link]
        origins = [numbers(joint.find("origin"), "xyz", "0 0 0") for joint in joints]
        return max([0.01, *(float(np.linalg.norm(place)) for place in origins)])

    def add_armature(self, joint: str, inertia: float) -> None:
        """Add the inertia [kg·m²] of a rotor and gear about the axis of a joint.

        Half of it is added about the other axes of the link, the least that is physically possible.

        Raises:
            NameUnknownError: There is no such joint.
            ParameterError: The child link has no inertia.
        """
        axis = self.axis(joint) / np.linalg.norm(self.axis(joint))
        about = inertia * (0.5 * np.eye(3) + 0.5 * np.outer(axis, axis))
        self.add_inertia(self.child(joint), about)

    def add_inertia(self, link: str, added: tuple[float, float, float] | np.ndarray) -> None:
        """Add inertia [kg·m²] to a link: moments about its axes, (3,), or a tensor, (3, 3).

        The engine ignores a physically impossible tensor, whose largest moment exceeds the sum
        of the others; in that case the others are raised.

        Raises:
            NameUnknownError: There is no such link.
            ParameterError: The link has no inertia.
        """
        if not np.any(added):
            return
        added = np.diag(added) if np.ndim(added) == 1 else np.asarray(added)
        moments, axes = np.linalg.eigh(self.inertia_of(link) + added)
        excess = moments[2] - moments[0] - moments[1]
        if excess > 0.0:
            moments[:2] += 0.5 * excess + 1e-9 * moments[2]
        inertia = axes @ np.diag(moments) @ axes.T
        _, tensor, _ = self._inertial(link)
        for key, value in zip(TENSOR, inertia[np.triu_indices(3)], strict=True):
            tensor.set(key, repr(float(value)))

    def inertia_of(self, link: str) -> np.ndarray:
        """Inertia of a link about its centre of mass [kg·m²], (3, 3).

        Raises:
            NameUnknownError: There is no such link.
            ParameterError: The link has no inertia.
        """
        _, tensor, _ = self._inertial(link)
        return inertia_matrix([float(tensor.get(key, 0.0)) for key in TENSOR])

    def centre_of(self, link: str) -> np.ndarray:
        """Centre of mass of a link in its frame [m], (3,)."""
        _, _, origin = self._inertial(link)
        return np.array([float(v) for v in origin.get("xyz", "0 0 0").split()])

    def shift_com(self, link: str, offset: tuple[float, float, float]) -> None:
        """Move the centre of mass of a link [m]; the inertia about it is unchanged.

        Raises:
            NameUnknownError: There is no such link.
            ParameterError: The link has no inertia.
        """
        _, _, origin = self._inertial(link)
        moved = [c + float(o) for c, o in zip(self.centre_of(link).tolist(), offset, strict=True)]
        origin.set("xyz", " ".join(repr(v) for v in moved))

    def set_damping(self, joint: str, value: float) -> None:
        """Set the viscous damping of a joint [N·m·s/rad]."""
        element = self._find("joint", joint)
        dynamics = element.find("dynamics")
        if dynamics is None:
            dynamics = ET.SubElement(element, "dynamics")
        dynamics.set("damping", repr(float(value)))

    def _inertial(self, link: str) -> tuple[ET.Element, ET.Element, ET.Element]:
        """Elements of a link's mass, inertia tensor along its axes, and centre of mass."""
        inertial = self._find("link", link).find("inertial")
        if inertial is None or inertial.find("mass") is None or inertial.find("inertia") is None:
            raise ParameterError(f"link {link!r} needs an <inertial> with a mass and an inertia")
        origin, tensor = inertial.find("origin"), inertial.find("inertia")
        if origin is None:
            origin = ET.SubElement(inertial, "origin", xyz="0 0 0")
        if _is_rotated(origin):
            turn = fixed_axes(np.array([float(v) for v in origin.attrib.pop("rpy").split()]))
            inertia = turn @ self.inertia_of(link) @ turn.T
            for key, value in zip(TENSOR, inertia[np.triu_indices(3)], strict=True):
                tensor.set(key, repr(float(value)))
        return inertial.find("mass"), tensor, origin

    def text(self, folder: Path | None = None, drawn: bool = True) -> str:
        """Text of the URDF; with `folder` for the engine, and without visual shapes unless `drawn`.

        Mesh files are then relative to that folder. Links without mass get an inertia of zero,
        for which the engine would otherwise assume 1 kg. PyBullet's own ``<contact>`` elements
        are removed: contacts are defined in ``robot.yaml``, and friction anchors would hold
        feet back.
        """
        root = copy.deepcopy(self._root) if folder else self._root
        for link in root.findall("link") if folder else ():
            for part in [*link.findall("contact"), *([] if drawn else link.findall("visual"))]:
                link.remove(part)
        for mesh in root.iter("mesh") if folder else ():
            name = mesh.get("filename", "")
            mesh.set("filename", str(mesh_path(name, folder) or folder / name))
        for link in root.findall("link") if folder else ():
            if mass_of(link) == 0.0:
                for inertial in link.findall("inertial"):
                    link.remove(inertial)
                inertial = ET.SubElement(link, "inertial")
                ET.SubElement(inertial, "mass", value="0")
                ET.SubElement(inertial, "inertia", dict.fromkeys(TENSOR, "0"))
        return ET.tostring(root, encoding="unicode")

    def _find(self, tag: str, name: str) -> ET.Element:
        for element in self._root.findall(tag):
            if element.get("name") == name:
                return element
        raise NameUnknownError(tag, name, [e.get("name", "") for e in self._root.findall(tag)])


def _moved(origin: ET.Element, x: float) -> ET.Element:
    """An origin moved along x [m]."""
    at = [float(v) for v in origin.get("xyz", "0 0 0").split()]
    return ET.Element("origin", {**origin.attrib, "xyz": f"{at[0] + x!r} {at[1]!r} {at[2]!r}"})


def _is_rotated(origin: ET.Element) -> bool:
    return any(float(v) != 0.0 for v in origin.get("rpy", "0 0 0").split())
