# SPDX-License-Identifier: Apache-2.0
"""Draft of a mapping for the topics of a bag, from message types and topic names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from loco_learning.gap.drafting import words
from loco_learning.gap.drafting.joints import Joints
from loco_learning.gap.drafting.lines import JOINT, Line
from loco_learning.gap.drafting.text import written
from loco_learning.gap.recordings.tracks import joint_names

from ...bag.reader import Bag

ROLES = {"position": "q", "velocity": "dq", "effort": "tau"}
COMMANDS = {"position": "command_position", "velocity": "command_velocity",
            "effort": "command_torque"}  # fmt: skip
MOTION = {"gyro": "angular_velocity", "acceleration": "linear_acceleration"}  # of an IMU
LISTS = {"position": "positions", "velocity": "velocities", "effort": "effort"}  # of a point
POINTS = {"reference": True, "desired": True, "feedback": False, "actual": False}


def of_bag(bag: Bag, robot: Joints) -> str:
    """Text of a mapping for the topics of a bag.

    Args:
        bag: The recording.
        robot: Joints of the robot, without names if it is unknown.

    Raises:
        ParameterError: No topic has a supported message type.
    """
    lines, joints = list[Line](), robot.names
    for name, topic in sorted(bag.topics.items()):
        reader = READERS.get(topic.type.rpartition("/")[2])
        if reader and topic.count:
            for message in first_messages(bag, name):
                lines += [x for x in reader(name, message, joints) if x not in lines]
    names = joint_names({line.joint for line in lines if line.key == JOINT}, joints)
    lines = [replace(line, joint=names.get(line.joint, line.joint)) for line in lines]
    order = {joint: row for row, joint in enumerate(joints)}
    retained = [line for line in lines if not joints or line.joint in order or line.key != JOINT]
    strangers = dict.fromkeys(line.joint for line in lines if line not in retained)
    return written(retained, sorted(bag.topics), robot, bag.path.name, strangers=list(strangers))


def first_messages(bag: Bag, name: str) -> list[Any]:
    """First message of a topic; of JointState the first with each set of joints and fields.

    None of a topic of trajectories with several points, which are no commands of their own.
    """
    if bag.topics[name].type.endswith("/JointTrajectory"):
        messages = list(bag.messages(name))
        return messages[:1] if all(len(message.points) == 1 for message in messages) else []
    if not bag.topics[name].type.endswith("/JointState"):
        return [bag.message(name, bag.raw(name)[1][0])]
    variants: dict[tuple, Any] = {}
    for message in bag.messages(name):
        fields = (len(getattr(message, field)) > 0 for field in ROLES)
        variants.setdefault((frozenset(message.name), *fields), message)
    return list(variants.values())


def _is_command(name: str) -> str:
    return next((token for token in words.split_name(name) if token in words.COMMANDS), "")


def _joint_state(name: str, message: Any, joints: Sequence[str]) -> list[Line]:
    token = _is_command(name)
    roles = COMMANDS if token else ROLES
    reason = f"JointState, “{token}” in the topic" if token else "JointState"
    return [
        Line(f"{field}[{joint}]", roles[field], joint, reason, topic=name)
        for field in roles
        if len(getattr(message, field)) == len(message.name)
        for joint in message.name
    ]


def _array(name: str, message: Any, joints: Sequence[str]) -> list[Line]:
    guess = words.guess(name)
    token, count = _is_command(name), len(message.data)
    role = guess.role or "command_position"
    if not token and not guess.role:
        return []
    names = list(joints) if len(joints) == count else [f"joint_{i}" for i in range(count)]
    reason = f"“{token or guess.why}” in the topic; the message names no joints: in this order?"
    return [Line(f"data[{i}]", role, joint, reason, topic=name) for i, joint in enumerate(names)]


def _elements(message: Any, point: Any, field: str) -> list[tuple[str, str]]:
    """Path and joint of each element of a list of a trajectory point; empty if joints lack one."""
    path, joints = LISTS[field], message.joint_names
    is_complete = len(getattr(point, path)) == len(joints)
    return [(f"{path}[{i}]", joint) for i, joint in enumerate(joints) if is_complete]


def _trajectory_state(name: str, message: Any, joints: Sequence[str]) -> list[Line]:
    return [
        Line(f"{part}.{path}", COMMANDS[field] if command else ROLES[field], joint,
             f"{part} of a trajectory controller", topic=name)
        for part, command in POINTS.items()
        if hasattr(message, part)
        for field in ("position", "velocity")
        for path, joint in _elements(message, getattr(message, part), field)
    ]  # fmt: skip


def _trajectory(name: str, message: Any, joints: Sequence[str]) -> list[Line]:
    return [
        Line(f"points[0].{path}", role, joint, "JointTrajectory of one point", topic=name)
        for field, role in COMMANDS.items()
        for path, joint in _elements(message, message.points[0], field)
    ]


def _number(name: str, message: Any, joints: Sequence[str]) -> list[Line]:
    guess = words.guess(name, joints)
    token = _is_command(name)
    joint = guess.joint or (joints[0] if len(joints) == 1 else "")
    role = guess.role or ("command_position" if token else "")
    reason = f"“{token or guess.why}” in the topic"
    return [Line("data", role, joint, reason, topic=name)] if role and joint else []


def _imu(name: str, message: Any, joints: Sequence[str]) -> list[Line]:
    fields = [(role, field, axis) for role, field in MOTION.items() for axis in "xyz"]
    is_unknown = message.orientation_covariance[0] < 0.0  # as the definition of the message says
    if not is_unknown and any(getattr(message.orientation, axis) for axis in "xyzw"):
        fields += [("orientation", "orientation", axis) for axis in "xyzw"]
    return [Line(f"{field}.{axis}", role, axis, "Imu", topic=name, key="axis")
            for role, field, axis in fields]  # fmt: skip


READERS: dict[str, Callable[[str, Any, Sequence[str]], list[Line]]] = {
    "JointState": _joint_state,
    "Float64MultiArray": _array,
    "Float32MultiArray": _array,
    "Float64": _number,
    "Float32": _number,
    "Imu": _imu,
    "JointTrajectory": _trajectory,
    "JointTrajectoryControllerState": _trajectory_state,
}
