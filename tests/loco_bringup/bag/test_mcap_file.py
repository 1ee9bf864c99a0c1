# SPDX-License-Identifier: Apache-2.0
"""Our MCAP files as the mcap library reads them, and its files as we do."""

import struct
from collections import Counter

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from loco_bringup.bag.mcap_file import McapFile
from loco_bringup.bag.mcap_scan import HEAD, MAGIC, walk
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.bag.salvage import Salvager
from loco_control.exceptions import BagError
from loco_workshop.bench.damage import sample


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return Bag(sample(tmp_path_factory.mktemp("mcap") / "bag", ticks=150))


def test_the_library_finds_every_message_by_our_indices(bag):
    with open(bag.path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        found = [m for _, c, m in reader.iter_messages() if c.topic == "/robot_state"]
        span = {"starting_at": 200_000_000, "ending_before": 300_000_000}
        part = list(reader.iter_messages(["/trunk_torque"], **span))
        assert [a.name for a in reader.iter_attachments()] == ["experiment.yaml"]
        assert {m.name for m in reader.iter_metadata()} == {"rosbag2", "loco"}
    times, data = bag.raw("robot_state")
    assert [m.log_time for m in found] == times.tolist()
    assert [m.data for m in found] == data
    assert len(part) == 25
    assert summary.statistics.message_count == 300
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count > 5


def test_the_library_reads_the_stream_with_all_check_sums(bag):
    with open(bag.path, "rb") as stream:
        kinds = Counter(type(r).__name__ for r in StreamReader(stream, validate_crcs=True).records)
    assert kinds["Message"] == 300 and kinds["Footer"] == 1


def test_pieces_cover_a_file_without_gaps(bag):
    at = len(MAGIC)
    for piece in walk(bag.file.data):
        assert piece.start - HEAD.size == at
        at = piece.stop
    assert at == len(bag.file.data) - len(MAGIC)


def test_a_walk_from_anywhere_finds_the_next_record(bag):
    starts = [p.start for p in walk(bag.file.data)]
    for at in np.random.default_rng(0).integers(len(MAGIC), starts[-4], 40).tolist():
        pieces = list(walk(bag.file.data, at))
        known = [p.start for p in pieces if p.opcode]
        expected = [s for s in starts if s - HEAD.size >= at]
        assert known[-len(expected) :] == expected


def test_records_of_private_kinds_are_skipped(bag, tmp_path):
    data = bytes(bag.file.data)
    chunk = bag.file.chunks[2].start - HEAD.size
    private = HEAD.pack(0x90, 5) + b"magic"
    footer = struct.Struct("<QQI")
    summary, offsets, _ = footer.unpack(data[-28:-8])
    moved = footer.pack(summary + len(private), offsets + len(private), 0)
    path = tmp_path / "private.mcap"
    path.write_bytes(data[:chunk] + private + data[chunk:-28] + moved + MAGIC)
    again = Bag(path)
    assert again.raw("robot_state")[1] == bag.raw("robot_state")[1]
    assert not Salvager(path).found.lost


def test_a_chunk_that_became_private_is_missed_by_both(bag, tmp_path):
    data = bytearray(bag.file.data)
    piece = bag.file.chunks[2]
    data[piece.start - HEAD.size] = 0x86
    path = tmp_path / "hit.mcap"
    path.write_bytes(data)
    with pytest.raises(BagError, match="chunks of"):
        McapFile(path)
    recovery = recover(path)
    assert recovery.lost == len(bag.file.records(piece).channels)
    assert f"{recovery.lost} messages" in recovery.notes[0]


def test_sizes_that_cannot_be_are_refused_at_once(bag, tmp_path):
    """A flipped length must not make anyone ask for as much memory."""
    data = bytearray(bag.file.data)
    piece = bag.file.chunks[1]
    struct.pack_into("<Q", data, piece.start + 16, 1 << 45)
    path = tmp_path / "hit.mcap"
    path.write_bytes(data)
    with pytest.raises(BagError, match="at most"):
        Bag(path).raw("robot_state")
    assert recover(path).lost > 0
