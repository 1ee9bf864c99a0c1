# SPDX-License-Identifier: Apache-2.0
"""A model as MJCF: one actuator a driven joint, and all that MuJoCo's file format can say.

The force of an actuator is gain · ctrl + bias - kp q - kd dq within its limits. `ctrl` is

    impedance   q_d + (kd dq_d + tau) / kp      (kp 0: kd dq_d + tau)
    servo       q_d
    torque      tau

What an environment has to do is in ``<custom>``: ``delay`` [s] and ``offset`` [rad] of each
actuator, in their order.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from ..geometry import rotation_matrix
from . import comments
from .portable import IMPEDANCE, SERVO, TORQUE, Joint, Portable


def mjcf(model: Portable) -> tuple[str, list[str]]:
    """Text of the MJCF, and what it cannot say.

    Raises:
        ParameterError: MuJoCo cannot build the robot.
    """
    root = ET.fromstring(model.world.mjcf())
    lost = [*model.lost]
    joints = {element.get("name"): element for element in root.iter("joint")}
    actuators = ET.SubElement(root, "actuator")
    driven = [joint for joint in model.joints if joint.kind in (IMPEDANCE, SERVO, TORQUE)]
    for joint in model.joints:
        _passive(joints[joint.name], joint)
        if joint.tension is not None:
            _tension(root, joint)
    for joint in driven:
        actuators.append(_actuator(joint))
    custom = root.find("custom")
    custom = ET.SubElement(root, "custom") if custom is None else custom
    for key in ("delay", "offset"):
        values = [getattr(joint, key) for joint in driven]
        if any(values):
            ET.SubElement(custom, "numeric", name=key, data=_numbers(values))
            lost.append(f"{key} of {_named(driven, key)}: in <custom>, for the environment to do")
    for link, (stiffness, damping) in model.world.hinges.items():
        hinge = next(body for body in root.iter("body") if body.get("name") == link).find("joint")
        hinge.set("stiffness", f"{stiffness:.10g}")
        hinge.set("damping", f"{damping:.10g}")
    ET.indent(root)
    return comments.xml(ET.tostring(root, encoding="unicode"), model.robot.name, lost), lost


def _named(joints: Sequence[Joint], key: str) -> str:
    return ", ".join(joint.name for joint in joints if getattr(joint, key))


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _passive(element: ET.Element, joint: Joint) -> None:
    """Friction, damping, armature and spring of a joint; of a servo also what its motor brakes."""
    braked = joint.damping + (joint.kd if joint.kind == SERVO else 0.0)
    element.attrib.pop("actuatorfrcrange", None)  # the actuator has its own
    values = {"damping": braked, "frictionloss": joint.friction, "armature": joint.armature}
    if joint.stiffness:
        values |= {"stiffness": joint.stiffness, "springref": joint.rest}
    for key, value in values.items():
        element.set(key, f"{value:.10g}")


def _actuator(joint: Joint) -> ET.Element:
    """The drive of a joint, whose zero may be off."""
    gain, bias, slope, brake = joint.kp, joint.bias, 0.0, 0.0
    if joint.kind == IMPEDANCE:
        gain, slope, brake = joint.kp or 1.0, joint.kp, joint.kd
    elif joint.kind == SERVO:
        slope = joint.kp
    values = {"name": joint.name, "joint": joint.name, "gainprm": f"{gain:.10g}"}
    values |= {"biastype": "affine"}
    values["biasprm"] = _numbers([bias + slope * joint.offset, -slope, -brake])
    if joint.lag > 0.0:
        values |= {"dyntype": "filterexact", "dynprm": f"{joint.lag:.10g}"}
    if math.isfinite(joint.limit):
        values |= {"forcelimited": "true", "forcerange": _numbers([-joint.limit, joint.limit])}
    return ET.Element("general", values)


def _tension(root: ET.Element, joint: Joint) -> None:
    """The tension spring of a knee, between two sites in the plane that the knee turns in."""
    spring = joint.tension
    parent, child, element = next(
        (above, body, one)
        for above in root.iter("body")
        for body in above.findall("body")
        for one in body.findall("joint")
        if one.get("name") == joint.name
    )
    axis = np.array(element.get("axis", "0 0 1").split(), dtype=float)
    pivot = np.array(element.get("pos", "0 0 0").split(), dtype=float)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    w, *xyz = np.array(child.get("quat", "1 0 0 0").split(), dtype=float)
    turn = np.reshape(rotation_matrix((*xyz, w)), (3, 3))
    place = np.array(child.get("pos", "0 0 0").split(), dtype=float)
    ends = {
        f"{joint.name}_tibia": (child, pivot + spring.tibia * across),
        f"{joint.name}_femur": (parent, place + turn @ (pivot + spring.femur * across)),
    }
    for name, (body, at) in ends.items():
        body.append(ET.Element("site", name=name, pos=_numbers(at), size="0.002"))
    tendons = root.find("tendon")
    tendons = ET.SubElement(root, "tendon") if tendons is None else tendons
    spatial = ET.SubElement(
        tendons, "spatial", name=f"{joint.name}_spring", stiffness=f"{spring.stiffness:.10g}",
        springlength=f"{spring.length:.10g}",
    )  # fmt: skip
    for name in ends:
        ET.SubElement(spatial, "site", site=name)
