# SPDX-License-Identifier: Apache-2.0
"""A robot of the joint graph as another node sees it: its signals, the models it gets."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from std_msgs.msg import String

from loco_control.exceptions import GraphError, LocoError, ParameterError
from loco_control.ros.messages.joint_codec import FRAME, JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_learning.calibration.live import Signals
from loco_msgs.msg import Event
from loco_sim.robot.robot import Robot

STATES, COMMANDS = "joint_states", "joint_command"
_DEPTH = 2000  # messages that wait for this listener when the machine is busy; robots do not wait


class LiveRobot:
    """Listens to a robot in a namespace.

    Its subscriptions are made when it is: before that, a plant that counts who listens
    does not take this listener for one of its controllers.

    Args:
        node: `LocoNode` that listens.
        namespace: Namespace of the robot.
        robot: Description of the robot: names and order of its joints.
        span: Simulated time that is kept [s].
        skip: Simulated time at which listening begins [s]; before it the robot gets up.

    Attributes:
        signals: Signals that the robot published.
        heard: Wall time of its newest message [s].
        models: Simulated times at which it became another model [s].
    """

    def __init__(self, node: Node, namespace: str, robot: Robot, span: float, skip: float) -> None:
        self.name = "/" + namespace.strip("/")
        self._node, self._skip = node, skip
        driven = [robot.joints[i] for i in robot.driven]
        self.signals = Signals(self.name, robot.joints, driven, span)
        self.heard = time.monotonic()
        self.models: list[float] = []
        self._error = ""  # text: an exception would keep the frames of the executor alive
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
        """Number of the model that ran at a simulated time [s]; 0 is the one it began with."""
        return sum(1 for since in self.models if since <= t)

    def check(self, silence: float) -> None:
        """Raise what is wrong with the robot.

        Args:
            silence: Wall time without a message after which it counts as gone [s].

        Raises:
            GraphError: It has been silent for too long.
            ParameterError: The messages are of other joints than those of the robot.
        """
        if self._error:
            raise ParameterError(self._error)
        if time.monotonic() - self.heard > silence:
            raise GraphError(
                f"{topic(self.name, STATES)} and {topic(self.name, COMMANDS)} have been silent "
                f"for {silence:g} s"
            )

    def send(self, text: str) -> None:
        """Give the robot a model, the text of a model.yaml."""
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


def robots(node: Node) -> list[str]:
    """Namespaces in which somebody publishes joint states."""
    names = [name for name, _ in node.get_topic_names_and_types()]
    states = [name for name in names if name.rsplit("/", 1)[-1] == STATES]
    return sorted(name[: -len(STATES) - 1] or "/" for name in states if node.count_publishers(name))
