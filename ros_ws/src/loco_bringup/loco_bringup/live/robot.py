# SPDX-License-Identifier: Apache-2.0
"""Interface of another node to a running robot: its signals, and models sent to it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.validate_full_topic_name import validate_full_topic_name
from std_msgs.msg import String

from loco_control.exceptions import GraphError, LocoError, ParameterError, shown
from loco_control.ros.messages.joint_codec import FRAME, JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_learning.calibration.live import Signals
from loco_msgs.msg import Event
from loco_sim.robot.robot import Robot

STATES, COMMANDS = "joint_states", "joint_command"
_DEPTH = 2000  # queue length [messages]; robots do not wait for this listener


class LiveRobot:
    """Subscriber to a robot in a namespace.

    Its subscriptions are created with the object. Earlier ones could be counted by a plant that
    waits for its controllers.

    Args:
        node: `LocoNode` that listens.
        namespace: Namespace of the robot.
        robot: Description of the robot: names and order of its joints.
        span: Simulated time for which signals are retained [s].
        skip: Simulated time at which listening begins [s], after the robot's start-up.

    Attributes:
        signals: Signals that the robot published.
        heard: Wall time of the robot's newest message [s].
        models: Simulated times at which the robot switched to another model [s].
    """

    def __init__(self, node: Node, namespace: str, robot: Robot, span: float, skip: float) -> None:
        self.name = "/" + namespace.strip("/")
        self._node, self._skip = node, skip
        driven = [robot.joints[i] for i in robot.driven]
        self.signals = Signals(self.name, robot.joints, driven, span)
        self.heard = time.monotonic()
        self.models: list[float] = []
        self._error = ""  # text only: an exception would keep the frames of the executor alive
        states = JointCodec(robot.joints, topic(self.name, STATES), frame=FRAME)
        commands = JointCodec(driven, topic(self.name, COMMANDS), ("position", "velocity"))
        self._subscriptions = [
            self._listen(STATES, self._reader(states, self.signals.add_state)),
            self._listen(COMMANDS, self._reader(commands, self.signals.add_command)),
            self._listen("events", node.reader("events", Event, self._on_event)),
        ]
        self._sender: Any = None

    def _listen(self, name: str, callback: Callable) -> Any:
        row = JOINT_TOPICS[name]
        return self._node.create_subscription(
            row.type, topic(self.name, name), callback, row.qos.reader(_DEPTH), raw=True
        )

    def _reader(self, codec: JointCodec, add: Callable) -> Callable[[bytes], None]:
        def receive(data: bytes) -> None:
            self.heard = time.monotonic()
            try:
                values = codec.read(data)
            except LocoError as error:
                self._error = self._error or str(error)
                return
            if values.time >= self._skip * 1e9:
                add(values.time / 1e9, values.q)

        return receive

    def _on_event(self, event: Any) -> None:
        if event.kind == "model loaded":
            self.models.append(event.stamp.sec + event.stamp.nanosec / 1e9)

    def model_at(self, t: float) -> int:
        """Index of the model that was active at a simulated time [s]; 0 is the initial one."""
        return sum(1 for since in self.models if since <= t)

    def check(self, silence: float) -> None:
        """Raise an error if the robot is silent or its messages do not match.

        Args:
            silence: Wall time without a message after which the robot counts as gone [s].

        Raises:
            GraphError: The robot has been silent for too long.
            ParameterError: The joints in the messages are not those of the robot.
        """
        if self._error:
            raise ParameterError(self._error)
        if time.monotonic() - self.heard > silence:
            raise GraphError(
                f"{topic(self.name, STATES)} and {topic(self.name, COMMANDS)} have been silent "
                f"for {silence:g} s"
            )

    def send(self, text: str) -> None:
        """Send a model to the robot, as the text of a model.yaml."""
        if self._sender is None:
            row = JOINT_TOPICS["model"]
            name = topic(self.name, row.name)
            self._sender = self._node.create_publisher(row.type, name, row.qos.writer())
        self._sender.publish(String(data=text))

    def close(self) -> None:
        """Stop listening."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        if self._sender is not None:
            self._node.destroy_publisher(self._sender)
        self._subscriptions, self._sender = [], None


def topic(namespace: str, name: str) -> str:
    """Full name of a topic in a namespace."""
    return "/" + "/".join(part for part in (namespace.strip("/"), name) if part)


def check_namespace(namespace: str) -> None:
    """Refuse an invalid namespace.

    Raises:
        ParameterError: It has characters or a length that ROS does not allow.
    """
    try:
        validate_full_topic_name(topic(namespace, STATES))
    except InvalidTopicNameException:
        raise ParameterError(
            f"a namespace has letters, digits and _ between its /, got {shown(namespace)}"
        ) from None


def robots(node: Node) -> list[str]:
    """Namespaces with a publisher of joint states."""
    states = [n for n, _ in node.get_topic_names_and_types() if n.rsplit("/", 1)[-1] == STATES]
    return sorted(name[: -len(STATES) - 1] or "/" for name in states if node.count_publishers(name))
