# SPDX-License-Identifier: Apache-2.0
"""The codec says the same as rclpy's serialiser, for every message of the graph."""

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, JointState
from tf2_msgs.msg import TFMessage

from loco_control.exceptions import ParameterError
from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.topics import TOPICS


def templates():
    joints = JointState(name=["a", "bcd"], position=[0.0, 0.0], velocity=[0.0, 0.0])
    joints.header.frame_id = "base_link"
    odometry = Odometry(child_frame_id="base_link")
    odometry.header.frame_id = "odom"
    fixed = [
        t.type()
        for t in TOPICS.values()
        if t.type.__module__.startswith("loco_msgs") and t.name != "events"
    ]
    return [*fixed, joints, odometry, Imu(), TFMessage(transforms=[TransformStamped()])]


def fill(record, rng):
    for name in record.dtype.names:
        field = record[name]
        if field.dtype == bool:
            record[name] = rng.integers(0, 2, field.shape).astype(bool)
        elif field.dtype.kind == "f":
            record[name] = rng.normal(size=field.shape)
        else:
            record[name] = rng.integers(0, 100, field.shape)


@pytest.mark.parametrize("template", templates(), ids=lambda t: type(t).__name__)
def test_encoded_bytes_deserialise_to_the_values_that_were_written(template):
    codec = Codec(template)
    record = codec.record()
    fill(record, np.random.default_rng(1))
    message = deserialize_message(record.tobytes(), type(template))
    # Its Python interface leaves room behind a message that a native node does not send.
    again = codec.decode(bytes(serialize_message(message))[: codec.dtype.itemsize])
    for name in codec.dtype.names:
        np.testing.assert_array_equal(again[name], record[name], err_msg=name)


@pytest.mark.parametrize("template", templates(), ids=lambda t: type(t).__name__)
def test_template_bytes_are_the_message(template):
    assert deserialize_message(Codec(template).template, type(template)) == template


def test_equal_messages_are_equal_bytes():
    # rclpy leaves padding as it finds it; two codecs must not.
    template = templates()[-3]
    assert len({Codec(template).record().tobytes() for _ in range(20)}) == 1


def test_other_lengths_are_refused():
    codec = Codec(JointState(name=["a"]))
    longer = bytes(serialize_message(JointState(name=["a", "b"])))
    with pytest.raises(ParameterError, match="bytes, got"):
        codec.decode(longer)
