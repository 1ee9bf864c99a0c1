# SPDX-License-Identifier: Apache-2.0
"""Export of a model as MJCF, with one actuator per driven joint.

The force of an actuator is gain · ctrl + bias - kp q - kd dq within its limits. `ctrl` is

    impedance   q_d + (kd dq_d + tau) / kp      (kp 0: kd dq_d + tau)
    servo       q_d
    torque      tau

An elastic gear is a tendon between the joint and a separate rotor joint, JOINT_rotor, on a body
without mass, whose armature is the rotor's inertia. The motor turns the rotor.

Properties that an environment has to implement are in ``<custom>``, a number for each actuator in
order: ``delay`` [s] and ``offset`` [rad]; for servos ``resolution`` [rad], ``encoder``, 1 if they
measure the joint but turn the rotor, and ``effort``, limit of driving plus braking torque [N·m]:
see `replay_mjcf.Drives`. ``brake`` is the damping that vanishes when the motor is switched off
[N·m·s/rad].
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

from ..geometry import rotation_matrix
from . import comments
from .portable import IMPEDANCE, SERVO, TORQUE, Joint, Portable

ROTOR = "_rotor"  # suffix of the names of its body and joint
LIGHT = 1e-6, 1e-9  # mass [kg] and inertia [kg·m²] of its body: MuJoCo requires both
WIDTHS = {"free": 7, "ball": 4}  # numbers in the position of a joint; default 1
FREEDOMS = {"free": 6, "ball": 3}  # numbers in its velocity; default 1
BY_HAND = {
    "delay": "in <custom>, for the environment to do",
    "offset": "in <custom>, for the environment to do",
    "resolution": "the drive rounds what it reads: in <custom>, for the environment to do",
    "encoder": "the drive reads the joint, an actuator of MuJoCo the rotor that it turns: the "
    "environment adds q of the rotor - q of the joint to ctrl in each physics step",
    "effort": "limit of push and brake together: in <custom>, for the environment to do",
}  # fmt: skip


def mjcf(model: Portable) -> tuple[str, list[str]]:
    """Text of the MJCF, and properties that are lost.

    Raises:
        ParameterError: MuJoCo cannot build the robot.
    """
    root = ET.fromstring(model.world.mjcf())
    for ground in root.findall("sensor"):  # sensors of the plant, which MJX cannot read
        root.remove(ground)
    lost = [*model.lost]
    joints = {element.get("name"): element for element in root.iter("joint")}
    actuators = ET.SubElement(root, "actuator")
    driven = [joint for joint in model.joints if joint.kind in (IMPEDANCE, SERVO, TORQUE)]
    before = offsets(root, WIDTHS)
    for joint in model.joints:
        _passive(joints[joint.name], joint)
        if joint.gear is not None:
            _rotor(root, joint)
        if joint.tension is not None:
            _tension(root, joint)
    for joint in driven:
        actuators.append(_actuator(joint))
    custom = _section(root, "custom")
    for key, values in _numerics(driven).items():
        if any(values):
            ET.SubElement(custom, "numeric", name=key, data=_numbers(values))
        if any(values) and key in BY_HAND:
            named = ", ".join(j.name for j, value in zip(driven, values, strict=True) if value)
            lost.append(f"{key} of {named}: {BY_HAND[key]}")
    for link, (stiffness, damping) in model.world.hinges.items():
        hinge = next(body for body in root.iter("body") if body.get("name") == link).find("joint")
        hinge.set("stiffness", f"{stiffness:.10g}")
        hinge.set("damping", f"{damping:.10g}")
    _stand(root, before)
    ET.indent(root)
    return comments.xml(ET.tostring(root, encoding="unicode"), model.robot.name, lost), lost


def offsets(root: ET.Element, widths: Mapping[str, int]) -> dict[str, int]:
    """Index of the first number of each joint in the state of a model, by name.

    Args:
        root: The MJCF.
        widths: Count of numbers by joint type, default one: `WIDTHS` or `FREEDOMS`.
    """
    addresses, at = {}, 0
    for joint in root.find("worldbody").iter():
        if joint.tag in ("joint", "freejoint"):
            addresses[joint.get("name", "")] = at
            kind = "free" if joint.tag == "freejoint" else joint.get("type", "hinge")
            at += widths.get(kind, 1)
    return addresses


def dofs(text: str) -> dict[str, int]:
    """Index of the (first) degree of freedom of each joint of the MJCF."""
    return offsets(ET.fromstring(text), FREEDOMS)


def _numerics(driven: Sequence[Joint]) -> dict[str, list[float]]:
    """Contents of ``<custom>``, a number for each actuator."""
    keys = "delay", "offset", "resolution", "effort"
    values = {key: [getattr(joint, key) for joint in driven] for key in keys}
    values["encoder"] = [float(j.gear is not None) for j in driven]
    values["brake"] = [j.kd if j.kind == SERVO else 0.0 for j in driven]
    return values


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.10g}" for value in values)


def _passive(element: ET.Element, joint: Joint) -> None:
    """Set friction, damping, armature and spring of a joint, including the damping of its motor."""
    damping = joint.damping + (joint.kd if joint.kind == SERVO and joint.gear is None else 0.0)
    element.attrib.pop("actuatorfrcrange", None)  # the actuator has its own limit
    values = {"damping": damping, "frictionloss": joint.friction, "armature": joint.armature}
    if joint.stiffness:
        values |= {"stiffness": joint.stiffness, "springref": joint.rest}
    for key, value in values.items():
        element.set(key, f"{value:.10g}")


def _actuator(joint: Joint) -> ET.Element:
    """Actuator element of the drive of a joint, including its zero offset."""
    gain, bias, slope, brake = joint.kp, joint.bias, 0.0, 0.0
    if joint.kind == IMPEDANCE:
        gain, slope, brake = joint.kp or 1.0, joint.kp, joint.kd
    elif joint.kind == SERVO:
        slope = joint.kp
    joint_name = joint.name if joint.gear is None else f"{joint.name}{ROTOR}"
    values = {"name": joint.name, "joint": joint_name, "gainprm": f"{gain:.10g}"}
    values |= {"biastype": "affine"}
    values["biasprm"] = _numbers([bias + slope * joint.offset, -slope, -brake])
    if joint.lag > 0.0:
        values |= {"dyntype": "filterexact", "dynprm": f"{joint.lag:.10g}"}
    if math.isfinite(joint.limit):
        values |= {"forcelimited": "true", "forcerange": _numbers([-joint.limit, joint.limit])}
    return ET.Element("general", values)


def _body_of(root: ET.Element, joint: str) -> tuple[ET.Element, ET.Element, ET.Element]:
    """Body above a joint, body below it, and the joint."""
    return next(
        (above, body, one)
        for above in root.iter()
        for body in above.findall("body")
        for one in body.findall("joint")
        if one.get("name") == joint
    )


def _section(root: ET.Element, tag: str) -> ET.Element:
    """Section of the file, added if it is missing."""
    section = root.find(tag)
    return ET.SubElement(root, tag) if section is None else section


def _rotor(root: ET.Element, joint: Joint) -> None:
    """Add the rotor of a servo, in parallel to its link, and the gear between the two."""
    above, link, element = _body_of(root, joint.name)
    name = f"{joint.name}{ROTOR}"
    place = {key: link.get(key) for key in ("pos", "quat") if link.get(key)}
    rotor = ET.SubElement(above, "body", name=name, **place)
    pivot = element.get("pos", "0 0 0")
    ET.SubElement(
        rotor, "inertial", pos=pivot, mass=str(LIGHT[0]), diaginertia=_numbers([LIGHT[1]] * 3)
    )
    turning = {key: element.get(key) for key in ("type", "axis", "pos") if element.get(key)}
    values = {"damping": joint.kd, "armature": joint.gear.inertia}
    turning |= {key: f"{value:.10g}" for key, value in values.items()}
    ET.SubElement(rotor, "joint", name=name, **turning)
    gear = ET.SubElement(
        _section(root, "tendon"), "fixed", name=f"{joint.name}_gear", springlength="0",
        stiffness=f"{joint.gear.stiffness:.10g}", damping=f"{joint.gear.damping:.10g}",
    )  # fmt: skip
    for end, share in ((name, "1"), (joint.name, "-1")):
        ET.SubElement(gear, "joint", joint=end, coef=share)


def _stand(root: ET.Element, before: Mapping[str, int]) -> None:
    """Insert the rotor positions into the keyframe of the standing pose."""
    key = root.find("keyframe/key")
    if key.get("qpos") is None:  # all joints at 0
        return
    old = key.get("qpos").split()
    pose = [*old]
    for name, at in offsets(root, WIDTHS).items():
        if name not in before:
            pose.insert(at, old[before[name.removesuffix(ROTOR)]])
    key.set("qpos", " ".join(pose))


def _tension(root: ET.Element, joint: Joint) -> None:
    """Add the tension spring of a knee, between two sites in the plane of the knee's motion."""
    spring = joint.tension
    parent, child, element = _body_of(root, joint.name)
    axis = np.array(element.get("axis", "0 0 1").split(), dtype=float)
    pivot = np.array(element.get("pos", "0 0 0").split(), dtype=float)
    across = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    across /= np.linalg.norm(across)
    w, *xyz = np.array(child.get("quat", "1 0 0 0").split(), dtype=float)
    turn = np.reshape(rotation_matrix((*xyz, w)), (3, 3))
    place = np.array(child.get("pos", "0 0 0").split(), dtype=float)
    limits = {
        f"{joint.name}_tibia": (child, pivot + spring.tibia * across),
        f"{joint.name}_femur": (parent, place + turn @ (pivot + spring.femur * across)),
    }
    for name, (body, at) in limits.items():
        body.append(ET.Element("site", name=name, pos=_numbers(at), size="0.002"))
    spatial = ET.SubElement(
        _section(root, "tendon"), "spatial", name=f"{joint.name}_spring",
        stiffness=f"{spring.stiffness:.10g}", springlength=f"{spring.length:.10g}",
    )  # fmt: skip
    for name in limits:
        ET.SubElement(spatial, "site", site=name)
