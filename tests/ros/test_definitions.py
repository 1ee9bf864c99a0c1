# SPDX-License-Identifier: Apache-2.0
"""Definitions read as ROS reads them, and messages of them as rclpy serialises them."""

import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Imu, JointState
from tf2_msgs.msg import TFMessage

from loco_bringup.logs.export import to_plain as values_of
from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.ros.messages import definitions, plain
from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.installed import ros_class
from loco_control.ros.messages.joint_topics import TABLES

TOPICS = sorted({topic.kind for table in TABLES.values() for topic in table.values()})
INSTALLED = {
    f"{path.parts[-3]}/msg/{path.stem}": path
    for path in sorted(Path(sys.prefix, "share").glob("*/msg/*.msg"))
}


def test_every_installed_message_is_read_as_its_generator_read_it():
    assert len(INSTALLED) > 100
    for name, path in INSTALLED.items():
        hashes = json.loads(path.with_suffix(".json").read_text())["type_hashes"]
        hashes = {row["type_name"]: row["hash_string"] for row in hashes}
        assert definitions.type_hash(name) == hashes[name], name
        package = importlib.import_module(f"{path.parts[-3]}.msg")
        fields = {f.name: f.kind for f in definitions.fields_of(name.replace("/msg/", "/"))}
        assert fields == getattr(package, path.stem).get_fields_and_field_types(), name


@pytest.fixture
def without_ros(monkeypatch):
    """No package is installed, and nothing is remembered."""
    monkeypatch.setattr(definitions, "_prefixes", lambda: [])
    caches = definitions._text, definitions.fields_of, definitions.definition, definitions.type_hash
    hashes = {name: definitions.type_hash(name) for name in TOPICS}
    for cache in caches:
        cache.cache_clear()
    yield hashes
    for cache in caches:
        cache.cache_clear()


def test_our_topics_have_the_same_messages_without_ros(without_ros):
    assert {name: definitions.type_hash(name) for name in TOPICS} == without_ros
    for name in TOPICS:
        made = plain.message_class(name, definitions.definition(name))
        assert made.get_fields_and_field_types() == ros_class(name).get_fields_and_field_types()


def test_a_message_that_is_nowhere_is_refused(without_ros):
    with pytest.raises(NameUnknownError, match="installed message package.*std_msgs"):
        definitions.definition("no_msgs/msg/A")
    with pytest.raises(NameUnknownError, match="did you mean 'Stance'"):
        definitions.definition("loco_msgs/msg/Stanse")


def filled():
    rng = np.random.default_rng(4)
    joints = JointState(name=["a", "größe"], position=rng.normal(size=2).tolist(), velocity=[])
    joints.header.stamp.sec, joints.header.frame_id = -3, "map"
    imu = Imu(orientation_covariance=rng.normal(size=9))
    frames = TFMessage(transforms=[TransformStamped(child_frame_id=n) for n in ("x", "longer")])
    empty = [ros_class(name)() for name in TOPICS]
    return [joints, JointState(name=["a"], effort=[1.0]), imu, frames, TFMessage(), *empty]


def name_of(message):
    return f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}"


@pytest.mark.parametrize("message", filled(), ids=lambda m: type(m).__name__)
def test_bytes_of_rclpy_are_read(message):
    cls = plain.message_class(name_of(message), definitions.definition(name_of(message)))
    data = bytes(serialize_message(message))
    read = plain.deserialize(data, cls)
    assert read.get_fields_and_field_types() == message.get_fields_and_field_types()
    mine, theirs = values_of(read), values_of(message)
    if "level" not in mine:  # rclpy gives an octet as bytes
        assert mine == theirs
    codec, same = Codec(message), Codec(read)
    assert len(Codec(read, len(data)).template) == len(data) >= len(codec.template)
    assert codec.template == same.template and codec.dtype == same.dtype


@pytest.mark.parametrize("name", TOPICS)
def test_a_new_message_is_that_of_ros(name):
    assert Codec(plain.message_class(name)()).template == Codec(ros_class(name)()).template


def test_damaged_bytes_are_refused():
    data = bytes(serialize_message(filled()[0]))
    cls = plain.message_class("sensor_msgs/msg/JointState")
    rng = np.random.default_rng(7)
    for size in range(len(data) - 20):
        with pytest.raises(ParameterError, match="are no sensor_msgs/msg/JointState"):
            plain.deserialize(data[:size], cls)
    for _ in range(500):
        damaged = bytearray(data)
        for at in rng.integers(0, len(data), 3):
            damaged[at] = rng.integers(0, 256)
        try:
            plain.deserialize(bytes(damaged), cls)
        except ParameterError:
            continue


def test_big_endian_bytes_are_read():
    data = bytes([0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0, 9])
    stamp = plain.deserialize(data, plain.message_class("builtin_interfaces/msg/Time"))
    assert (stamp.sec, stamp.nanosec) == (7, 9)


@pytest.mark.parametrize(
    ("text", "said"),
    [("float64", "no field"), ("float64[] = x", "no field"), ("Loop inner", "contains itself")],
)
def test_texts_that_define_nothing_are_refused(text, said):
    with pytest.raises(ParameterError, match=said):
        plain.message_class("lab/msg/Loop", text)


def test_every_word_of_a_definition_is_understood():
    text = (
        "# a comment\nint8 LOW=-1\nstring<=5 NAME = \"a=b\"\nHeader header\nbyte[2] pair\n"
        "string<=5[<=3] few  # last\nInner[] inner\nfloat32 gain 1.5\nwstring wide\n"
        + "=" * 80 + "\nMSG: lab/Inner\nbool yes true\n"
    )  # fmt: skip
    cls = plain.message_class("lab/msg/All", text)
    assert cls.get_fields_and_field_types() == {
        "header": "std_msgs/Header", "pair": "octet[2]", "few": "sequence<string<5>, 3>",
        "inner": "sequence<lab/Inner>", "gain": "float", "wide": "wstring",
    }  # fmt: skip
    assert cls().gain == 1.5 and cls._inner["lab/Inner"]().yes is True
    with pytest.raises(NameUnknownError, match="no field of lab/msg/All named 'gian'"):
        cls(gian=2.0)
