# SPDX-License-Identifier: Apache-2.0
"""Read the topics of loco graphs as tracks: standard messages, and those of the HyQ graph."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loco_control.exceptions import BagError
from loco_learning.gap.recordings import mapping
from loco_learning.gap.recordings.record import Doubt
from loco_learning.gap.recordings.tracks import AXES, Track, joint_names
from loco_sim.robot.robot import Robot

from ..bag.reader import Bag, seconds
from . import joint_states

STATES, COMMAND = "joint_states", "joint_command"
ROBOT_STATE, MOTION, TRUNK = "robot_state", "motion_command", "trunk_torque"
IMU, ODOMETRY = "imu/data", "ground_truth/odom"
FIELDS = {"position": "q", "velocity": "dq", "effort": "tau"}
COMMANDS = {"position": "position", "velocity": "velocity", "effort": "torque"}
ROLES_OF_JOINTS = (*FIELDS.values(), *(f"command_{kind}" for kind in COMMANDS.values()))
_JOINTS, _STATE = "sensor_msgs/msg/JointState", "loco_msgs/msg/RobotState"


def read(bag: Bag, robot: Robot, namespace: str, base_pose: bool) -> tuple[list[Track], list[str]]:
    """Signals and commands of one robot in a bag, and notes on their clocks.

    Args:
        bag: The recording.
        robot: Measured robot; among several namespaces, the one with its joints is read.
        namespace: Namespace of the robot; empty to search for it.
        base_pose: Whether to read the pose of the base from `ODOMETRY`.

    Raises:
        BagError: A topic is missing, or several namespaces match.
        LocoError: The messages are not usable.
    """
    prefix = _prefix(bag, robot, namespace)
    if _has(bag, prefix + ROBOT_STATE, _STATE):
        tracks, notes = _own_messages(bag, prefix, robot), []
    else:
        tracks, notes = _standard(bag, prefix)
        tracks = _own_joints(_renamed(tracks, robot, notes), robot, notes)
    if base_pose:
        if not _has(bag, prefix + ODOMETRY, "nav_msgs/msg/Odometry"):
            raise BagError(f"{bag.path.name} has no {prefix}{ODOMETRY}, asked for by base_pose")
        tracks += _pose(bag, prefix + ODOMETRY)
    return tracks, notes


def is_known(bag: Bag) -> bool:
    """True if a bag has the commands and states of a loco graph, in any namespace."""
    pairs = ((ROBOT_STATE, _STATE), (COMMAND, _JOINTS))
    return any(topic.endswith("/" + name) and _has(bag, topic, kind)
               for topic in bag.topics for name, kind in pairs)  # fmt: skip


def how_to_map(bag: Bag) -> str:
    """Command that drafts a mapping, which names other topics."""
    return (
        f"for other topics, `loco gap mapping {bag.path} --robot ROBOT --out {mapping.FILE}` "
        f"drafts a mapping, which `loco gap` uses with --mapping {mapping.FILE}"
    )


def _has(bag: Bag, topic: str, kind: str) -> bool:
    info = bag.topics.get(topic)
    return info is not None and info.type == kind and info.count > 0


def _prefix(bag: Bag, robot: Robot, namespace: str) -> str:
    """Namespace of the robot with slashes, determined from the topics and their joints."""
    required = {STATES: _JOINTS, ROBOT_STATE: _STATE}
    spaces = {
        topic[: -len(name)]
        for name, kind in required.items()
        for topic in bag.topics
        if topic.endswith("/" + name) and _has(bag, topic, kind)
    }
    if namespace:
        spaces &= {f"/{namespace.strip('/')}/"}
    if not spaces:
        raise BagError(
            f"{bag.path.name} has no messages on {namespace.strip('/')}{'/' if namespace else ''}"
            f"{STATES} or {ROBOT_STATE}; it has {', '.join(sorted(bag.topics)) or 'no topics'} "
            f"({how_to_map(bag)})"
        )
    if len(spaces) > 1:
        spaces = {space for space in spaces if _joints_fit(bag, space, robot)} or spaces
    if len(spaces) > 1:
        raise BagError(
            f"{bag.path.name} holds several robots ({', '.join(sorted(spaces))}); name one with "
            "namespace: in a mapping"
        )
    return spaces.pop()


def _joints_fit(bag: Bag, space: str, robot: Robot) -> bool:
    if not _has(bag, space + STATES, _JOINTS):
        return False
    first = bag.message(space + STATES, bag.raw(space + STATES)[1][0])
    return set(first.name) == set(robot.joints)


def _standard(bag: Bag, prefix: str) -> tuple[list[Track], list[str]]:
    if not _has(bag, prefix + COMMAND, _JOINTS):
        raise BagError(
            f"{bag.path.name} has no messages on {prefix}{COMMAND}, role command is missing; it "
            f"has {', '.join(sorted(bag.topics))} ({how_to_map(bag)})"
        )
    notes: list[str] = []
    commands = {field: f"command_{kind}" for field, kind in COMMANDS.items()}
    both = states, command = [joint_states.read(bag, prefix + topic) for topic in (STATES, COMMAND)]
    which = joint_states.common_clock([(each.stamps, each.logged) for each in both])
    tracks = joint_states.tracks(bag, states, FIELDS, notes, which)
    tracks += joint_states.tracks(bag, command, commands, notes, which)
    if _has(bag, prefix + IMU, "sensor_msgs/msg/Imu"):
        tracks += _imu(bag, prefix + IMU)
    return tracks, notes


def _renamed(tracks: list[Track], robot: Robot, notes: list[str]) -> list[Track]:
    """Tracks named as the robot's joints, if one prefix or suffix tells all names apart.

    Either the recording has it, as several arms do in one graph, or the model.
    """
    found = {k.place for k in tracks if k.role in ROLES_OF_JOINTS}
    if set(robot.joints) <= found:
        return tracks
    names = joint_names(found, robot.joints)
    if not names:
        return tracks
    listed = ", ".join(f"{name} as {joint}" for name, joint in names.items() if name != joint)
    notes.append(f"joints are read by the names of the model: {listed}")
    return [replace(k, place=names.get(k.place, k.place)) if k.role in ROLES_OF_JOINTS else k
            for k in tracks]  # fmt: skip


def _own_joints(tracks: list[Track], robot: Robot, notes: list[str]) -> list[Track]:
    """Tracks without joints that the robot lacks, if all joints of the robot are present."""
    extra = sorted({k.place for k in tracks if k.role in ROLES_OF_JOINTS} - set(robot.joints))
    if not extra or set(robot.joints) - {k.place for k in tracks if k.role == "q"}:
        return tracks
    notes.append(Doubt(f"{', '.join(extra)}: not in the model of {robot.name!r} and left out"))
    return [k for k in tracks if k.role not in ROLES_OF_JOINTS or k.place not in extra]


def _imu(bag: Bag, topic: str) -> list[Track]:
    """Tracks of an IMU, without an orientation that the message marks as unknown."""
    records = bag.records(topic)
    tracks = _blocks(
        records, topic, {"gyro": "angular_velocity", "acceleration": "linear_acceleration"}
    )
    orientations = _blocks(records, topic, {"orientation": "orientation"})
    has_orientation = np.any(np.stack([track.x for track in orientations]) != 0.0)
    return tracks + orientations if has_orientation else tracks


def _pose(bag: Bag, topic: str) -> list[Track]:
    fields = {"base_position": "pose.pose.position", "base_orientation": "pose.pose.orientation"}
    return _blocks(bag.records(topic), topic, fields)


def _blocks(records: np.ndarray, topic: str, fields: dict[str, str]) -> list[Track]:
    """Tracks of vectors and quaternions from record fields, by role and path."""
    t = seconds(records, "header.stamp")
    return [
        Track(role, axis, t, records[f"{path}.{axis}"].astype(float), topic)
        for role, path in fields.items()
        for axis in AXES[role]
    ]


def _own_messages(bag: Bag, prefix: str, robot: Robot) -> list[Track]:
    """Tracks of the HyQ graph: joints and feet in the robot's order, trunk torque as feed-forward.

    Legs that the trunk controller treats as in stance have the stance gains.
    """
    if not _has(bag, prefix + MOTION, "loco_msgs/msg/MotionCommand"):
        raise BagError(
            f"{bag.path.name} has no messages on {prefix}{MOTION}, role command is missing; it has "
            f"{', '.join(sorted(bag.topics))}"
        )
    required = {
        ROBOT_STATE: {"q": "q", "dq": "dq", "tau": "tau"},
        MOTION: {"command_position": "q", "command_velocity": "dq"},
        TRUNK: {"command_torque": "tau"},
    }
    tracks: list[Track] = []
    for name, roles in required.items():
        if name == TRUNK and not bag.topics.get(prefix + TRUNK):
            continue
        records = bag.records(prefix + name)
        t = seconds(records, "stamp")
        for role, field in roles.items():
            tracks += _side_by_side(role, robot.joints, t, records[field], prefix + name)
        if name == TRUNK:
            tracks += _side_by_side("stance", robot.feet, t, records["stance"], prefix + name)
    records = bag.records(prefix + ROBOT_STATE)
    t = seconds(records, "stamp")
    force = records["grf"].reshape(len(t), -1, 3)[:, :, 2]
    tracks += _side_by_side("grf", robot.feet, t, force, prefix + ROBOT_STATE)
    imu = {"orientation": "orientation", "gyro": "angular_velocity"}
    for role, field in (imu | {"acceleration": "linear_acceleration"}).items():
        tracks += _side_by_side(role, AXES[role], t, records[field], prefix + ROBOT_STATE)
    return tracks


def _side_by_side(
    role: str, names: Sequence[str], t: np.ndarray, values: np.ndarray, topic: str
) -> list[Track]:
    if values.shape[1] != len(names):
        raise BagError(
            f"{topic} has {values.shape[1]} values of {role}, the robot has {len(names)} "
            f"({', '.join(names)}): another robot was measured"
        )
    columns = zip(names, values.T.astype(float), strict=True)
    return [Track(role, place, t, column, topic) for place, column in columns]
