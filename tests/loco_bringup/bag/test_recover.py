# SPDX-License-Identifier: Apache-2.0
"""Damaged bags: whole chunks come back, what is lost is told, nothing else happens."""

import os
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
import yaml

from loco_bringup.bag import progress as bag_progress
from loco_bringup.bag.mcap_file import McapFile
from loco_bringup.bag.parts import mcap_paths
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.bag.writer import BagWriter
from loco_control.exceptions import BagError, MissingFileError, ParameterError
from loco_control.ros.messages.definitions import definition, type_hash
from loco_workshop.bench.damage import bench_damage, sample


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return sample(tmp_path_factory.mktemp("recover") / "whole", ticks=200)


def cut(whole, folder, size):
    """The file of a bag without its end, and without ``metadata.yaml``."""
    path = folder / "cut.mcap"
    path.write_bytes(Bag(whole).path.read_bytes()[:size])
    return path


def test_a_whole_bag_is_left_alone(whole):
    recovery = recover(whole)
    assert recovery.folder is None
    assert (recovery.messages, recovery.seconds) == (400, 0.0)
    assert (recovery.lost, recovery.lost_seconds, recovery.at_least) == (0, 0.0, False)
    assert "whole: 400 messages" in str(recovery)


def test_cut_and_flipped_bags_lose_only_what_was_hit():
    for row in bench_damage(truncations=12, flips=20, seed=3):
        assert row["files"] == row["recovered"] + row["clear message"]
        assert row["chunks missed"] == row["wrong data"] == row["tracebacks"] == 0
        assert row["slowest ms"] < 5000.0


