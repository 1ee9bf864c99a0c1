# SPDX-License-Identifier: Apache-2.0
"""Classes of messages and QoS profiles of an installed ROS, by name.

The topic tables, which name these classes, are also used without ROS, by rollouts, reports and
lists. So the ROS modules are imported only when a node needs them.
"""

from __future__ import annotations

import importlib
import re
from functools import cache
from typing import Any

from ...exceptions import NameUnknownError


@cache
def ros_class(name: str) -> type:
    """Message class of ROS, for publishers and subscriptions.

    Args:
        name: Full name, ``package/msg/Type``.

    Raises:
        NameUnknownError: The package is not installed or has no such message.
    """
    if not re.fullmatch(r"\w+/msg/\w+", name):
        raise NameUnknownError("message type", name, [])
    package, _, short = name.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), short)
    except (ImportError, AttributeError):
        raise NameUnknownError("installed message type", name, []) from None


def profile(reliable: bool, latched: bool, depth: int) -> Any:
    """QoS profile of rclpy with history KEEP_LAST.

    Args:
        reliable: Whether lost messages are sent again.
        latched: Whether a late reader receives the last messages.
        depth: Number of messages in the queue.
    """
    qos = importlib.import_module("rclpy.qos")
    reliability, durability = qos.ReliabilityPolicy, qos.DurabilityPolicy
    return qos.QoSProfile(
        history=qos.HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
        durability=durability.TRANSIENT_LOCAL if latched else durability.VOLATILE,
    )
