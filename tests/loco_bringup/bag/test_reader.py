# SPDX-License-Identifier: Apache-2.0
"""Bags: readable by the libraries people use, complete, and refused when broken."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_bringup.logs.bag_log import read_log
from loco_control.exceptions import BagError, MissingFileError, NameUnknownError
from loco_control.ros.messages.definitions import definition, type_hash
from loco_control.ros.messages.installed import ros_class
from loco_learning.runs.rollout import rollout
from loco_sim.engines import default_engine

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]  # one set of shared runs


@pytest.fixture
def folder(outcomes):
    return outcomes["composed"].folder


def test_mcap_ros2_support_decodes_every_topic(folder, short):
    counts = {}
    for message in read_ros2_messages(folder / f"{folder.name}_0.mcap"):
        counts[message.channel.topic] = counts.get(message.channel.topic, 0) + 1
        if message.channel.topic == "/robot_state":
            assert len(message.ros_msg.q) == 12
    assert counts["/robot_state"] == short.ticks
    assert counts["/tf"] == short.ticks / 5


def test_rosbags_reads_the_folder(folder, short):
    store = get_typestore(Stores.ROS2_JAZZY)
    with AnyReader([folder], default_typestore=store) as reader:
        connections = [c for c in reader.connections if c.topic == "/motion_command"]
        messages = [reader.deserialize(d, c.msgtype) for c, _, d in reader.messages(connections)]
    assert len(messages) == short.ticks
    np.testing.assert_array_equal([m.tick for m in messages], range(short.ticks))


def test_metadata_describes_the_file(folder):
    info = yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    bag = Bag(folder)
    assert info["version"] == 9
    assert info["storage_identifier"] == "mcap"
    assert info["message_count"] == bag.summary.statistics.message_count
    assert info["relative_file_paths"] == [bag.path.name]
    by_name = {t["topic_metadata"]["name"]: t for t in info["topics_with_message_count"]}
    assert {name: t.count for name, t in bag.topics.items()} == {
        name: t["message_count"] for name, t in by_name.items()
    }
    qos = by_name["/robot_description"]["topic_metadata"]["offered_qos_profiles"][0]
    assert qos["durability"] == "transient_local"


def test_bag_says_what_was_run(folder, short):
    bag = Bag(folder)
    assert bag.metadata["experiment"] == short.name
    assert bag.metadata["seed"] == str(short.seed)
    assert bag.metadata["dropped"] == "0"
    assert default_engine() in json.loads(bag.metadata["versions"])
    assert set(bag.attachments()) == {"experiment.yaml", "params.yaml", "weights.npz"}
    assert bag.messages("robot_description")[0].data.lstrip().startswith("<")


def test_log_of_the_bag_is_the_log_of_the_rollout(folder, short):
    direct, read = rollout(short), read_log(Bag(folder))
    assert len(direct) == len(read)
    np.testing.assert_array_equal(read.q, direct.q)
    np.testing.assert_array_equal(read.grf, direct.grf)
    np.testing.assert_array_equal(read.command_dq, direct.command_dq)
    np.testing.assert_array_equal(read.position, direct.position)
    np.testing.assert_allclose(read.t, direct.t, rtol=1e-14)
    assert read.experiment == direct.experiment


def test_topics_are_found_without_slash_and_unknown_ones_are_named(folder):
    bag = Bag(folder)
    assert bag.resolve("robot_state") == "/robot_state"
    with pytest.raises(NameUnknownError, match="/robot_state"):
        bag.raw("robot_stat")
    with pytest.raises(NameUnknownError, match=r"weights\.npz"):
        bag.attachment("weights")
    with pytest.raises(BagError, match="no message"):
        bag.records("cmd_vel")


def test_missing_cut_and_foreign_files_are_one_clear_line(folder, tmp_path):
    with pytest.raises(MissingFileError, match="no bag at"):
        Bag(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(MissingFileError, match="holds 0"):
        Bag(tmp_path / "empty")
    whole = Bag(folder).path.read_bytes()
    for size in (0, 8, 5000, len(whole) // 2, len(whole) - 1):
        cut = tmp_path / "cut.mcap"
        cut.write_bytes(whole[:size])
        with pytest.raises(BagError, match="cut.mcap"):
            Bag(cut)
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(np.random.default_rng(0).bytes(4096))
    with pytest.raises(BagError, match="noise.mcap"):
        Bag(noise)


def test_bag_of_other_topics_is_no_run(tmp_path):
    writer = BagWriter(tmp_path / "other")
    kind = "std_msgs/msg/String"
    writer.add_topic("/chatter", kind, definition(kind), type_hash(kind), [])
    writer.write("/chatter", b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00", 5)
    writer.close()
    writer.close()  # closing again changes nothing
    bag = Bag(tmp_path / "other")
    assert bag.messages("chatter")[0].data == "a"
    with pytest.raises(BagError, match="robot_state"):
        read_log(bag)


def test_a_writer_does_not_write_over_a_bag(folder):
    with pytest.raises(BagError, match="exists already"):
        BagWriter(folder)


def test_flushed_messages_survive_without_close(tmp_path):
    from mcap.stream_reader import StreamReader

    writer = BagWriter(tmp_path / "killed")
    kind = "std_msgs/msg/String"
    writer.add_topic("/chatter", kind, definition(kind), type_hash(kind), [])
    for k in range(10):
        writer.write("/chatter", b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00", k)
    writer.flush()
    path = next(Path(tmp_path / "killed").glob("*.mcap"))
    found = 0
    with open(path, "rb") as stream, pytest.raises(Exception):  # noqa: B017 (end of file)
        for record in StreamReader(stream).records:
            found += type(record).__name__ == "Message"
    assert found == 10


@pytest.mark.parametrize(
    "name", ["loco_msgs/msg/RobotState", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage"]
)
def test_definitions_hold_every_type_they_name(name):
    text = definition(name)
    separators = text.count("=" * 80)
    assert separators == text.count("MSG: ")
    assert type_hash(name).startswith("RIHS01_")


def test_unknown_message_types_are_named():
    with pytest.raises(NameUnknownError, match="RobotState"):
        definition("loco_msgs/msg/RobotStat")
    with pytest.raises(NameUnknownError, match="std_msgs"):
        definition("no_msgs/msg/A")
    for name in ("no_msgs/msg/A", "std_msgs/msg/Nope", "../../etc"):
        with pytest.raises(NameUnknownError):
            ros_class(name)