def test_it_says_how_many_messages_and_seconds_are_lost(whole, tmp_path):
    file = Bag(whole).file
    keep = file.chunks[len(file.chunks) // 2].stop
    cut(whole, tmp_path, keep)
    (tmp_path / "metadata.yaml").write_text(
        (whole / "metadata.yaml").read_text().replace("whole_0.mcap", "cut.mcap")
    )
    recovery = recover(tmp_path / "cut.mcap", tmp_path / "out")
    bag = Bag(tmp_path / "out")
    assert recovery.messages == sum(t.count for t in bag.topics.values())
    assert recovery.messages + recovery.lost == 400
    assert recovery.seconds == pytest.approx(bag.end - bag.start)
    assert recovery.lost_seconds == pytest.approx(Bag(whole).end - bag.end)


def test_without_any_record_of_the_end_it_says_at_least(whole, tmp_path):
    chunk = Bag(whole).file.chunks[4]
    recovery = recover(cut(whole, tmp_path, (chunk.start + chunk.stop) // 2))
    assert recovery.lost is None and recovery.at_least
    assert 0.0 < recovery.lost_seconds < 0.4
    assert "an unknown number of messages, at least 0." in str(recovery)


def test_a_damaged_chunk_in_the_middle_is_named_with_its_times(whole, tmp_path):
    bag = Bag(whole)
    data = bytearray(bag.path.read_bytes())
    chunk = bag.file.chunks[3]
    data[(chunk.start + chunk.stop) // 2] ^= 0xFF
    path = tmp_path / "hit.mcap"
    path.write_bytes(data)
    with pytest.raises(BagError, match="loco recover"):
        Bag(path).raw("robot_state")
        Bag(path).raw("trunk_torque")
    recovery = recover(path)
    assert recovery.folder == tmp_path / "hit_recovered"
    assert len(recovery.notes) == 1
    heads = bag.file.records(chunk).heads
    assert recovery.lost == len(heads)
    assert f"{len(heads)} messages" in recovery.notes[0]
    assert recovery.notes[0].startswith("bytes ")  # of the only file
    span = (heads["time"].max() - heads["time"].min()) / 1e9
    assert recovery.lost_seconds == pytest.approx(span)
    assert Bag(recovery.folder).attachments() == bag.attachments()


def test_nothing_whole_is_one_clear_line(whole, tmp_path):
    with pytest.raises(BagError, match="no whole chunk"):
        recover(cut(whole, tmp_path, 300))
    with pytest.raises(MissingFileError, match="no bag at"):
        recover(tmp_path / "nowhere")
    noise = tmp_path / "noise.mcap"
    noise.write_bytes(np.random.default_rng(0).bytes(5000))
    with pytest.raises(BagError, match="nothing to recover"):
        recover(noise)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.mcap", "noise.mcap"]


def test_an_old_folder_is_not_touched(whole, tmp_path):
    path = cut(whole, tmp_path, 20_000)
    (tmp_path / "out").mkdir()
    with pytest.raises(ParameterError, match="exists already"):
        recover(path, tmp_path / "out")


def test_files_of_other_writers_come_back_too(tmp_path):
    """LZ4, no chunk sums, no chunks: as other tools write them."""
    from mcap.writer import CompressionType, Writer

    for name, options in {
        "lz4": {"compression": CompressionType.LZ4, "chunk_size": 2000},
        "none": {"compression": CompressionType.NONE, "chunk_size": 2000, "enable_crcs": False},
        "loose": {"use_chunking": False},
    }.items():
        path = tmp_path / f"{name}.mcap"
        with open(path, "wb") as stream:
            writer = Writer(stream, **options)
            writer.start("ros2", "test")
            schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
            channel = writer.register_channel("/x", "cdr", schema)
            for k in range(500):
                data = b"\x00\x01\x00\x00" + np.float64(k).tobytes()
                writer.add_message(channel, k * 1_000_000, data, k * 1_000_000, k)
            writer.finish()
        values = Bag(path).records("x")["data"]
        np.testing.assert_array_equal(values, np.arange(500.0))
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        recovery = recover(path)
        back = Bag(recovery.folder).records("x")["data"]
        np.testing.assert_array_equal(back, np.arange(float(len(back))))
        assert 100 < len(back) < 500


WRITE = """
import sys, time
from pathlib import Path
from loco_bringup.bag.writer import BagWriter
from loco_control.ros.messages.definitions import definition, type_hash
writer = BagWriter(Path(sys.argv[1]))
kind = "std_msgs/msg/Float64"
writer.add_topic("/x", kind, definition(kind), type_hash(kind), [])
for k in range(10**9):
    writer.write("/x", b"\\0\\1\\0\\0" + k.to_bytes(8, "little"), k * 1_000_000)
    if k % 100 == 0:
        writer.flush()
    if k == 5000:
        print("going", flush=True)
    if k > 5000:
        time.sleep(0.0005)
"""


@pytest.mark.parametrize("delay", [0.0, 0.013, 0.037])
def test_a_killed_recorder_leaves_every_chunk_and_the_count_of_the_rest(tmp_path, delay):
    folder = tmp_path / "killed"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITE, str(folder)], stdout=subprocess.PIPE, env=os.environ.copy()
    )
    try:
        assert process.stdout.readline() == b"going\n"
        time.sleep(delay)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
    with pytest.raises(BagError, match="cut short"):
        Bag(folder)
    received, newest = bag_progress.read(folder)
    assert 5000 < received and newest == (received - 1) * 1_000_000
    recovery = recover(folder)
    assert recovery.messages + recovery.lost == received
    assert recovery.lost <= 100
    assert recovery.lost_seconds == pytest.approx(recovery.lost * 1e-3)
    bag = Bag(recovery.folder)
    np.testing.assert_array_equal(np.diff(bag.times("x")), 1_000_000)
    assert len(bag.times("x")) == recovery.messages


def chunked(path, chunks, end=True, described=True):
    """A file as any tool may write it: message times of each chunk [ns], of topic /x.

    Sequence numbers count; each message says that it was published 7 ns before its time.
    """
    from mcap.writer import CompressionType, Writer

    with open(path, "wb") as stream:
        writer = Writer(stream, compression=CompressionType.NONE, chunk_size=1 << 20)
        writer.start("ros2", "test")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        channels = [writer.register_channel("/x", "cdr", schema)]
        if not described:
            channels.append(writer.register_channel("/y", "cdr", 0))
        k = 0
        for times in chunks:
            for time in times:
                data = b"\x00\x01\x00\x00" + np.float64(k).tobytes()
                for channel in channels:
                    writer.add_message(channel, time, data, max(0, time - 7), k)
                k += 1
            writer._Writer__finalize_chunk()
        if end:
            writer.finish()
    return path


def hit(path, number):
    """Flip a bit in the middle of a chunk."""
    from loco_bringup.bag.salvage import Salvager

    data = bytearray(path.read_bytes())
    chunk = Salvager(path).found.blocks[number]
    data[(chunk.start + chunk.stop) // 2] ^= 0x10
    path.write_bytes(data)


MS = 1_000_000
FOUR = [[k * MS for k in range(10 * c, 10 * c + 10)] for c in range(4)]


def test_each_message_keeps_its_time_its_number_and_when_it_was_sent(tmp_path):
    path = chunked(tmp_path / "x.mcap", [[time + 3 for time in times] for times in FOUR])
    hit(path, 1)
    bag = Bag(recover(path).folder)
    heads = np.concatenate([records.heads for records in bag.file.blocks()])
    kept = [k for k in range(40) if not 10 <= k < 20]
    assert heads["time"].tolist() == [k * MS + 3 for k in kept]
    assert heads["sequence"].tolist() == kept
    assert heads["publish"].tolist() == [max(0, k * MS + 3 - 7) for k in kept]
    assert bag.metadata["recovered_from"] == "x.mcap"


@pytest.mark.parametrize("end", [True, False], ids=["with its end", "cut before its end"])
@pytest.mark.parametrize("number", range(4))
def test_the_time_without_messages_is_that_of_the_chunk_that_is_gone(tmp_path, number, end):
    """At the ends it reaches as far as the neighbour, as nobody tells when there was none."""
    path = chunked(tmp_path / "x.mcap", FOUR, end)
    hit(path, number)
    recovery = recover(path)
    if number == 0 and not end:  # other tools tell of a channel in its first chunk, and at the end
        assert (recovery.messages, recovery.lost, recovery.chunks) == (0, 40, 3)
        return
    assert (recovery.messages, recovery.lost, recovery.chunks) == (30, 10, 3)
    gone = 0.010 if number in (0, 3) else 0.009
    assert recovery.seconds == (0.039 if number in (1, 2) else 0.029)
    assert recovery.lost_seconds == gone
    assert str(recovery).endswith(f"lost 10 messages, {gone:.3f} s")


@pytest.mark.parametrize(
    ("chunks", "number", "gone"),
    [
        ([(0, 10), (0, 10), (20, 30)], 1, 9),  # beside the first that came back
        ([(0, 10), (20, 30), (20, 30)], 1, 9),  # beside the last
        ([(0, 10), (5, 15), (20, 30)], 0, 5),  # from its start to that of the next
        ([(0, 10), (15, 25), (20, 30)], 2, 5),  # from the end of the one before to its own
    ],
)
def test_chunks_that_overlap_leave_no_time_without_messages_twice(tmp_path, chunks, number, gone):
    times = [[(100 + k) * MS for k in range(*chunk)] for chunk in chunks]
    path = chunked(tmp_path / "x.mcap", times)
    hit(path, number)
    assert recover(path).lost_seconds == gone / 1e3


def test_what_only_its_own_index_knew_is_lost_without_a_message(tmp_path):
    """A file that lost its end, and nothing else: no message is known to be gone."""
    path = chunked(tmp_path / "x.mcap", FOUR, end=False)
    recovery = recover(path)
    assert (recovery.messages, recovery.chunks) == (40, 4)
    assert recovery.lost == 0 and recovery.lost_seconds is None
    assert str(recovery).endswith("lost 0 messages, unknown")


def test_messages_of_a_channel_that_nothing_describes_are_counted_as_lost(tmp_path):
    path = chunked(tmp_path / "x.mcap", FOUR, described=False)
    hit(path, 2)
    recovery = recover(path)
    assert (recovery.messages, recovery.lost) == (30, 50)
    assert any(note.startswith("30 messages of channel 2") for note in recovery.notes)
    path = chunked(tmp_path / "y.mcap", FOUR, end=False, described=False)
    recovery = recover(path)
    assert (recovery.messages, recovery.lost) == (40, 40)


def test_a_bag_of_several_files_comes_back_as_one_of_several(tmp_path):
    """Each note says which file it is about; files beside and inside come along once."""
    folder = tmp_path / "run"
    writer = BagWriter(folder, {"experiment": "x", "seed": "7"}, 2000)
    kind = "std_msgs/msg/Float64"
    qos = [{"reliability": "best_effort"}]
    writer.add_topic("/x", kind, definition(kind), type_hash(kind), qos)
    for part in range(3):
        for k in range(1000 * part, 1000 * part + 1000):
            data = b"\x00\x01\x00\x00" + np.float64(k).tobytes()
            writer.write("/x", data, k * MS, k, k * MS + 5)
        if part < 2:
            writer.split()
    writer.attach("experiment.yaml", b"inside")
    writer.close()
    (folder / "experiment.yaml").write_text("beside")
    (folder / "params.yaml").write_text("gains: 3")
    assert recover(folder).folder is None
    hit(folder / "run_1.mcap", 3)
    recovery = recover(folder)
    bag = Bag(recovery.folder)
    assert recovery.folder == tmp_path / "run_recovered"
    assert [path.name for path in sorted(recovery.folder.glob("*.mcap"))] == [
        f"run_recovered_{i}.mcap" for i in range(3)
    ]
    assert [note.split(":")[0] for note in recovery.notes] == ["run_1.mcap"]
    assert recovery.messages + recovery.lost == 3000 and 0 < recovery.lost < 200
    assert recovery.lost_seconds == pytest.approx((recovery.lost - 1) * 1e-3)
    assert not recovery.at_least
    about = {"experiment": "x", "seed": "7", "recovered_from": "run"}
    assert about.items() <= bag.metadata.items()
    assert bag.attachment("experiment.yaml") == b"inside"
    assert bag.attachment("params.yaml") == b"gains: 3"
    assert bag.file.summary.statistics.attachment_count == 2
    for file in mcap_paths(recovery.folder):
        assert list(McapFile(file).summary.channels) == [1]
    channel = next(iter(bag.file.summary.channels.values()))
    assert "best_effort" in channel.metadata["offered_qos_profiles"]
    assert channel.metadata["topic_type_hash"] == type_hash(kind)
    assert recover(recovery.folder).folder is None

    (folder / "run_1.mcap").unlink()
    with pytest.raises(ParameterError, match="exists already"):
        recover(folder)
    recovery = recover(folder, tmp_path / "rest")
    assert recovery.notes == ["'run_1.mcap' is missing"]
    assert (recovery.messages, recovery.lost) == (2000, 1000)
    assert not recovery.at_least  # metadata.yaml told how many there were
    (folder / "metadata.yaml").unlink()
    recovery = recover(folder, tmp_path / "rest_2")
    assert recovery.notes == ["'run_1.mcap' is missing"]
    assert recovery.messages == 2000 and recovery.at_least
    assert (recovery.lost, recovery.lost_seconds) == (0, 0.0)  # that anything tells of
    recovery = recover(folder / "run_2.mcap", tmp_path / "rest_3")  # one of them, without the rest
    assert (recovery.messages, recovery.lost, recovery.notes) == (1000, 0, [])
    hit(folder / "run_2.mcap", 0)
    notes = recover(folder, tmp_path / "rest_4").notes
    assert [note.split()[0] for note in notes] == ["'run_1.mcap'", "run_2.mcap:"]


@pytest.mark.parametrize(
    "spoil", ["nothing", "no duration", "no count", "no count of a file", "other files"]
)
def test_metadata_counts_where_it_is_of_these_files_and_whole(tmp_path, spoil):
    folder = sample(tmp_path / "run", ticks=200)
    path = folder / "run_0.mcap"
    chunk = Bag(folder).file.chunks[4]
    path.write_bytes(path.read_bytes()[: chunk.start - 200])
    about = yaml.safe_load((folder / "metadata.yaml").read_text())
    inner = about["rosbag2_bagfile_information"]
    if spoil == "no duration":
        del inner["duration"]
    elif spoil == "no count":
        del inner["message_count"]
    elif spoil == "no count of a file":
        inner["files"][0]["message_count"] = 0
    elif spoil == "other files":
        inner["relative_file_paths"] = ["other_0.mcap"]
    (folder / "metadata.yaml").write_text(yaml.safe_dump(about))
    recovery = recover(folder)
    bag = Bag(recovery.folder)
    assert 0 < recovery.messages < 400
    if spoil == "nothing":
        assert recovery.lost == 400 - recovery.messages and not recovery.at_least
        assert recovery.lost_seconds == pytest.approx(199 * 0.004 - bag.end)
    else:
        assert recovery.at_least and recovery.lost != 400 - recovery.messages
    assert bag.metadata.get("experiment") == ("sample" if spoil != "other files" else None)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("custom_data", 1), ("custom_data", [1]), ("relative_file_paths", {"run_0.mcap": 1}),
        ("message_count", "many"), ("message_count", 2**70), ("duration", {"nanoseconds": "a"}),
        ("files", [3]), ("files", [{"path": 3, "message_count": 1}]),
    ],
)  # fmt: skip
def test_metadata_with_a_wrong_value_is_told_and_not_used(tmp_path, key, value):
    folder = sample(tmp_path / "run", ticks=200)
    path = folder / "run_0.mcap"
    path.write_bytes(path.read_bytes()[: Bag(folder).file.chunks[4].start - 200])
    about = yaml.safe_load((folder / "metadata.yaml").read_text())
    about["rosbag2_bagfile_information"][key] = value
    (folder / "metadata.yaml").write_text(yaml.safe_dump(about))
    recovery = recover(folder)
    assert recovery.messages > 0
    assert f"metadata.yaml: rosbag2_bagfile_information.{key}" in recovery.notes[0]
    assert "must be" in recovery.notes[0]


def test_a_whole_file_without_metadata_is_made_a_bag(tmp_path):
    folder = sample(tmp_path / "run", ticks=50)
    (folder / "metadata.yaml").unlink()
    recovery = recover(folder)
    assert (recovery.messages, recovery.lost, recovery.lost_seconds) == (100, 0, 0.0)
    assert recovery.notes == [] and not recovery.at_least
    assert Bag(recovery.folder).attachments() == Bag(folder / "run_0.mcap").attachments()


def test_an_empty_bag_without_metadata_comes_back_empty(tmp_path):
    writer = BagWriter(tmp_path / "run")
    writer.close()
    assert recover(tmp_path / "run").messages == 0
    (tmp_path / "run" / "metadata.yaml").unlink()
    with pytest.raises(BagError, match="nothing to recover"):
        recover(tmp_path / "run")


def test_stamps_before_zero_are_told_and_the_rest_comes_back(tmp_path):
    path = chunked(tmp_path / "x.mcap", [[0, 5 * MS], [10 * MS, 1 << 63, 20 * MS]])
    recovery = recover(path)
    assert (recovery.messages, recovery.lost) == (4, 1)
    assert recovery.seconds == pytest.approx(0.020)
    assert ["2^63" in note for note in recovery.notes] == [True]
    assert Bag(recovery.folder).times("x").tolist() == [0, 5 * MS, 10 * MS, 20 * MS]


def test_what_cannot_be_written_is_one_clear_line_and_leaves_nothing(whole, tmp_path):
    path = cut(whole, tmp_path, 20_000)
    (tmp_path / "file").write_text("")
    with pytest.raises(BagError, match="no bag can be written"):
        recover(path, tmp_path / "file" / "out")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (9000, limits[1]))
    try:
        with pytest.raises(BagError, match="written|closed"):
            recover(path, tmp_path / "out")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["cut.mcap", "file"]
