# SPDX-License-Identifier: Apache-2.0
"""Bags in SQLite, as another library writes them, become the same records as those in MCAP."""

from __future__ import annotations

import sqlite3

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from loco_bringup.gap import importing
from loco_control.exceptions import LocoError
from loco_sim.robot import robot as robots

SERVO = robots.load("servo_pendulum")
MAPPING = """
columns:
  - {topic: /joint_states, column: "position[pivot]", role: q, joint: pivot}
  - {topic: /joint_command, column: "position[0]", role: command_position, joint: pivot}
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A bag of 3 s at 100 Hz: the joint follows its command 40 ms late."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    folder = tmp_path_factory.mktemp("db3") / "swing"
    with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        kind = "sensor_msgs/msg/JointState"
        topics = {name: writer.add_connection(f"/{name}", kind, typestore=store)
                  for name in ("joint_states", "joint_command")}  # fmt: skip
        for i in range(300):
            t = i / 100.0
            at = {"joint_states": goal(t - 0.04), "joint_command": goal(t)}
            for name, connection in topics.items():
                stamp = types["builtin_interfaces/msg/Time"](int(t), round(t % 1 * 1e9))
                header = types["std_msgs/msg/Header"](stamp, "")
                empty = np.zeros(0)
                message = types[kind](header, ["pivot"], np.array([at[name]]), empty, empty)
                data = store.serialize_cdr(message, kind)
                writer.write(connection, 1_000_000_000 + round(t * 1e9), data)
    return folder


def goal(t):
    return 0.8 * np.sin(6.0 * t)


def test_a_bag_in_sqlite_is_read(bag, tmp_path):
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    (plain,) = importing.load(bag, SERVO)
    (file,) = importing.load(next(bag.glob("*.db3")), SERVO)
    (mapped,) = importing.load(bag, SERVO, tmp_path)
    for record in (plain, file, mapped):
        assert record.signals["q"][:, 0] == pytest.approx(goal(record.t - 0.04))
        assert record.command["position"][:, 0] == pytest.approx(goal(record.t))


def broken(file, how):
    if how == "no database":
        file.write_bytes(b"not a database at all" * 100)
        return
    database = sqlite3.connect(file)
    if how != "empty":
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, "
            "serialization_format TEXT, offered_qos_profiles TEXT)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp, data)"
        )
        form = "protobuf" if how == "protobuf" else "cdr"
        rows = {"text": (5, "words"), "time": ("noon", b"\0" * 8), "short": (5, b"\0\1\0\0\7")}
        for number, name in enumerate(("/joint_states", "/joint_command")):
            row = (number, name, "sensor_msgs/msg/JointState", form, "")
            database.execute("INSERT INTO topics VALUES (?, ?, ?, ?, ?)", row)
            row = (number, number, *rows.get(how, (5, b"")))
            database.execute("INSERT INTO messages VALUES (?, ?, ?, ?)", row)
    database.commit()
    database.close()


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ("no database", "no rosbag2 database"), ("empty", "no rosbag2 database"),
        ("protobuf", "encoded as 'protobuf'"), ("text", "rows that are no messages"),
        ("time", "rows that are no messages"), ("short", "joint_states"),
    ],
)  # fmt: skip
def test_a_broken_bag_is_one_line(tmp_path, how, words):
    broken(tmp_path / "a.db3", how)
    with pytest.raises(LocoError, match=words) as said:
        importing.load(tmp_path / "a.db3", SERVO)
    assert "\n" not in str(said.value)
