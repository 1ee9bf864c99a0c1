# SPDX-License-Identifier: Apache-2.0
"""Bags of standard messages, as other programs record them."""

from __future__ import annotations

from rclpy.serialization import serialize_message

from loco_bringup.bag.writer import BagWriter
from loco_control.ros.messages.definitions import definition, type_hash


def write(folder, *, attach=None, late=0.0, about=None, **topics):
    """Write a bag, and return its folder.

    Args:
        folder: New folder.
        attach: Texts by the name of the file that is attached.
        late: Time of logging after the time of a message [s].
        about: Custom data of the bag.
        topics: Function that makes a message of a time [s], and the times; ``__`` in a name is a
            slash.
    """
    writer = BagWriter(folder, custom_data=about)
    for name, (make, times) in topics.items():
        cls = type(make(0.0))
        kind = f"{cls.__module__.split('.')[0]}/msg/{cls.__name__}"
        topic = "/" + name.replace("__", "/")
        writer.add_topic(topic, kind, definition(kind), type_hash(kind), [])
        for t in times:
            data = bytes(serialize_message(make(float(t))))
            writer.write(topic, data, round((t + late) * 1e9))
    for name, text in (attach or {}).items():
        writer.attach(name, text.encode())
    writer.close()
    return folder
