# SPDX-License-Identifier: Apache-2.0
"""Encoders of the standard messages for tools, from the state of a tick, without ROS."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.convert import block_view, stamp_views, write_stamp
from loco_control.ros.messages.plain import Message, message_class
from loco_control.ros.messages.topics import TOPICS
from loco_control.types import GroundTruth, RobotState

from .skeleton import Skeleton

_ENCODED = ("joint_states", "imu/data", "ground_truth/odom", "/clock")
Encode = Callable[[RobotState, GroundTruth], bytes]


def encoders(robot: Any) -> dict[str, Encode]:
    """Function by tool topic that returns the serialised message of a tick.

    Args:
        robot: Robot with `joints` and `urdf`.
    """
    blocks = _blocks(len(robot.joints))
    templates = _templates(robot.joints)
    by_topic = {name: _encoder(message, *blocks[name]) for name, message in templates.items()}
    return {**by_topic, "/tf": _frames(Skeleton(robot))}


def _frames(skeleton: Skeleton) -> Encode:
    """Encoder of the transforms of the base in the world and of every link in its parent."""
    links = [("odom", "base_link"), *skeleton.links]
    if skeleton.base != "base_link":
        links.append(("base_link", skeleton.base))
    frames_of, transform_of = (
        message_class(kind) for kind in (TOPICS["/tf"].kind, "geometry_msgs/msg/TransformStamped")
    )
    transforms = []
    for parent, child in links:
        transforms.append(transform_of(child_frame_id=child))
        transforms[-1].header.frame_id = parent
        transforms[-1].transform.rotation.w = 1.0
    record = Codec(frames_of(transforms=transforms)).record()
    names = [f"transforms.{k}" for k in range(len(links))]
    stamps = [stamp_views(record, f"{name}.header.stamp") for name in names]
    base, *link_views = (block_view(record, f"{name}.transform.translation.x", 7) for name in names)
    rows = link_views[: len(skeleton.links)]

    def encode(state: RobotState, truth: GroundTruth) -> bytes:
        for stamp in stamps:
            write_stamp(stamp, state.t)
        base[:3], base[3:] = truth.position, truth.orientation
        for view, place in zip(rows, skeleton.pose(state.q), strict=True):
            view[...] = place
        return record.tobytes()

    return encode


def _encoder(template: Any, stamped: str, blocks: list) -> Callable:
    """Encoder from a template: writes the stamp and blocks of doubles, each by a function."""
    record = Codec(template).record()
    stamp = stamp_views(record, stamped)
    filled = [(block_view(record, path, count), value) for path, count, value in blocks]

    def encode(state: RobotState, truth: GroundTruth) -> bytes:
        write_stamp(stamp, state.t)
        for view, value in filled:
            view[...] = value(state, truth)
        return record.tobytes()

    return encode


def _templates(joints: tuple[str, ...]) -> dict[str, Message]:
    states_of, imu_of, odometry_of, clock_of = (message_class(TOPICS[n].kind) for n in _ENCODED)
    zeros = [0.0] * len(joints)
    states = states_of(name=list(joints), position=zeros, velocity=zeros, effort=zeros)
    states.header.frame_id = "base_link"
    imu = imu_of()
    imu.header.frame_id = "base_link"
    odometry = odometry_of(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    messages = states, imu, odometry, clock_of()
    return dict(zip(_ENCODED, messages, strict=True))


_TRUE_POSE = [(3, lambda state, truth: truth.position), (4, lambda state, truth: truth.orientation)]


def _blocks(joints: int) -> dict[str, tuple[str, list]]:
    """By topic: path of the stamp, and path, length and value of each block of doubles."""
    position, orientation = _TRUE_POSE
    return {
        "joint_states": (
            "header.stamp",
            [
                ("position", joints, lambda state, truth: state.q),
                ("velocity", joints, lambda state, truth: state.dq),
                ("effort", joints, lambda state, truth: state.tau),
            ],
        ),
        "imu/data": (
            "header.stamp",
            [
                ("orientation.x", 4, lambda state, truth: state.orientation),
                ("angular_velocity.x", 3, lambda state, truth: state.angular_velocity),
                ("linear_acceleration.x", 3, lambda state, truth: state.linear_acceleration),
            ],
        ),
        "ground_truth/odom": (
            "header.stamp",
            [
                ("pose.pose.position.x", *position),
                ("pose.pose.orientation.x", *orientation),
                ("twist.twist.linear.x", 3, lambda state, truth: truth.linear_velocity),
                ("twist.twist.angular.x", 3, lambda state, truth: truth.angular_velocity),
            ],
        ),
        "/clock": ("clock", []),
    }
