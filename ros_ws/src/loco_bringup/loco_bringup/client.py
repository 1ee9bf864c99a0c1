# SPDX-License-Identifier: Apache-2.0
"""Node of a command: it is in the graph for as long as the command runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rclpy
import rclpy.task
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from loco_control.ros.messages.installed import profile
from loco_control.ros.parameters import sealed_node


class GraphClient:
    """Node with a context and an executor of its own; use it as a context manager.

    No signal handler is installed: Ctrl-C raises KeyboardInterrupt, and the context stays valid.

    Args:
        name: Name of the node.
        namespace: Namespace of the node.
    """

    def __init__(self, name: str, namespace: str = ""):
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, signal_handler_options=SignalHandlerOptions.NO)
        self.node = sealed_node(name, context=self.context, namespace=namespace)
        self.executor = EventsExecutor(context=self.context)
        self.executor.add_node(self.node)
        self._never = rclpy.task.Future()

    def __enter__(self) -> Any:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph; also end the executor, which would keep the endpoints alive."""
        self.executor.shutdown()  # first: it uses the node
        self.node.destroy_node()
        self.context.try_shutdown()

    def spin(self, seconds: float) -> None:
        """Handle messages for a wall time [s]."""
        self.executor.spin_until_future_complete(self._never, timeout_sec=seconds)


def kind_of(qos: QoSProfile) -> tuple[bool, bool]:
    """Whether a QoS profile is reliable, and whether it is latched."""
    reliable = qos.reliability == ReliabilityPolicy.RELIABLE
    return reliable, qos.durability == DurabilityPolicy.TRANSIENT_LOCAL


def matching(writers: Sequence[Any], depth: int) -> QoSProfile:
    """QoS profile compatible with every writer: the weakest reliability and durability."""
    kinds = [kind_of(writer.qos_profile) for writer in writers] or [(False, False)]
    return profile(*map(all, zip(*kinds, strict=True)), depth)
