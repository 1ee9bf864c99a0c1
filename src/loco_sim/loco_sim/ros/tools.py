# SPDX-License-Identifier: Apache-2.0
"""Standard messages beside the fast path, for RViz, Foxglove and ``ros2 topic echo``.

They repeat at a lower rate what `robot_state` says each tick; the parameter
``tool_rate`` of the node raises it for users who build on them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from tf2_msgs.msg import TFMessage

from loco_control.ros.codec import Codec
from loco_control.ros.convert import block_view, stamp_views, write_stamp
from loco_control.ros.node import LocoNode
from loco_control.ros.topics import topic
from loco_control.types import GroundTruth, RobotState


class ToolTopics:
    """Publishes joint_states, imu/data, ground_truth/odom, /tf and /clock at their table rates.

    Args:
        node: Node that owns the publishers.
        joints: Joint names, in array order.
        rate: Control rate [Hz].
    """

    def __init__(self, node: LocoNode, joints: tuple[str, ...], rate: float):
        chosen = node.declare_parameter("tool_rate", 0.0).value  # 0: as in the table
        self._rows = []
        for name, encode in encoders(joints).items():
            wanted = topic(name).rate if name == "/clock" else chosen or topic(name).rate
            every = max(1, round(rate / wanted))
            self._rows.append((node.raw_output(name), encode, every))

    def publish(self, state: RobotState, truth: GroundTruth) -> None:
        """Publish what is due at the tick of `state`."""
        for publish, encode, every in self._rows:
            if state.tick % every == 0:
                publish(encode(state, truth))


def encoders(joints: tuple[str, ...]) -> dict[str, Callable[[RobotState, GroundTruth], bytes]]:
    """Function per tool topic that gives the serialised message of a tick."""
    blocks = _blocks(len(joints))
    return {name: _encoder(message, *blocks[name]) for name, message in _templates(joints).items()}


def _encoder(template: Any, stamped: str, blocks: list) -> Callable:
    """Encoder of a template: its stamp, then runs of doubles, each from a function of a tick."""
    record = Codec(template).record()
    stamp = stamp_views(record, stamped)
    filled = [(block_view(record, path, count), value) for path, count, value in blocks]

    def encode(state: RobotState, truth: GroundTruth) -> bytes:
        write_stamp(stamp, state.t)
        for view, value in filled:
            view[...] = value(state, truth)
        return record.tobytes()

    return encode


def _templates(joints: tuple[str, ...]) -> dict[str, Any]:
    zeros = [0.0] * len(joints)
    states = JointState(name=list(joints), position=zeros, velocity=zeros, effort=zeros)
    states.header.frame_id = "base_link"
    imu = Imu()
    imu.header.frame_id = "base_link"
    odometry = Odometry(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    transform = TransformStamped(child_frame_id="base_link")
    transform.header.frame_id = "odom"
    return {
        "joint_states": states,
        "imu/data": imu,
        "ground_truth/odom": odometry,
        "/tf": TFMessage(transforms=[transform]),
        "/clock": Clock(),
    }


_TRUE_POSE = [(3, lambda state, truth: truth.position), (4, lambda state, truth: truth.orientation)]


def _blocks(joints: int) -> dict[str, tuple[str, list]]:
    """Per topic: where its stamp is, and path, length and value of each run of doubles."""
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
        "/tf": (
            "transforms.0.header.stamp",
            [
                ("transforms.0.transform.translation.x", *position),
                ("transforms.0.transform.rotation.x", *orientation),
            ],
        ),
        "/clock": ("clock", []),
    }
