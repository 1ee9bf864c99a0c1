# SPDX-License-Identifier: Apache-2.0
"""Export of a model as URDF: links, damping and friction of the joints."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from . import comments
from .portable import IMPEDANCE, SERVO, Portable, grouped

DRIVES = {
    IMPEDANCE: "drive tau = kp (q_d - q) + kd (dq_d - dq), kp {:g}, kd {:g}, |tau| <= {:g}",
    SERVO: "drive tau = clip(kp (q_d - q)) - kd dq, kp {:g}, kd {:g}, |clip| <= {:g}",
}


def urdf(model: Portable) -> tuple[str, list[str]]:
    """Text of the URDF, and properties that are lost."""
    root = ET.fromstring(model.world.description.text(model.robot.folder))
    lost = [*model.lost]
    elements = {element.get("name"): element for element in root.findall("joint")}
    for joint in model.joints:
        element = elements[joint.name]
        for old in element.findall("dynamics"):
            element.remove(old)
        values = {"damping": f"{joint.damping:.10g}", "friction": f"{joint.friction:.10g}"}
        ET.SubElement(element, "dynamics", values)
        if joint.kind in DRIVES:
            law = DRIVES[joint.kind].format(joint.kp, joint.kd, joint.limit)
            lost.append(f"{joint.name}: {law}")
        for key in ("armature", "stiffness", "rest", "offset", "delay", "lag"):
            if value := getattr(joint, key):
                lost.append(f"{joint.name}: {key} {value:g}")
        if joint.tension is not None:
            lost.append(f"{joint.name}: tension spring of {joint.tension.stiffness:g} N/m")
    for link, friction in model.world.friction.items():
        lost.append(f"{link}: friction with the ground {friction:g}")
    for link, (stiffness, damping) in model.world.contact.items():
        if stiffness > 0.0:
            lost.append(f"{link}: contact of {stiffness:g} N/m and {damping:g} N·s/m")
    lost = grouped(lost, model.robot.joints)
    ET.indent(root)
    return comments.xml(ET.tostring(root, encoding="unicode"), model.robot.name, lost), lost
