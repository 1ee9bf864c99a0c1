# SPDX-License-Identifier: Apache-2.0
"""What loco records and sends is what native nodes send, to the byte, and every reader takes it."""

from __future__ import annotations

import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import rclpy
from mcap_ros2.reader import read_ros2_messages
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from sensor_msgs.msg import JointState

from loco_bringup.bag.reader import Bag
from loco_bringup.logs.export import to_plain
from loco_control.ros.messages import definitions
from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.installed import ros_class
from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.msd_topics import MSD_TOPICS
from loco_control.ros.messages.topics import TOPICS

GOLDEN = Path(__file__).parents[1] / "golden"
BAGS = sorted(path.name for path in GOLDEN.iterdir() if path.is_dir())
KINDS = sorted({row.kind for table in (TOPICS, JOINT_TOPICS, MSD_TOPICS) for row in table.values()})
LISTS = [
    {"name": [], "position": []},
    {"name": ["a"], "position": [1.0]},
    {"name": ["a", "größe"], "velocity": [1.0, -2.0]},
    {"name": ["a", "bcd", "e"], "effort": [1.0, 2.0, 3.0]},
    {"name": ["a", "bc"], "position": [1.0, 2.0], "velocity": [3.0, 4.0]},
    {"name": ["ab"], "position": [1.0], "velocity": [2.0], "effort": [3.0]},
]


def numbers(value):
    """All numbers and texts of a message of any library, flat and in order."""
    if isinstance(value, (list, tuple, np.ndarray)):
        return [x for v in value for x in numbers(v)]
    if isinstance(value, dict):
        return [x for key, v in value.items() if key != "__msgtype__" for x in numbers(v)]
    if hasattr(value, "__dataclass_fields__"):
        return numbers({k: getattr(value, k) for k in value.__dataclass_fields__})
    if hasattr(value, "__slots__"):
        return numbers({k: getattr(value, k) for k in value.__slots__})
    return [value]


@pytest.mark.parametrize("name", BAGS)
def test_every_message_of_a_golden_bag_is_read_alike_by_all(name):
    bag = Bag(GOLDEN / name)
    ours = {topic: bag.raw(topic)[1] for topic in bag.topics}
    count: Counter[str] = Counter()
    with AnyReader([GOLDEN / name], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, _, data in reader.messages():
            topic = connection.topic
            native = deserialize_message(
                ours[topic][count[topic]], ros_class(bag.topics[topic].type)
            )
            theirs = numbers(reader.deserialize(data, connection.msgtype))
            assert theirs == numbers(to_plain(native))
            count[topic] += 1
    assert count == {topic: len(messages) for topic, messages in ours.items()}
    others: Counter[str] = Counter()
    for message in read_ros2_messages(bag.path):
        topic = message.channel.topic
        mine = numbers(to_plain(bag.message(topic, ours[topic][others[topic]])))
        assert numbers(message.ros_msg) == mine
        others[topic] += 1
    assert others == count


@pytest.mark.parametrize("kind", KINDS)
def test_a_strict_reader_takes_every_message_that_a_graph_sends(kind):
    """Up to three bytes that round a length to four are the most that it leaves unread."""
    store = get_typestore(Stores.ROS2_JAZZY)
    known = get_types_from_msg(definitions.definition(kind), kind)
    store.register({name: fields for name, fields in known.items() if name not in store.fielddefs})
    message = ros_class(kind)()
    read = store.deserialize_cdr(Codec(message).template, kind)
    theirs = numbers(read)
    assert (theirs[1:] if kind.endswith("/Empty") else theirs) == numbers(to_plain(message))


@pytest.mark.parametrize("fields", LISTS)
def test_joints_with_any_fields_left_out_are_taken_by_a_strict_reader(fields):
    message = JointState(**fields)
    read = get_typestore(Stores.ROS2_JAZZY).deserialize_cdr(
        Codec(message).template, "sensor_msgs/msg/JointState"
    )
    assert numbers(read) == numbers(to_plain(message))


@pytest.mark.ros
def test_the_bytes_are_those_of_a_native_node():
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        node, heard = rclpy.create_node("native"), []
        subscription = node.create_subscription(JointState, "x", heard.append, 10, raw=True)
        publisher = node.create_publisher(JointState, "x", 10)
        for fields in LISTS:
            message = JointState(**fields)
            heard.clear()
            until = time.monotonic() + 60.0
            while not heard and time.monotonic() < until:
                publisher.publish(message)
                rclpy.spin_once(node, timeout_sec=0.1)
            while rclpy.spin_once(node, timeout_sec=0.05):
                pass
            native = bytes(heard[-1])
            template = Codec(message).template
            assert len(native) == len(template)
            assert deserialize_message(template, JointState) == message
            written = [f for f in ("position", "velocity", "effort") if fields.get(f)]
            codec = JointCodec(message.name, "x", written)
            if fields.get("position"):
                assert codec.read(native).q.tolist() == fields["position"]
        node.destroy_subscription(subscription)
    finally:
        rclpy.try_shutdown()
