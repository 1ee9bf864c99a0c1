# SPDX-License-Identifier: Apache-2.0
"""Classes of messages and QoS profiles of an installed ROS, by name.

The tables of topics name them, and are read where no ROS is, too: by rollouts, reports and
lists. So these modules are imported when a node asks for them.
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
    """QoS profile of rclpy that keeps the last messages.

    Args:
        reliable: Lost messages are sent again.
        latched: A reader that comes late gets the last messages.
        depth: Messages that are kept.
    """
    qos = importlib.import_module("rclpy.qos")
    reliability, durability = qos.ReliabilityPolicy, qos.DurabilityPolicy
    return qos.QoSProfile(
        history=qos.HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=reliability.RELIABLE if reliable else reliability.BEST_EFFORT,
        durability=durability.TRANSIENT_LOCAL if latched else durability.VOLATILE,
    )
