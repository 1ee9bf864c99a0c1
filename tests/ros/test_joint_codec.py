# SPDX-License-Identifier: Apache-2.0
"""JointState and Imu messages come back as they were sent, whoever wrote them."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, JointState

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.ros.messages.joint_codec import ImuReader, JointCodec, stamp_ns, tick_of
from loco_control.ros.messages.joint_topics import JOINT_NODES, JOINT_TOPICS, TABLES
from loco_control.ros.messages.topics import to_stamp

NAMES = ("lf_hfe_joint", "knee", "x")
RNG = np.random.default_rng(3)
Q, DQ, TAU = RNG.normal(size=(3, 3))


@pytest.mark.parametrize("fields", [("position",), ("position", "velocity"), None])
def test_bytes_are_those_of_a_message_and_come_back(fields):
    codec = JointCodec(NAMES, **({"fields": fields} if fields else {}))
    values = (Q, DQ, TAU)[: len(fields or "abc")]
    data = codec.pack(12.34, *values)
    message = deserialize_message(data, JointState)
    assert message.name == list(NAMES)
    assert message.header.stamp == to_stamp(12.34)
    np.testing.assert_array_equal(message.position, Q)
    read = codec.read(data)
    assert read.time == stamp_ns(data) == 12_340_000_000
    for got, value in zip(read[1:], [*values, *[np.zeros(3)] * (3 - len(values))], strict=True):
        np.testing.assert_array_equal(got, value)


def test_order_frame_and_missing_fields_of_others_do_not_matter():
    message = JointState(name=list(NAMES[::-1]), position=Q[::-1].tolist())
    message.header.frame_id = "elsewhere"
    message.header.stamp = to_stamp(0.5)
    read = JointCodec(NAMES).read(serialize_message(message))
    np.testing.assert_array_equal(read.q, Q)
    np.testing.assert_array_equal(read.dq, np.zeros(3))
    assert read.time == 500_000_000


@pytest.mark.parametrize(
    ("message", "error", "words"),
    [
        (JointState(name=["knee", "x", "hip"]), NameUnknownError, "'hip'"),
        (JointState(name=["knee", "x"], position=[0.0] * 2), ParameterError, "got knee, x"),
        (JointState(name=[*NAMES, "x"], position=[0.0] * 4), ParameterError, "once"),
        (JointState(name=list(NAMES), position=[0.0]), ParameterError, "3 values in position"),
        (JointState(name=list(NAMES)), ParameterError, "3 values in position, got 0"),
    ],
)
def test_messages_that_do_not_fit_are_named(message, error, words):
    with pytest.raises(error, match="joint_command.*") as caught:
        JointCodec(NAMES, "joint_command").read(serialize_message(message))
    assert words in str(caught.value)


def test_lengths_that_agree_in_bytes_are_not_confused():
    """Velocity without effort and effort without velocity have messages of one size."""
    codec = JointCodec(NAMES, fields=("position", "velocity"))
    other = JointCodec(NAMES, fields=("position", "effort"))
    read = codec.read(other.pack(0.0, Q, TAU))
    np.testing.assert_array_equal(read.dq, np.zeros(3))
    np.testing.assert_array_equal(read.tau, TAU)


@pytest.mark.parametrize("frame", ["base_link", "imu", ""])
def test_imu_messages_are_read_in_any_frame(frame):
    message = Imu()
    message.header.frame_id = frame
    message.header.stamp = to_stamp(3.0)
    q, w, a = message.orientation, message.angular_velocity, message.linear_acceleration
    q.x, q.y, q.z, q.w = 0.1, 0.2, 0.3, 0.4
    w.x, w.y, w.z, a.x, a.y, a.z = 1.0, 2.0, 3.0, 4.0, 5.0, 6.0
    read = ImuReader().read(serialize_message(message))
    assert read.time == 3_000_000_000
    np.testing.assert_array_equal(np.concatenate(read[1:]), [0.1, 0.2, 0.3, 0.4, 1, 2, 3, 4, 5, 6])


@pytest.mark.parametrize("rate", [100.0, 30.0, 250.0, 1000.0 / 3.0])
def test_stamps_and_ticks_are_one_to_one(rate):
    ticks = range(0, 100_000, 37)
    assert [tick_of(round(k / rate * 1e9), rate) for k in ticks] == list(ticks)


@pytest.mark.parametrize("row", JOINT_TOPICS.values(), ids=lambda r: r.name)
def test_writers_and_readers_of_the_joint_graph_are_its_nodes(row):
    assert {row.writer, *row.readers} <= {*JOINT_NODES, "recorder", "any"}
    assert row.doc


def test_only_topics_that_no_robot_owns_are_absolute():
    absolute = {name for name in JOINT_TOPICS if name.startswith("/")}
    assert absolute == {"/diagnostics", "/clock", "/tf"}
    assert TABLES["joint"] is JOINT_TOPICS
