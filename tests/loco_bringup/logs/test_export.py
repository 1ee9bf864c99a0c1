# SPDX-License-Identifier: Apache-2.0
"""Exports hold what the bag holds."""

import csv
import json

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_bringup.logs.export import export, stem_of
from loco_control.exceptions import BagError, NameUnknownError, ParameterError
from loco_control.ros.messages.convert import Converter, blank
from loco_control.ros.messages.definitions import definition, type_hash
from loco_control.ros.messages.topics import topic
from loco_control.types import TrunkTorque


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A topic of constant layout, one of varying texts, one that is empty."""
    from rclpy.serialization import serialize_message
    from std_msgs.msg import String

    writer = BagWriter(tmp_path_factory.mktemp("export") / "bag", chunk_size=2000)
    for name in ("trunk_torque", "motion_command"):
        writer.add_row("/" + name, topic(name))
    kind = "std_msgs/msg/String"
    writer.add_topic("/lab/said", kind, definition(kind), type_hash(kind), [])
    pack, value = Converter(TrunkTorque).pack, blank(TrunkTorque)
    for tick in range(30):
        value.tick, value.t = tick, tick / 250.0
        value.tau = tick + np.arange(12) / 7.0
        writer.write("/trunk_torque", pack(value), tick * 4_000_000)
        # Texts of one length and of others.
        text = "x" * (3 if tick < 20 else tick)
        writer.write("/lab/said", bytes(serialize_message(String(data=text))), tick * 4_000_000)
    writer.close()
    return Bag(writer.folder)


def test_numpy_files_have_an_array_per_field(bag, tmp_path):
    paths = export(bag, tmp_path)
    assert sorted(p.name for p in paths) == ["lab.said.jsonl", "trunk_torque.npz"]
    with np.load(tmp_path / "trunk_torque.npz") as found:
        np.testing.assert_array_equal(found["tick"], np.arange(30))
        np.testing.assert_array_equal(found["tau"], bag.records("trunk_torque")["tau"])
        np.testing.assert_allclose(found["log_time"], np.arange(30) / 250.0)


def test_csv_files_read_back_to_the_same_numbers(bag, tmp_path):
    (path,) = export(bag, tmp_path, "csv", ["trunk_torque"])
    with open(path, newline="") as stream:
        rows = list(csv.DictReader(stream))
    tau = [[float(row[f"tau[{i}]"]) for i in range(12)] for row in rows]
    np.testing.assert_array_equal(tau, bag.records("trunk_torque")["tau"])


def test_names_and_texts_of_constant_messages_are_in_the_file(tmp_path):
    """Columns bear the names of the joints, in whatever order the messages list them."""
    kind, writer = "sensor_msgs/msg/JointState", BagWriter(tmp_path / "bag")
    writer.add_topic("/states", kind, definition(kind), type_hash(kind), [])
    message = JointState(name=["knee", "hip"], position=[0.1, 0.2])
    message.header.frame_id = "base"
    for i in range(3):
        writer.write("/states", bytes(serialize_message(message)), i)
    writer.close()
    (path,) = export(writer.folder, tmp_path / "csv", "csv")
    with open(path, newline="") as stream:
        row = list(csv.DictReader(stream))[-1]
    named = row["position[knee]"], row["position[hip]"], row["header.frame_id"]
    assert named == ("0.1", "0.2", "base") and not any("[0]" in name for name in row)
    (path,) = export(writer.folder, tmp_path / "npz")
    with np.load(path) as found:
        assert found["name"].tolist() == ["knee", "hip"] and found["header.frame_id"] == "base"


def test_names_that_fit_no_list_are_columns(tmp_path):
    kind, writer = "sensor_msgs/msg/JointState", BagWriter(tmp_path / "bag")
    writer.add_topic("/states", kind, definition(kind), type_hash(kind), [])
    message = JointState(name=["knee", "hip"], position=[0.1, 0.2, 0.3])
    writer.write("/states", bytes(serialize_message(message)), 0)
    writer.close()
    (path,) = export(writer.folder, tmp_path / "csv", "csv")
    with open(path, newline="") as stream:
        (row,) = csv.DictReader(stream)
    assert row["position[2]"] == "0.3" and (row["name[0]"], row["name[1]"]) == ("knee", "hip")


def test_messages_of_varying_layout_are_json_lines(bag, tmp_path):
    (path,) = export(bag, tmp_path, "csv", ["said"])
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert [len(line["data"]) for line in lines] == [3] * 20 + list(range(20, 30))
    assert lines[5]["log_time"] == pytest.approx(0.02)


def test_texts_that_change_at_one_length_are_no_columns(tmp_path):
    """Joints in another order have as many bytes; columns would mix them."""
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import JointState

    writer = BagWriter(tmp_path / "bag")
    kind = "sensor_msgs/msg/JointState"
    writer.add_topic("/joint_states", kind, definition(kind), type_hash(kind), [])
    for k, names in enumerate((["a", "b"], ["b", "a"])):
        message = JointState(name=names, position=[1.0, 2.0])
        writer.write("/joint_states", bytes(serialize_message(message)), k)
    writer.close()
    (path,) = export(tmp_path / "bag", tmp_path / "out")
    assert [json.loads(x)["name"] for x in path.read_text().splitlines()] == [
        ["a", "b"],
        ["b", "a"],
    ]


def test_mistakes_are_one_clear_line(bag, tmp_path):
    with pytest.raises(ParameterError, match="npz, csv"):
        export(bag, tmp_path, "xls")
    with pytest.raises(NameUnknownError, match="trunk_torque"):
        export(bag, tmp_path, topics=["nothing"])
    with pytest.raises(BagError, match="no messages"):
        export(bag, tmp_path, topics=["motion_command"])
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="cannot be written"):
        export(bag, tmp_path / "file")


def test_every_topic_has_a_file_of_its_own_in_the_folder(tmp_path):
    names = ["/a/b", "/a.b", "/a%2Eb", "/a%b", "/../../out", "/a//b"]
    assert len({stem_of(name) for name in names}) == len(names)
    kind = "std_msgs/msg/Float64"
    writer = BagWriter(tmp_path / "bag")
    for number, name in enumerate(names):
        writer.add_topic(name, kind, definition(kind), type_hash(kind), [])
        writer.write(name, bytes(serialize_message(Float64(data=float(number)))), number)
    writer.close()
    files = export(writer.folder, tmp_path / "out")
    assert sorted(files) == sorted((tmp_path / "out").iterdir()) and len(files) == len(names)
    values = sorted(np.load(path)["data"][0] for path in files)
    assert values == list(range(len(names)))
    assert {p.name for p in tmp_path.iterdir()} == {"bag", "out"}


def test_a_topic_that_cannot_be_a_file_is_one_line(tmp_path):
    kind = "std_msgs/msg/Float64"
    writer = BagWriter(tmp_path / "bag")
    for name in ("/x" * 200,):
        writer.add_topic(name, kind, definition(kind), type_hash(kind), [])
        writer.write(name, bytes(serialize_message(Float64())), 0)
    writer.close()
    with pytest.raises(ParameterError, match="topic must be a plain file name"):
        export(writer.folder, tmp_path / "out")
