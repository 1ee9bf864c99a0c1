# SPDX-License-Identifier: Apache-2.0
"""ros2_control in the place of a controller: its commands, with the stamps of the robot's ticks."""

from __future__ import annotations

from rclpy.node import Node
from sensor_msgs.msg import JointState

from loco_control.ros.parameters import seal

from ..export.ros2_control import COMMANDS, STATES


class Ros2ControlNode(Node):
    """A guest that answers each state with the newest command of ros2_control.

    The topic-based hardware interface stamps commands with its own time; a plant wants the stamp
    of the state that is answered. Until ros2_control has spoken nothing is answered, which the
    plant takes for silence (docs/safety.md).
    """

    def __init__(self) -> None:
        super().__init__("reflex_network")  # the place it takes
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
            # A torque drive of loco has its torque where others have a position.
            position = newest.position or newest.effort
            answer = JointState(header=state.header, name=newest.name, position=position)
            self._command.publish(answer)
