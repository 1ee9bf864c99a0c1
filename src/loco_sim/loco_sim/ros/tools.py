# SPDX-License-Identifier: Apache-2.0
"""Standard messages beside the fast path, for RViz, Foxglove and ``ros2 topic echo``.

They repeat at a lower rate what `robot_state` says each tick; the parameter
``tool_rate`` of the node raises it for users who build on them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from tf2_msgs.msg import TFMessage

from loco_control.ros.codec import Codec
from loco_control.ros.convert import stamp
from loco_control.ros.node import LocoNode
from loco_control.ros.topics import topic
from loco_control.types import GroundTruth, RobotState

_XYZ, _XYZW = "xyz", "xyzw"


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
            self._rows.append((node.output(name), encode, every))

    def publish(self, state: RobotState, truth: GroundTruth) -> None:
        """Publish what is due at the tick of `state`."""
        for publisher, encode, every in self._rows:
            if state.tick % every == 0:
                publisher.publish(encode(state, truth))


def encoders(joints: tuple[str, ...]) -> dict[str, Callable[[RobotState, GroundTruth], bytes]]:
    """Function per tool topic that gives the serialised message of a tick."""
    return {name: _encoder(template, _FILL[name]) for name, template in _templates(joints).items()}


def _encoder(template: Any, fill: Callable) -> Callable[[RobotState, GroundTruth], bytes]:
    record = Codec(template).record()

    def encode(state: RobotState, truth: GroundTruth) -> bytes:
        fill(record, state, truth)
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


def _set(record: np.ndarray, path: str, axes: str, values: np.ndarray) -> None:
    for axis, value in zip(axes, values, strict=True):
        record[f"{path}.{axis}"] = value


def _joint_states(record: np.ndarray, state: RobotState, truth: GroundTruth) -> None:
    stamp(record, "header.stamp", state.t)
    record["position"], record["velocity"], record["effort"] = state.q, state.dq, state.tau


def _imu(record: np.ndarray, state: RobotState, truth: GroundTruth) -> None:
    stamp(record, "header.stamp", state.t)
    _set(record, "orientation", _XYZW, state.orientation)
    _set(record, "angular_velocity", _XYZ, state.angular_velocity)
    _set(record, "linear_acceleration", _XYZ, state.linear_acceleration)


def _odometry(record: np.ndarray, state: RobotState, truth: GroundTruth) -> None:
    stamp(record, "header.stamp", truth.t)
    _set(record, "pose.pose.position", _XYZ, truth.position)
    _set(record, "pose.pose.orientation", _XYZW, truth.orientation)
    _set(record, "twist.twist.linear", _XYZ, truth.linear_velocity)
    _set(record, "twist.twist.angular", _XYZ, truth.angular_velocity)


def _transform(record: np.ndarray, state: RobotState, truth: GroundTruth) -> None:
    stamp(record, "transforms.0.header.stamp", truth.t)
    _set(record, "transforms.0.transform.translation", _XYZ, truth.position)
    _set(record, "transforms.0.transform.rotation", _XYZW, truth.orientation)


def _clock(record: np.ndarray, state: RobotState, truth: GroundTruth) -> None:
    stamp(record, "clock", state.t)


_FILL = {
    "joint_states": _joint_states,
    "imu/data": _imu,
    "ground_truth/odom": _odometry,
    "/tf": _transform,
    "/clock": _clock,
}
