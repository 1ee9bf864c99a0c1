# SPDX-License-Identifier: Apache-2.0
"""A bag of several files is the same bag."""

import os
import shutil

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from loco_bringup.bag.copy import extract
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.bag.writer import BagWriter, Limits
from loco_bringup.cli import main as cli
from loco_bringup.gap import importing as gap_import
from loco_bringup.graph import run as runner
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.export import export
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.record.order import Order
from loco_bringup.report.report import page_of
from loco_control.exceptions import BagError, MissingFileError, ParameterError
from loco_control.ros.messages.topics import topic
from loco_sim.robot import robot as robots

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]  # one set of shared runs


@pytest.fixture(scope="module")
def whole(outcomes):
    return outcomes["composed"].folder


@pytest.fixture(scope="module")
def split(whole, tmp_path_factory):
    """The same bag in files of half a second."""
    return extract(whole, tmp_path_factory.mktemp("parts") / "run", limits=Limits(duration=0.5))


@pytest.fixture
def copy(split, tmp_path):
    return shutil.copytree(split, tmp_path / "run")


def content(folder):
    """Stamps and bytes of all messages of each topic."""
    bag = Bag(folder)
    return {
        name: [(t, bytes(d)) for t, d in zip(*bag.raw(name), strict=True)] for name in bag.topics
    }


