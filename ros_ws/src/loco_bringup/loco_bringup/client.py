# SPDX-License-Identifier: Apache-2.0
"""Node of a command: it is in the graph for as long as the command runs."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from threading import current_thread, main_thread
from typing import Any

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from loco_control.ros.messages.installed import profile
from loco_control.ros.parameters import sealed_node

_WAIT = 0.02  # longest wait for a message, which neither a signal nor a condition ends [s]


class GraphClient:
    """Node with a context and an executor of its own; use it as a context manager.

    Ctrl-C raises KeyboardInterrupt, between two messages while it spins: within a message, the
    executor's C++ would log an error, or make a RuntimeError of it. The context stays valid.

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
        """Handle messages for a wall time [s]; Ctrl-C ends it."""
        self.wait(lambda: False, seconds)

    def wait(self, condition: Callable[[], Any], seconds: float = float("inf")) -> bool:
        """Handle messages until a condition holds; returns False after the time-out [s].

        Raises:
            KeyboardInterrupt: Ctrl-C was pressed, or the signal SIGINT came.
        """
        end, interrupts = time.monotonic() + seconds, list[int]()
        handler = signal.getsignal(signal.SIGINT)
        notes = handler is signal.default_int_handler and current_thread() is main_thread()
        if notes:
            signal.signal(signal.SIGINT, lambda number, _: interrupts.append(number))
        try:
            while not (holds := bool(condition())) and not interrupts and time.monotonic() < end:
                self.executor.spin_once(timeout_sec=min(_WAIT, max(0.0, end - time.monotonic())))
        finally:
            if notes:
                signal.signal(signal.SIGINT, handler)
        if interrupts:
            raise KeyboardInterrupt
        return holds


def kind_of(qos: QoSProfile) -> tuple[bool, bool]:
    """Whether a QoS profile is reliable, and whether it is latched."""
    reliable = qos.reliability == ReliabilityPolicy.RELIABLE
    return reliable, qos.durability == DurabilityPolicy.TRANSIENT_LOCAL


def matching(writers: Sequence[Any], depth: int) -> QoSProfile:
    """QoS profile compatible with every writer: the weakest reliability and durability."""
    policies = [kind_of(writer.qos_profile) for writer in writers] or [(False, False)]
    return profile(*map(all, zip(*policies, strict=True)), depth)
