# SPDX-License-Identifier: Apache-2.0
"""Damaged bags: whole chunks come back, what is lost is told, nothing else happens."""

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from loco_bringup.bag import progress as bag_progress
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.workshop.bench.damage import bench_damage, sample
from loco_control.exceptions import BagError, MissingFileError, ParameterError


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
