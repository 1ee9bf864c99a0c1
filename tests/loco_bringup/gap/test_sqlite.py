# SPDX-License-Identifier: Apache-2.0
"""Bags in SQLite, as another library writes them, become the same records as those in MCAP."""

from __future__ import annotations

import sqlite3
import struct

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from loco_bringup.bag.foreign import sqlite as db3
from loco_bringup.calibrate.bag import read_recording
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


def test_a_calibration_reads_it_as_well(bag):
    recording = read_recording(bag, 100.0, SERVO)
    assert recording.q[:, 0] == pytest.approx(goal(recording.t - 0.04))
    assert recording.command[:, 0] == pytest.approx(goal(recording.t))


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


TOPICS = """
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
    serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
INSERT INTO topics VALUES(1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr', '');
"""
MESSAGES = """
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
    timestamp INTEGER NOT NULL, data BLOB NOT NULL);
INSERT INTO messages VALUES(1, 1, 1, zeroblob(3000));
"""
ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT x"


@pytest.mark.parametrize(
    "messages",
    [
        f"CREATE VIEW messages AS {ENDLESS} AS id, 1 AS topic_id, x AS timestamp, x AS data FROM c;",
        "CREATE TABLE messages(topic_id, timestamp, data AS (zeroblob(900000000)));"
        "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1);",
        "CREATE TABLE messages(topic_id, timestamp, data DEFAULT (zeroblob(9000)));",
        "CREATE VIRTUAL TABLE messages USING fts5(topic_id, timestamp, data);",
    ],
    ids=["view", "generated", "default", "virtual"],
)
def test_tables_that_are_computed_are_refused(tmp_path, messages):
    database = sqlite3.connect(tmp_path / "a.db3")
    database.executescript(TOPICS + messages)
    database.close()
    with pytest.raises(LocoError, match="messages is no plain table"):
        importing.load(tmp_path / "a.db3", SERVO)


def test_a_table_whose_pages_are_shared_is_refused(tmp_path):
    """Twelve levels, each of which names the next sixty times: no end within the age of the sun."""
    page, fan = 1024, 60
    path = tmp_path / "a.db3"
    database = sqlite3.connect(path)
    database.executescript(f"PRAGMA page_size = {page};" + TOPICS + MESSAGES)
    database.execute("UPDATE messages SET data = x'00'")
    database.commit()
    database.execute("VACUUM")
    query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
    ((root,),) = database.execute(query).fetchall()
    database.close()
    data = path.read_bytes()
    first, last = len(data) // page, (root - 1) * page
    pages = [data[last : last + page]]
    for _ in range(12):
        child = first + len(pages)
        rows = [struct.pack(">IB", child, k) for k in range(fan)]
        places = [page - 5 * (k + 1) for k in range(fan)]
        head = struct.pack(">BHHHBI", 5, 0, fan, places[-1], 0, child)
        index = head + struct.pack(f">{fan}H", *places)
        rest = b"".join(reversed(rows))
        pages.append(index + bytes(page - len(index) - len(rest)) + rest)
    whole = bytearray(data + b"".join(pages[:-1]))
    whole[last : last + page] = pages[-1]
    whole[28:32] = struct.pack(">I", len(whole) // page)
    path.write_bytes(whole)
    with pytest.raises(LocoError, match="is damaged"):
        importing.load(path, SERVO)


def test_a_message_that_goes_round_in_its_pages_is_refused(tmp_path):
    """A blob that says it has 500 MB, whose last page names itself as the next."""
    path = tmp_path / "a.db3"
    database = sqlite3.connect(path)
    database.executescript("PRAGMA page_size = 512;" + TOPICS + MESSAGES)
    query = "SELECT rootpage FROM sqlite_master WHERE name = 'messages'"
    ((root,),) = database.execute(query).fetchall()
    database.close()
    data = bytearray(path.read_bytes())
    at = (root - 1) * 512
    at += int.from_bytes(data[at + 8 : at + 10], "big")  # its only row: sizes, number, head
    size = data[at : at + 2]
    assert (size[0] & 127) << 7 | size[1] > 3000
    last = len(data) // 512
    data[512 * (last - 1) : 512 * (last - 1) + 4] = struct.pack(">I", last)
    path.write_bytes(data)
    with pytest.raises(LocoError, match="is damaged"):
        importing.load(path, SERVO)


def test_nothing_can_be_written_and_a_long_question_is_cut_off(bag):
    file = next(bag.glob("*.db3"))
    before = file.read_bytes()
    with db3._opened(file) as database, pytest.raises(sqlite3.Error, match="readonly"):
        database.execute("DELETE FROM messages")
    with pytest.raises(LocoError, match="it takes too long"), db3._opened(file) as database:
        database.execute(f"{ENDLESS} FROM c").fetchall()
    assert file.read_bytes() == before
