# SPDX-License-Identifier: Apache-2.0
"""One motion as other recorders keep it: MCAP, SQLite and ROS 1, packed by file or by message."""

from __future__ import annotations

import bz2
import json

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from loco_bringup.bag import coding
from loco_bringup.bag.foreign.opening import open_bag, suffix_of
from loco_bringup.cli import bags as commands
from loco_bringup.cli import main as cli
from loco_bringup.gap import importing
from loco_bringup.logs.export import export
from loco_control.exceptions import BagError, MissingFileError, MissingPackageError
from loco_sim.robot import robot as robots

SERVO = robots.load("servo_pendulum")
KIND, COUNT = "sensor_msgs/msg/JointState", 300
TEXTS = ("joint_states", "joint_command")
ZSTD, LZ4 = zstandard.ZstdCompressor().compress, lz4.frame.compress
FORMS = (
    "mcap", "mcap_file_zstd", "mcap_file_lz4", "mcap_message_zstd", "mcap_message_lz4",
    "mcap_ros1", "mcap_ros1_file_zstd", "db3", "db3_file_zstd", "db3_file_lz4",
    "db3_message_zstd", "db3_message_lz4", "ros1", "ros1_bz2", "ros1_lz4",
)  # fmt: skip
SIX = ("mcap_file_zstd", "mcap_message_zstd", "db3_file_zstd", "db3_message_zstd", "ros1", "csv")


def goal(t):
    return 0.8 * np.sin(6.0 * t)


def messages(store):
    """Topic, time of logging [ns] and serialised message, in turn."""
    types = store.types
    for i in range(COUNT):
        t = i / 100.0
        stamp = types["builtin_interfaces/msg/Time"](int(t), round(t % 1 * 1e9))
        for name, at in zip(TEXTS, (goal(t - 0.04), goal(t)), strict=True):
            empty = np.zeros(0)
            header = head(types["std_msgs/msg/Header"], i, stamp)
            yield (
                name,
                10**9 + i * 10**7,
                types[KIND](header, ["pivot"], np.array([at]), empty, empty),
            )


def head(kind, number, stamp):
    if "seq" in kind.__dataclass_fields__:
        return kind(number, stamp, "")
    return kind(stamp, "")


def ros2(folder, form):
    store = get_typestore(Stores.ROS2_HUMBLE)
    mcap = form.startswith("mcap")
    storage = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    writer = Ros2Writer(folder, version=9, storage_plugin=storage)
    if form.endswith("_zstd"):
        mode = CompressionMode.FILE if "_file_" in form else CompressionMode.MESSAGE
        writer.set_compression(mode, CompressionFormat.ZSTD)
    pack = LZ4 if form.endswith("message_lz4") else bytes
    with writer:
        topics = {n: writer.add_connection(f"/{n}", KIND, typestore=store) for n in TEXTS}
        for name, time, message in messages(store):
            writer.write(topics[name], time, pack(bytes(store.serialize_cdr(message, KIND))))
    if form.endswith("file_lz4"):
        (folder / "metadata.yaml").unlink()
        (file,) = folder.iterdir()
        file.with_name(f"{file.name}.lz4").write_bytes(LZ4(file.read_bytes()))
        file.unlink()


def ros1_in_mcap(folder, form):
    store = get_typestore(Stores.ROS1_NOETIC)
    folder.mkdir()
    path = folder / "swing_0.mcap"
    with open(path, "wb") as stream:
        writer = McapWriter(stream)
        writer.start()
        text = store.generate_msgdef(KIND, ros_version=1)[0]
        schema = writer.register_schema("sensor_msgs/JointState", "ros1msg", text.encode())
        topics = {n: writer.register_channel(f"/{n}", "ros1", schema) for n in TEXTS}
        for name, time, message in messages(store):
            data = bytes(store.serialize_ros1(message, KIND))
            writer.add_message(topics[name], time, data, time)
        writer.finish()
    if form.endswith("zstd"):
        path.with_name("swing_0.mcap.zstd").write_bytes(ZSTD(path.read_bytes()))
        path.unlink()


