# SPDX-License-Identifier: Apache-2.0
"""Bridge for ros2_control as a controller: forwards its commands with the stamps of states."""

from __future__ import annotations

from rclpy.node import Node
from sensor_msgs.msg import JointState

from loco_control.ros.parameters import seal

from ..export.ros2_control import COMMANDS, STATES


class Ros2ControlNode(Node):
    """Plain node that answers each state with the newest command of ros2_control.

    The topic-based hardware interface stamps commands with its own time; the plant needs the stamp
    of the answered state. Before the first command of ros2_control states are not answered, which
    the plant treats as missing commands (docs/safety.md).
    """

    def __init__(self) -> None:
        super().__init__("reflex_network")  # name of the replaced node
        seal(self)
        self._newest: JointState | None = None
        self._command = self.create_publisher(JointState, "joint_command", 10)
        self.create_subscription(JointState, COMMANDS, self._take, 1)
        self.create_subscription(JointState, STATES, self._answer, 10)

    def _take(self, command: JointState) -> None:
        self._newest = command

    def _answer(self, state: JointState) -> None:
        newest = self._newest
        if newest is not None:
            # loco expects the torque of a torque drive in place of a position.
            position = newest.position or newest.effort
            answer = JointState(header=state.header, name=newest.name, position=position)
            self._command.publish(answer)
