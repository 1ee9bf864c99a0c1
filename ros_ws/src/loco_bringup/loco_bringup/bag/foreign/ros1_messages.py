# SPDX-License-Identifier: Apache-2.0
"""Conversion of ROS 1 messages, from ROS 1 bags or MCAP, to CDR with the rosbags library."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

from loco_control.exceptions import BagError, MissingPackageError

ROS1 = "ros1"  # message encoding of an MCAP channel
_HEADER = "std_msgs/msg/Header"


def library(name: str, what: str) -> Any:
    """A module of rosbags.

    Args:
        name: Name of the module inside the package ``rosbags``.
        what: File that needs it, for error messages.

    Raises:
        MissingPackageError: rosbags is not installed.
    """
    try:
        return importlib.import_module(f"rosbags.{name}")
    except ModuleNotFoundError:
        raise MissingPackageError(
            f"{what} holds messages of ROS 1: reading them needs rosbags, which comes with "
            "`./loco install ros1`; or convert the bag with `rosbags-convert`"
        ) from None


def kind_of(name: str) -> str:
    """ROS 2 name, ``package/msg/Type``, of a ROS 1 type."""
    return name if "/msg/" in name else name.replace("/", "/msg/", 1)


def converter(name: str, text: str, what: str) -> tuple[Callable[[bytes], bytes], str]:
    """Function that converts serialised ROS 1 messages to CDR, and the ROS 2 definition.

    Args:
        name: Type of the messages, in the notation of ROS 1 or ROS 2.
        text: ROS 1 definition, including the definitions of nested types.
        what: File name for error messages.

    Raises:
        BagError: The text is not a valid definition.
        MissingPackageError: rosbags is not installed.
    """
    types, kind = library("typesys", what), kind_of(name)
    store = types.get_typestore(types.Stores.EMPTY)
    ros2 = types.get_typestore(types.Stores.ROS2_JAZZY)
    try:
        definitions = types.get_types_from_msg(text, kind)
        for base in (_HEADER, "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"):
            definitions[base] = ros2.fielddefs[base]  # a header of ROS 2 has no seq
        store.register(definitions)
        definition, _ = store.generate_msgdef(kind, ros_version=2)
    except Exception as error:  # noqa: BLE001  (its parser raises whatever a text leads to)
        raise BagError(f"{what}: the definition of {name} cannot be read: {error}") from None

    def convert(data: bytes) -> bytes:
        try:
            return bytes(store.ros1_to_cdr(data, kind))
        except Exception as error:  # noqa: BLE001  (as above)
            raise BagError(f"{what}: {len(data)} bytes are no {name} of ROS 1: {error}") from None

    return convert, definition