def ros1(folder, form):
    store = get_typestore(Stores.ROS1_NOETIC)
    folder.mkdir()
    writer = Ros1Writer(folder / "swing.bag")
    if form in ("ros1_bz2", "ros1_lz4"):
        writer.set_compression(getattr(Ros1Writer.CompressionFormat, form[-3:].upper()))
    with writer:
        topics = {n: writer.add_connection(f"/{n}", KIND, typestore=store) for n in TEXTS}
        for name, time, message in messages(store):
            writer.write(topics[name], time, bytes(store.serialize_ros1(message, KIND)))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Function that makes a bag of a form, once."""
    root, done = tmp_path_factory.mktemp("foreign"), {}

    def make(form):
        if form not in done:
            done[form] = root / form
            way = ros1_in_mcap if "mcap_ros1" in form else ros1 if "ros1" in form else ros2
            way(done[form], form)
        return done[form]

    return make


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_the_same_record(made, form):
    (record,) = importing.load(made(form), SERVO)
    assert len(record.t) == COUNT
    assert record.signals["q"][:, 0] == pytest.approx(goal(record.t - 0.04), abs=1e-9)
    assert record.command["position"][:, 0] == pytest.approx(goal(record.t), abs=1e-9)


@pytest.mark.parametrize("form", FORMS)
def test_every_form_is_told_and_exported(made, form, tmp_path, capsys):
    commands.show_bag(made(form), check=True)
    said = capsys.readouterr().out
    assert "2.99 s" in said and "is whole" in said
    for name in TEXTS:
        assert f"/{name}" in said and KIND in said and "300" in said
    assert ("packed" in said.split("Topics")[0].replace("packed to", "")) == (
        "_file_" in form or "_message_" in form
    )
    commands.show_bag(made(form), as_json=True)
    assert json.loads(capsys.readouterr().out)["topics"][0]["count"] == COUNT
    written = export(made(form), tmp_path / "out")
    states = np.load(next(path for path in written if "states" in path.name))
    assert states["position"].ravel() == pytest.approx(goal(np.arange(COUNT) / 100.0 - 0.04))


def test_files_of_one_folder_are_records_of_their_names(made, tmp_path):
    (source,) = made("ros1").glob("*.bag")
    for name in ("a", "b"):
        (tmp_path / f"{name}.bag").write_bytes(source.read_bytes())
    records = [importing.load(tmp_path / f"{name}.bag", SERVO)[0].name for name in ("a", "b")]
    assert records == ["a", "b"]
    assert importing.load(made("db3_file_zstd"), SERVO)[0].name == "db3_file_zstd"


def plotjuggler(folder):
    """The motion as a table with a column for each field, under the name of its topic."""
    folder.mkdir()
    t = np.arange(COUNT) / 100.0
    names = [f"/{name}/pivot/position" for name in TEXTS]
    columns = np.column_stack([1.7e9 + t, goal(t - 0.04), goal(t)])
    header = ",".join(["__time", *names])
    np.savetxt(folder / "swing.csv", columns, "%.9f", ",", header=header, comments="")
    return folder / "swing.csv"


@pytest.mark.parametrize("form", SIX)
def test_each_command_answers(made, form, tmp_path, capfd):
    """`loco info`, `export`, `report`, `compare` and `gap check` give a result for each."""

    def call(*words):
        with pytest.raises(SystemExit) as end:
            cli.main([str(word) for word in words])
        said = capfd.readouterr()
        lines = said.err.splitlines()
        assert (end.value.code, lines) == (0, [])
        return " ".join(said.out.split())

    table = form == "csv"
    path = plotjuggler(tmp_path / "csv") if table else made(form)
    model, out = ("--robot", "servo_pendulum"), ("--out", tmp_path / "check")
    check = "gap", "check", path, *model, "--workers", 1, *out
    assert all(name in call("info", path) for name in TEXTS)
    assert ("swing.npz" if table else TEXTS[0]) in call("export", path, "--out", tmp_path / "out")
    page = tmp_path / "report.html"
    assert "report.html" in call("report", path, "--out", page)
    text = page.read_text()
    t = np.arange(COUNT) / 100.0
    error = np.sqrt(np.mean((goal(t - 0.04) - goal(t)) ** 2))
    assert f">{error:.4g}<" in text
    assert "gait" not in text.lower() and "stride" not in text.lower()
    said = call("compare", path, made("mcap"), "--out", tmp_path / "compare.html")
    assert f"pivot: tracking error {error:.4g} → {error:.4g} rad or m (rms)" in said
    said = call(*check)
    assert ("mapping.yaml is a draft, to be corrected: " in said) is table
    assert "usable" in said and "measured: q, command position" in said and "40 ms" in said


@pytest.mark.parametrize("form", ["mcap_file_zstd", "db3_file_zstd"])
def test_a_file_that_was_unpacked_beside_its_packed_twin_is_read_once(made, form, tmp_path):
    folder = tmp_path / "both"
    folder.mkdir()
    for file in made(form).iterdir():
        (folder / file.name).write_bytes(file.read_bytes())
        if coding.is_packed(file):
            (folder / coding.plain_name(file.name)).write_bytes(coding.unpacked(file))
    assert open_bag(folder).topics["/joint_states"].count == COUNT
    assert not any(map(coding.is_packed, open_bag(folder).paths))


@pytest.mark.parametrize("form", ["mcap_file_zstd", "mcap_file_lz4", "db3_file_zstd", "ros1"])
def test_a_file_that_is_cut_short_is_one_line(made, form, tmp_path):
    folder = tmp_path / "cut"
    folder.mkdir()
    for file in made(form).iterdir():
        data = file.read_bytes()
        (folder / file.name).write_bytes(data if file.suffix == ".yaml" else data[: len(data) // 2])
    with pytest.raises(BagError) as error:
        open_bag(folder)
    assert "\n" not in str(error.value) and "cut" in str(error.value)


def test_more_than_a_machine_should_hold_is_not_unpacked(made, monkeypatch):
    (file,) = [f for f in made("mcap_file_zstd").iterdir() if coding.is_packed(f)]
    with pytest.raises(BagError, match=r"more than 1000 bytes; unpack it with `zstd -d mcap_file"):
        coding.unpacked(file, 1000)
    data = [ZSTD(bytes(600))] * 2
    with pytest.raises(BagError, match="unpack to more than 1000 bytes"):
        coding.decoded(data, coding.unpacker(data[0]), "a", 1000)
    with pytest.raises(BagError, match="a message that zstd packed is damaged"):
        coding.decoded([data[0][:-3]], coding.unpacker(data[0]), "a")


@pytest.mark.parametrize("form", ["ros1", "mcap_ros1"])
def test_without_the_library_it_is_said_what_brings_it(made, form, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name)

    folder = made(form)
    monkeypatch.setattr(coding.importlib, "import_module", missing)
    with pytest.raises(MissingPackageError, match=r"messages of ROS 1.*\./loco install ros1"):
        importing.load(folder, SERVO)


def test_a_definition_that_is_none_is_one_line():
    with pytest.raises(BagError, match="a.bag: the definition of x/Y cannot be read") as error:
        coding.converter("x/Y", "float64[", "a.bag")
    convert, text = coding.converter("x/Y", "float64 a\nstring b\n", "a.bag")
    assert "float64 a" in text
    with pytest.raises(BagError, match="a.bag: 3 bytes are no x/Y of ROS 1"):
        convert(b"abc")


def test_what_is_no_bag_is_told_from_what_is(tmp_path, made):
    assert suffix_of(tmp_path) == "" and suffix_of(tmp_path / "a.csv") == ""
    assert suffix_of(made("ros1")) == ".bag" and suffix_of(tmp_path / "x.db3.zstd") == ".db3"
    with pytest.raises(MissingFileError):
        open_bag(tmp_path / "none")
    (tmp_path / "a.bag").write_bytes(bz2.compress(b"no bag"))
    with pytest.raises(BagError, match="a.bag is no readable bag of ROS 1"):
        open_bag(tmp_path / "a.bag")
