# SPDX-License-Identifier: Apache-2.0
"""Export for ros2_control: URDF with a ``<ros2_control>`` block, and controller parameters.

The block uses the topic-based hardware interface `JointStateTopicSystem` of the package
`joint_state_topic_hardware_interface`. It stamps commands with its own time, so
`loco_sim.ros.ros2_control_node` forwards them to the plant with the stamps of states.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET

import yaml

from loco_control.exceptions import ParameterError

from .portable import TORQUE, Portable
from .urdf import urdf

NAMESPACE = "/ros2_control"
COMMANDS, STATES = f"{NAMESPACE}/joint_command", "joint_states"
PLUGIN = "joint_state_topic_hardware_interface/JointStateTopicSystem"
CONTROLLER = "joint_trajectory_controller"
MEASURED = ("position", "velocity", "effort")
HEAD = """\
# Controllers of ros2_control for robot {robot}, written by `loco export-model`. Under a ROS from
# apt with ros-jazzy-ros2-controllers and ros-jazzy-joint-state-topic-hardware-interface, each in
# a terminal of its own, all of one ROS_DOMAIN_ID:
#   loco run EXPERIMENT --nodes nodes.yaml --clock realtime
#   ros2 run robot_state_publisher robot_state_publisher robot.urdf --ros-args -r __ns:={ns}
#   ros2 run controller_manager ros2_control_node --ros-args -r __ns:={ns} \\
#       --params-file controllers.yaml
#   ros2 run controller_manager spawner {controller} -c {ns}/controller_manager
# None of these lines but the first was run: ros2_control is not among the Python packages of ROS.
"""
NODES = """\
# Node set of `loco run --nodes`: ros2_control in the place of the network.
table: joint
nodes:
  - name: robot_sim
    class: "loco_sim.ros.joint_sim_node:JointSimNode"
    parameters: [plant, seed, tick]
  - name: target_generator
    class: "loco_control.ros.cpg_node:CpgNode"
    parameters: [joints, target]
  - name: reflex_network
    class: "loco_sim.ros.ros2_control_node:Ros2ControlNode"
"""


def ros2_control(model: Portable) -> dict[str, tuple[str, list[str]]]:
    """Texts of ``robot.urdf``, ``controllers.yaml`` and ``nodes.yaml``, each with lost properties.

    Args:
        model: The model; its drives must all accept positions, or all torques.

    Raises:
        ParameterError: Some drives accept positions and others torques, or no joint has a drive.
    """
    kind = command_of(model)
    text, lost = urdf(model)
    passive = [joint.name for joint in model.joints if joint.name not in driven(model)]
    if passive:
        lost = [*lost, f"{', '.join(passive)}: without a drive, not in the ros2_control block"]
    document = text.replace("</robot>", f"{block(model, kind)}\n</robot>")
    return {
        "robot.urdf": (document, lost),
        "controllers.yaml": (controllers(model, kind), []),
        "nodes.yaml": (NODES, []),
    }


def driven(model: Portable) -> list[str]:
    """Names of the joints with a drive, in the order of the robot."""
    return [model.robot.joints[i] for i in model.robot.driven]


def command_of(model: Portable) -> str:
    """Interface of the drives, ``position`` or ``effort``.

    Args:
        model: The model.

    Raises:
        ParameterError: The drives accept different commands, or there are none.
    """
    names = driven(model)
    torque = {joint.kind == TORQUE for joint in model.joints if joint.name in names}
    if len(torque) != 1:
        has = "drives of positions and of torques" if torque else "no drive"
        raise ParameterError(
            f"{model.robot.name} has {has}: ros2_control's topics carry one kind for all joints; "
            "take --to urdf"
        )
    return "effort" if torque == {True} else "position"


def block(model: Portable, kind: str) -> str:
    """The ``<ros2_control>`` element.

    Args:
        model: The model.
        kind: Interface of the drives, ``position`` or ``effort``.
    """
    root = ET.Element("ros2_control", name=model.robot.name, type="system")
    hardware = ET.SubElement(root, "hardware")
    ET.SubElement(hardware, "plugin").text = PLUGIN
    parameters = {
        "joint_commands_topic": COMMANDS, "joint_states_topic": f"/{STATES}",
        "trigger_joint_command_threshold": "-1",  # send every command, also one already reached
    }  # fmt: skip
    for name, value in parameters.items():
        ET.SubElement(hardware, "param", name=name).text = value
    for name in driven(model):
        joint = ET.SubElement(root, "joint", name=name)
        command = ET.SubElement(joint, "command_interface", name=kind)
        start = model.robot.standing[model.robot.joints.index(name)] if kind == "position" else 0.0
        # Command before a controller is active.
        ET.SubElement(command, "param", name="initial_value").text = f"{start:.10g}"
        for measured in MEASURED:
            ET.SubElement(joint, "state_interface", name=measured)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode")


def controllers(model: Portable, kind: str) -> str:
    """Parameters of controller manager and controllers as YAML.

    Args:
        model: The model.
        kind: Interface of the drives, ``position`` or ``effort``.
    """
    parameters = {"joints": driven(model), "command_interfaces": [kind],
           "state_interfaces": ["position", "velocity"]}  # fmt: skip
    if kind == "effort":
        parameters["gains"] = {name: {"p": 0.0, "i": 0.0, "d": 0.0} for name in driven(model)}
    types = {
        "joint_state_broadcaster": "joint_state_broadcaster/JointStateBroadcaster",
        CONTROLLER: "joint_trajectory_controller/JointTrajectoryController",
    }
    manager = {"update_rate": round(model.robot.control_rate)}
    manager |= {name: {"type": value} for name, value in types.items()}
    content = {
        f"{NAMESPACE}/controller_manager": {"ros__parameters": manager},
        f"{NAMESPACE}/{CONTROLLER}": {"ros__parameters": parameters},
    }
    head = HEAD.format(robot=model.robot.name, ns=NAMESPACE, controller=CONTROLLER)
    return head + yaml.safe_dump(content, sort_keys=False)