def information(folder):
    return yaml.safe_load((folder / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_it_reads_as_the_whole_bag(whole, split):
    one, many = Bag(whole), Bag(split)
    assert len(many.paths) > 3
    assert many.topics == one.topics
    assert (many.start, many.end) == (one.start, one.end)
    assert many.metadata == one.metadata
    assert {n: many.attachment(n) for n in many.attachments()} == {
        n: one.attachment(n) for n in one.attachments()
    }
    assert content(split) == content(whole)
    np.testing.assert_array_equal(read_log(Bag(split)).q, read_log(Bag(whole)).q)


def test_a_player_gets_the_messages_in_the_same_order(whole, split):
    def played(folder):
        bag = Bag(folder)
        return [(t, n, bytes(d)) for t, n, d in Order(bag, {n: n for n in bag.topics})]

    assert len(played(split)) == Bag(whole).summary.statistics.message_count
    assert sorted(played(split)) == sorted(played(whole))
    assert [t for t, _, _ in played(split)] == [t for t, _, _ in played(whole)]


def test_rosbags_reads_it_as_one(whole, split):
    store = get_typestore(Stores.ROS2_JAZZY)

    def read(folder):
        with AnyReader([folder], default_typestore=store) as reader:
            return sorted((c.topic, t, bytes(d)) for c, t, d in reader.messages())

    assert read(split) == read(whole)


def test_metadata_tells_of_each_file(split):
    info = information(split)
    files = [Bag(path).summary.statistics for path in Bag(split).paths]
    assert info["relative_file_paths"] == [f["path"] for f in info["files"]]
    for row, file in zip(info["files"], files, strict=True):
        assert row["message_count"] == file.message_count
        start = row["starting_time"]["nanoseconds_since_epoch"]
        assert start == file.message_start_time
        assert start + row["duration"]["nanoseconds"] == file.message_end_time
        assert row["duration"]["nanoseconds"] < 0.5e9
    assert info["message_count"] == sum(file.message_count for file in files)


def test_files_are_about_as_large_as_is_said(whole, tmp_path):
    folder = extract(whole, tmp_path / "run", limits=Limits(size=300_000))
    sizes = [path.stat().st_size for path in Bag(folder).paths]
    assert len(sizes) > 1
    assert all(0.2e6 < size < 0.6e6 for size in sizes[:-1])
    assert content(folder) == content(whole)


def test_a_run_splits_its_bag_and_verifies(short, tmp_path):
    run_rollout(short, tmp_path / "run", lambda progress: None, Limits(duration=0.5))
    assert len(Bag(tmp_path / "run").paths) > 1
    with pytest.raises(SystemExit) as end:
        cli.main(["replay", str(tmp_path / "run"), "--verify"])
    assert end.value.code == 0


def test_a_graph_splits_its_bag(short, tmp_path):
    runner.run(short, tmp_path / "run", "composed", limits=Limits(duration=1.0))
    *full, last = [Bag(path) for path in Bag(tmp_path / "run").paths]
    assert full and all(0.9 < part.end - part.start < 1.1 for part in full)
    assert last.end - last.start < 1.1
    assert not recover(tmp_path / "run").folder


def test_it_is_one_recording_of_a_gap_search_and_of_a_page(whole, split):
    robot = robots.load("hyq")
    one, many = (gap_import.load(folder, robot)[0] for folder in (whole, split))
    assert set(one.signals) == set(many.signals) and set(one.command) == set(many.command)
    for name, values in (one.signals | one.command).items():
        np.testing.assert_array_equal((many.signals | many.command)[name], values)
    pages = [page_of(Bag(folder), None) for folder in (whole, split)]
    assert pages[1].replace("run", "composed") == pages[0].replace("run", "composed")


def test_it_exports_as_the_whole_bag(whole, split, tmp_path):
    for name, folder in (("whole", whole), ("split", split)):
        export(Bag(folder), tmp_path / name, "csv", ["/robot_state"])
    files = sorted(p.name for p in (tmp_path / "whole").iterdir())
    assert files == sorted(p.name for p in (tmp_path / "split").iterdir())
    for name in files:
        assert (tmp_path / "split" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


# ---- what is damaged


def test_a_run_that_was_killed_in_its_last_file_is_recovered(copy, whole):
    *_, last, end = Bag(copy).paths
    end.unlink()
    (copy / "metadata.yaml").unlink()
    data = last.read_bytes()
    last.write_bytes(data[: len(data) // 2])
    with pytest.raises(BagError, match=f"{last.name} .* `loco recover {copy}` "):
        Bag(copy)
    folder = recover(copy).folder
    assert len(Bag(folder).paths) >= len(list(copy.glob("*.mcap"))) - 1
    all_of_it, rest = content(whole), content(folder)
    for name, rows in rest.items():
        assert rows == all_of_it[name][: len(rows)]
    assert 0 < len(all_of_it["/robot_state"]) - len(rest["/robot_state"]) <= 126


def test_a_file_that_is_missing_is_named_and_the_rest_is_recovered(copy):
    names = [path.name for path in Bag(copy).paths]
    (copy / names[1]).unlink()
    with pytest.raises(MissingFileError, match=f"lacks '{names[1]}'.*loco recover"):
        Bag(copy)
    found = recover(copy)
    assert any(names[1] in note for note in found.notes)
    assert Bag(found.folder).summary.statistics.message_count == found.messages
    (copy / "metadata.yaml").unlink()
    with pytest.raises(MissingFileError, match=names[1]):
        Bag(copy)


@pytest.mark.parametrize(
    ("names", "text"),
    [
        (["../run_0.mcap"], "not in its folder"),
        (["/etc/passwd"], "not in its folder"),
        (["run_0.mcap"], "does not name run_1.mcap"),
        (["run_0.mcap\0"], "lacks"),
    ],
)
def test_metadata_that_names_other_files_is_refused(copy, names, text, capsys):
    content = {"rosbag2_bagfile_information": {"relative_file_paths": names}}
    (copy / "metadata.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises((BagError, MissingFileError), match=text):
        Bag(copy)
    with pytest.raises(SystemExit) as end:
        cli.main(["info", str(copy)])
    assert end.value.code == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and "recover" in err


@pytest.mark.parametrize("count", [5, "many", [1]])
def test_counts_of_metadata_that_are_wrong_are_told_and_those_of_the_files_count(
    copy, whole, count, capsys
):
    information_ = information(copy)
    information_["files"][1]["message_count"] = count
    (copy / "metadata.yaml").write_text(
        yaml.safe_dump({"rosbag2_bagfile_information": information_})
    )
    assert content(copy) == content(whole)
    for options in ([], ["--json"]):
        with pytest.raises(SystemExit) as end:
            cli.main(["info", str(copy), *options])
        assert end.value.code == 0
        assert f"states {count!r} messages in run_1.mcap" in " ".join(
            capsys.readouterr().out.split()
        )


@pytest.mark.parametrize("text", ["", "[", "a: &a [*a]", "rosbag2_bagfile_information: 5"])
def test_metadata_that_tells_nothing_is_not_needed(copy, whole, text):
    (copy / "metadata.yaml").write_text(text)
    assert content(copy) == content(whole)


@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir])
def test_what_is_no_file_counts_as_missing(copy, make):
    (copy / "run_1.mcap").unlink()
    make(copy / "run_1.mcap")
    with pytest.raises(MissingFileError, match="lacks 'run_1.mcap'"):
        Bag(copy)
    assert recover(copy).folder


def test_files_of_several_bags_are_refused(copy):
    (copy / "metadata.yaml").unlink()
    shutil.copy(copy / "run_0.mcap", copy / "other_0.mcap")
    with pytest.raises(MissingFileError, match="expected those of one bag"):
        Bag(copy)


@pytest.mark.parametrize("limits", [(-1, 0.0), (1000, 0.0), (0, 0.01), (0, float("nan"))])
def test_limits_that_are_no_limits_are_refused(limits):
    with pytest.raises(ParameterError, match="must be 0 \\(no limit\\) or at least"):
        Limits(*limits)


def test_without_room_for_the_next_file_the_bag_ends_whole(tmp_path, monkeypatch):
    writer = BagWriter(tmp_path / "run", limits=Limits(duration=0.5))
    writer.add_row("/clock", topic("/clock"))
    begin, files = writer._begin, []

    def full(path):
        files.append(path)
        if len(files) > 1:
            raise OSError(28, "No space left on device")
        return begin(path)

    monkeypatch.setattr(writer, "_begin", full)
    for tick in range(100):
        writer.write("/clock", bytes(12), tick * 20_000_000)
    writer.close()
    assert "No space left" in writer.failed
    bag = Bag(tmp_path / "run")
    assert [p.name for p in bag.paths] == ["run_0.mcap", "run_1.mcap"]
    assert (
        bag.summary.statistics.message_count == 50 == information(tmp_path / "run")["message_count"]
    )
