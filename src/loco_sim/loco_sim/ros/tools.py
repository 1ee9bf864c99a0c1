# SPDX-License-Identifier: Apache-2.0
"""Publishers of standard messages for RViz, Foxglove and ``ros2 topic echo``.

They carry the contents of `robot_state` at a lower rate, which the parameter ``tool_rate`` of the
node can increase.
"""

from __future__ import annotations

from loco_control.ros.messages.topics import topic
from loco_control.ros.node import LocoNode
from loco_control.types import GroundTruth, RobotState

from ..robot.robot import Robot
from .encoders import encoders


class ToolTopics:
    """Publishers of joint_states, imu/data, ground_truth/odom, /tf and /clock at their table rates.

    Args:
        node: Node that owns the publishers.
        robot: Robot described by the messages.
        rate: Control rate [Hz].
    """

    def __init__(self, node: LocoNode, robot: Robot, rate: float):
        tool_rate = node.declare_parameter("tool_rate", 0.0).value  # 0: rates of the table
        self._rows = []
        for name, encode in encoders(robot).items():
            topic_rate = topic(name).rate if name == "/clock" else tool_rate or topic(name).rate
            every = max(1, round(rate / topic_rate))
            self._rows.append((node.raw_output(name), encode, every))

    def publish(self, state: RobotState, truth: GroundTruth) -> None:
        """Publish the messages due at the tick of `state`."""
        for publish, encode, every in self._rows:
            if state.tick % every == 0:
                publish(encode(state, truth))
