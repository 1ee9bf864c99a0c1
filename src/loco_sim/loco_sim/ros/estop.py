# SPDX-License-Identifier: Apache-2.0
"""The latched emergency stop of a plant: by topic, by service, or by the plant itself."""

from __future__ import annotations

from collections.abc import Callable

from std_msgs.msg import Bool
from std_srvs.srv import SetBool

from loco_control.ros.node import LocoNode

SERVICE = "set_estop"


class EmergencyStop:
    """Holds until it is reset by the service; nothing else ends it.

    Args:
        node: The plant's node: true on its topic `estop`, or to its service `set_estop`,
            stops; false to the service resets, false on the topic does nothing.
        tell: Is called with the kind of event and the reason.

    Attributes:
        reason: Why it is engaged, "" while it is not.
    """

    def __init__(self, node: LocoNode, tell: Callable[[str, str], None]):
        self.reason, self._tell = "", tell
        node.input("estop", self._on_topic)
        node.create_service(SetBool, SERVICE, self._on_service)

    def engage(self, reason: str) -> None:
        """Stop; the first reason stays."""
        if not self.reason:
            self.reason = reason
            self._tell("estop", reason)

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
            self._tell("estop reset", response.message)
        else:
            response.message = "it is not stopped"
        return response
