# SPDX-License-Identifier: Apache-2.0
"""Latched emergency stop of a plant, by topic, service, lost heartbeat, or the plant itself."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from std_msgs.msg import Bool, Empty
from std_srvs.srv import SetBool

from loco_control.ros.node import LocoNode

SERVICE = "set_estop"


class EmergencyStop:
    """Emergency stop that is released by its service only.

    Args:
        node: The plant's node: true on topic `estop`, or to service `set_estop`,
            stops; false to the service resets, false on the topic does nothing.
        tell: Function called with the kind of event and the reason.

    Attributes:
        reason: Reason why it is engaged, "" if it is not.
    """

    def __init__(self, node: LocoNode, on_change: Callable[[str, str], None]):
        self.reason, self._on_change = "", on_change
        node.input("estop", self._on_topic)
        node.create_service(SetBool, SERVICE, self._on_service)

    def engage(self, reason: str) -> None:
        """Engage the stop; the first reason is retained."""
        if not self.reason:
            self.reason = reason
            self._on_change("estop", reason)

    def _on_topic(self, message: Bool) -> None:
        if message.data:
            self.engage("topic estop")

    def _on_service(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success = bool(request.data or self.reason)
        if request.data:
            self.engage(f"service {SERVICE}")
            response.message = f"stopped: {self.reason}"
        elif self.reason:
            response.message = f"reset; it was stopped by {self.reason}"
            self.reason = ""
            self._on_change("estop reset", response.message)
        else:
            response.message = "it is not stopped"
        return response


class Heartbeat:
    """Monitor that stops the robot when the operator's heartbeat is lost.

    Args:
        node: The plant's node, which subscribes to the topic `heartbeat`.
        longest: Longest wall time between heartbeats [s]; 0 to require none.
        engage: Function that engages the emergency stop, with the reason.
    """

    def __init__(self, node: LocoNode, longest: float, engage: Callable[[str], None]):
        self._longest, self._engage = longest, engage
        self._last = math.inf  # wall time of the last beat; not monitored before `start`
        node.input("heartbeat", self._on_beat)
        if longest:
            node.create_timer(longest / 4.0, self._check)

    def start(self) -> None:
        """Start monitoring, when the robot may move."""
        self._last = time.monotonic()

    def _on_beat(self, message: Empty) -> None:
        if self._last < math.inf:
            self._last = time.monotonic()

    def _check(self) -> None:
        silence = time.monotonic() - self._last
        if silence > self._longest:
            self._engage(f"no heartbeat for {self._longest:g} s")
