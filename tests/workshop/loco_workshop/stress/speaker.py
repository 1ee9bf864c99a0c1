# SPDX-License-Identifier: Apache-2.0
"""Node `speaker`: publishes valid messages on an operator topic, as targets for faults."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Bool, Float64, String

from loco_control.ros.messages.convert import TICK
from loco_control.ros.node import LocoNode

EVERY = 5  # ticks between two messages


def said(topic: str, tick: int) -> Any:
    """Valid operator message for a tick; None for topics that nodes publish."""
    low_speed = bool(tick // 250 % 2)
    if topic == "cmd_vel":
        message = TwistStamped()
        message.twist.linear.x = 0.2 if low_speed else 0.25
        return message
    return {
        "gait_frequency": Float64(data=1.6 if low_speed else 1.7),
        "stance_estimator": String(data="pse"),
        "estop": Bool(data=False),
    }.get(topic)


class Speaker(LocoNode):
    """Node that publishes on an operator topic every `EVERY` ticks of the plant."""

    def __init__(self) -> None:
        super().__init__("speaker")
        self._topic = self.declare_parameter("topic", "estop").value
        self._publish = self.output(self._topic).publish
        row = self.row("robot_state")
        self._states = self.create_subscription(
            row.type, row.name, self._on_state, row.qos.reader(), raw=True
        )

    def _on_state(self, data: bytes) -> None:
        tick = int.from_bytes(data[TICK], "little")
        if tick % EVERY == 0:
            self._publish(said(self._topic, tick))
