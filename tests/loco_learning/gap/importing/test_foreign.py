# SPDX-License-Identifier: Apache-2.0
"""Files of PACE, SAGE and LeRobot become records; what is broken or wicked is one line."""

from __future__ import annotations

import io
import json
import pickle
import sys
import types
import zipfile
from collections import OrderedDict

import numpy as np
import pytest
import scipy.io

from loco_control.exceptions import LocoError
from loco_learning.gap.importing import importing, tables
from loco_learning.gap.recordings import mapping
from loco_sim.robot import robot as robots

LEG = robots.load("hyq_leg")
T = np.arange(400) / 200.0
WANTED = np.stack([0.1 * np.sin((3.0 + i) * T) for i in range(3)], axis=1) + LEG.standing
FOUND = np.roll(WANTED, 3, axis=0)
PACE = f"""
time: {{column: time}}
columns:
  - {{column: dof_pos, role: q, joint: [{", ".join(LEG.joints)}]}}
  - {{column: des_dof_pos, role: command_position, joint: [{", ".join(LEG.joints)}]}}
"""


def load(path, text):
    return importing.load(path, LEG, mapping.loads(text))


class Tensor:
    """A tensor as torch pickles one: a storage elsewhere in the zip, and where it lies there."""

    def __init__(self, values, key):
        self.values, self.key = np.asarray(values, dtype="<f4"), key


@pytest.fixture
def save(monkeypatch):
    """Function that writes a dictionary in the layout of torch.save, without torch."""
    torch, utils = types.ModuleType("torch"), types.ModuleType("torch._utils")
    torch.FloatStorage = type("FloatStorage", (), {"__module__": "torch"})

    def rebuild(*_):
        raise AssertionError("nothing of torch may run")

    rebuild.__module__, rebuild.__qualname__ = "torch._utils", "_rebuild_tensor_v2"
    utils._rebuild_tensor_v2 = rebuild
    monkeypatch.setitem(sys.modules, "torch", torch)
    monkeypatch.setitem(sys.modules, "torch._utils", utils)

    class Writer(pickle.Pickler):
        def reducer_override(self, value):
            if not isinstance(value, Tensor):
                return NotImplemented
            shape = getattr(value, "shape", value.values.shape)
            strides = tuple(s // 4 for s in value.values.strides)
            storage = Tag(value.key, value.values.size)
            return rebuild, (storage, 0, shape, strides, False, OrderedDict())

        def persistent_id(self, value):
            if isinstance(value, Tag):
                return "storage", torch.FloatStorage, value.key, "cpu", value.size
            return None

    class Tag:
        def __init__(self, key, size):
            self.key, self.size = key, size

    def write(path, values):
        data = io.BytesIO()
        Writer(data, protocol=2).dump(values)
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("chirp_data/data.pkl", data.getvalue())
            file.writestr("chirp_data/byteorder", "little")
            for value in values.values():
                if isinstance(value, Tensor):
                    file.writestr(f"chirp_data/data/{value.key}", value.values.tobytes())
        return path

    return write


def chirp(**more):
    values = {"time": Tensor(T, "0"), "dof_pos": Tensor(FOUND, "1")}
    return values | {"des_dof_pos": Tensor(WANTED, "2")} | more


def check(record):
    assert record.joints == record.driven == LEG.joints
    assert record.signals["q"] == pytest.approx(FOUND, abs=1e-6)
    assert record.command["position"] == pytest.approx(WANTED, abs=1e-6)
    assert 1.0 / record.dt == pytest.approx(200.0, rel=1e-4)


def test_tensors_of_pace(save, tmp_path):
    (record,) = load(save(tmp_path / "chirp_data.pt", chirp()), PACE)
    check(record)


class Wicked:
    """Prints when a plain unpickler reads it."""

    def __reduce__(self):
        return print, ("this ran",)


def too_long():
    value = Tensor(WANTED, "2")
    value.shape = (10_000, 3)
    return value


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"more": Wicked()}, "it asks for"),
        ({"des_dof_pos": too_long()}, "reaches beyond its 1200 numbers"),
        ({"des_dof_pos": Tensor(WANTED[:7], "2")}, "different lengths"),
        ({"des_dof_pos": Tensor(np.zeros((400, 2, 2)), "2")}, r"shape \(400, 2, 2\)"),
    ],
)
def test_tensors_that_are_not_of_use(save, tmp_path, change, words, capsys):
    with pytest.raises(LocoError, match=words) as said:
        load(save(tmp_path / "a.pt", chirp(**change)), PACE)
    assert "\n" not in str(said.value) and "this ran" not in capsys.readouterr().out


@pytest.mark.parametrize("name", ["a.pt", "a.parquet"])
@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 broken", b"PAR1 broken PAR1", b"\x80\x02."])
def test_files_that_are_not_what_they_are_called(tmp_path, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(LocoError) as said:
        load(tmp_path / name, PACE)
    assert name in str(said.value) and "\n" not in str(said.value)


STORAGE = b"(X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuK\x01tQ"
TENSOR = b"ctorch._utils\n_rebuild_tensor_v2\n(" + STORAGE + b"K\0%b\x89)tR"
MANY, ONE, NONE = b"J\0\0\0\x10\x85", b"K\x01\x85", b"K\0\x85"  # 2**28 rows; strides 1, 0
SHORT = 10_000  # bytes of a file that once filled the memory, or took for ever


def doubled(times):
    """A tuple of two tuples of two tuples ..., each written once, as a key."""
    return b"K\x01\x85q\0" + b"".join(b"h%c\x86q%c" % (k, k + 1) for k in range(times)) + b"K\x01"


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        (b"}(" + doubled(60) + b"u.", "a key is no text"),
        (b"}r\x03\0\0\x20.", "no samples"),  # the 536870915th value to remember
        (b"}(X\x01\0\0\0q" + TENSOR % (MANY + NONE) + b"u.", "are unpacked of"),
        (b"}(X\x01\0\0\0q" + TENSOR % (MANY + ONE) + b"u.", "reaches beyond its 2 numbers"),
        (b"}(X\x01\0\0\0q" + TENSOR % (b"K\x01J\0\0\0\x01\x86" + b"K\0K\0\x86") + b"u.",
         "are unpacked of|columns"),
        (b"(cos\nsystem\nX\x01\0\0\0a\x85R.", "asks for 'os system'"),
        (b"cos\nsystem\n(X\x01\0\0\0ao.", "command OBJ"),
        (b"]q\0h\0a.", "dictionary of tensors"),  # a list of itself
        (b"(" * 5000 + b"u.", "no file of tensors"),
        (b"t" * 5000 + b".", "no file of tensors"),
    ],
)  # fmt: skip
def test_commands_of_a_pickle_cost_no_more_than_their_bytes(tmp_path, commands, words):
    path = tmp_path / "a.pt"
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("a/data.pkl", b"\x80\x02" + commands)
        file.writestr("a/data/0", b"\0" * 8)
    assert path.stat().st_size < SHORT
    with pytest.raises(LocoError, match=words) as said:
        tables.read(path)
    assert "\n" not in str(said.value)


def test_a_tensor_of_a_thousand_names_is_counted_a_thousand_times(tmp_path):
    """A row costs ten bytes, and filled a megabyte."""
    rows = b"J\0\0\x02\0\x85" + ONE
    one = b"X\x01\0\0\0a" + TENSOR % rows + b"q\x01"
    more = b"".join(b"X\x03\0\0\0%03dh\x01" % k for k in range(1000))
    with zipfile.ZipFile(tmp_path / "a.pt", "w") as file:
        file.writestr("a/data.pkl", b"\x80\x02}(" + one + more + b"u.")
        file.writestr("a/data/0", b"\0" * 2**19)
    with pytest.raises(LocoError, match="unpacked it has 10496"):
        tables.read(tmp_path / "a.pt")


def test_a_table_has_no_million_columns(tmp_path):
    rows = b"K\x01J\0\0\x02\0\x86" + b"K\x01K\x01\x86"
    with zipfile.ZipFile(tmp_path / "a.pt", "w") as file:
        file.writestr("a/data.pkl", b"\x80\x02}(X\x01\0\0\0a" + TENSOR % rows + b"u.")
        file.writestr("a/data/0", b"\0" * 2**19)
    with pytest.raises(LocoError, match="131072 columns, at most 10000"):
        tables.read(tmp_path / "a.pt")


def parquet_of(path, compression="zstd", **columns):
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    pq.write_table(pa.table(columns), path, compression=compression, data_page_size=2**30)
    return path


def test_a_parquet_file_that_packs_gigabytes_is_refused(tmp_path):
    path = parquet_of(tmp_path / "a.parquet", t=np.zeros(2**24))
    with pytest.raises(LocoError, match="not a parquet file of numbers") as said:
        tables.read(path)
    assert "\n" not in str(said.value)
    path = parquet_of(tmp_path / "b.parquet", t=np.zeros(2**20), task=["swing"] * 2**20)
    assert list(tables.read(path).columns) == ["t"]  # the reader lives on, and skips texts


@pytest.mark.parametrize("rows", [[[1.0], [1.0, 2.0]], [[1.0], None], [None, [1.0]]])
def test_lists_that_differ_are_refused(tmp_path, rows):
    with pytest.raises(LocoError, match="lists of q differ in length"):
        tables.read(parquet_of(tmp_path / "a.parquet", q=rows))


@pytest.mark.parametrize(
    "info", ["[]", "3", '{"features": [1]}', '{"features": {"a": 1}}', "[" * 99]
)
def test_a_description_that_is_none_is_one_line(tmp_path, info):
    path = parquet_of(tmp_path / "a.parquet", t=np.arange(3.0))
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(info)
    with pytest.raises(LocoError, match="info.json"):
        tables.read(path)


def sage(folder):
    """Logs of SAGE from a real robot: cells with lists, times in microseconds."""
    head = "type,timestamp,positions,velocities,torques\n"
    for file, kind, values in (
        ("control", "Control", WANTED),
        ("state_motor", "StateMotor", FOUND),
    ):
        rows = [
            f'{kind},{1e6 * t:.0f},"{row.tolist()}","[0.0, 0.0, 0.0]","[1.0, 2.0, 3.0]"\n'
            for t, row in zip(T, values, strict=True)
        ]
        (folder / f"{file}.csv").write_text(head + "".join(rows))
    return folder


SAGE = """
files: state_motor.csv
time: {column: timestamp, unit: us}
columns:
  - {column: positions, role: q, joint: [%s]}
  - {column: positions, role: command_position, joint: [%s], file: control.csv}
"""


def test_logs_of_sage(tmp_path):
    names = ", ".join(LEG.joints)
    (record,) = load(sage(tmp_path), SAGE % (names, names))
    check(record)


def test_cells_whose_lists_differ(tmp_path):
    file = sage(tmp_path) / "state_motor.csv"
    file.write_text(file.read_text().replace('"[1.0, 2.0, 3.0]"', '"[1.0]"', 1))
    with pytest.raises(LocoError, match="'torques' lists 3 numbers in row 1, 1 before"):
        tables.read(file).column("torques[0]")


def test_patterns_name_a_column_for_each_joint(tmp_path):
    short = [joint.removesuffix("_joint") for joint in LEG.joints]
    head = ["t", *(f"{j}_joint.q" for j in short), *(f"goal {j}_joint" for j in short)]
    rows = np.column_stack([T, FOUND, WANTED])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=",".join(head), comments="")
    text = """
time: {column: t}
columns:
  - {column: "{joint}.q", role: q, joint: "*"}
  - {column: "goal {joint}", role: command_position, joint: "lf_*"}
"""
    (record,) = load(tmp_path / "a.csv", text)
    check(record)
    with pytest.raises(LocoError, match="no joint named 'rh_"):
        load(tmp_path / "a.csv", text.replace("lf_*", "rh_*"))


def test_a_locked_joint_stays_where_it_was_held(tmp_path):
    held = LEG.joints[0]
    np.savetxt(tmp_path / "a.csv", np.column_stack([T, FOUND, WANTED]), delimiter=",",
               header="t,a,b,c,x,y,z", comments="")  # fmt: skip
    text = f"time: {{column: t}}\nlocked: {{{held}: 0.2}}\ncolumns:\n"
    for column, (role, joint) in {
        "b": ("q", 1), "c": ("q", 2), "y": ("command_position", 1), "z": ("command_position", 2),
    }.items():  # fmt: skip
        text += f"  - {{column: {column}, role: {role}, joint: {LEG.joints[joint]}}}\n"
    (record,) = load(tmp_path / "a.csv", text)
    assert set(record.joints_of(LEG, "q")[:, 0]) == {0.2}
    assert set(record.command_of(LEG, "position")[:, 0]) == {0.2}
    assert record.joints_of(LEG, "q")[:, 1:] == pytest.approx(FOUND[:, 1:])
    for wrong, words in ((LEG.joints[1], "columns of its own"), ("elbow", "named 'elbow'")):
        with pytest.raises(LocoError, match=words):
            load(tmp_path / "a.csv", text.replace(f"{held}: 0.2", f"{wrong}: 0.2"))
    names = f"[null, {LEG.joints[1]}, {LEG.joints[2]}]"  # a list may leave a number out
    rules = mapping.loads(f"columns: [{{column: q, role: q, joint: {names}}}]")
    assert [c.column for c in rules.columns] == ["q[1]", "q[2]"]


def test_a_joint_that_nothing_drove_was_told_no_torque(tmp_path):
    np.savetxt(tmp_path / "a.csv", np.column_stack([T, FOUND[:, 0]]), delimiter=",",
               header="t,a", comments="")  # fmt: skip
    pendulum = robots.load("pendulum")
    text = "time: {column: t}\ncolumns: [{column: a, role: q, joint: pivot}]\n"

    def read(text, robot):
        return importing.load(tmp_path / "a.csv", robot, mapping.loads(text))

    with pytest.raises(LocoError, match=r"add to the mapping: undriven: \[pivot\]"):
        read(text, pendulum)
    (record,) = read(text + "undriven: [pivot]", pendulum)
    assert not record.command_of(pendulum, "torque").any() and record.driven == ("pivot",)
    held = robots.load("servo_pendulum")
    for wrong, robot, words in (
        (f"undriven: [{held.joints[0]}]", held, "kind: torque"),
        ("undriven: [elbow]", pendulum, "named 'elbow'"),
        ("undriven: [pivot]\n", pendulum, "has a command"),
    ):
        columns = text.replace("pivot", held.joints[0]) if robot is held else text
        if words == "has a command":
            columns = text.replace("]", ", {column: a, role: command_torque, joint: pivot}]")
        with pytest.raises(LocoError, match=words):
            read(columns + wrong, robot)


def test_episodes_of_lerobot(tmp_path):
    pa = pytest.importorskip("pyarrow")
    pq = pytest.importorskip("pyarrow.parquet")
    motors = [f"{joint}.pos" for joint in LEG.joints]
    vector = {"dtype": "float32", "shape": [3], "names": motors}
    info = {"codebase_version": "v3.0", "fps": 200, "features": {
        "action": vector, "observation.state": {**vector, "names": {"motors": motors}},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None}}}  # fmt: skip
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps(info))
    (tmp_path / "data" / "chunk-000").mkdir(parents=True)
    lists = pa.list_(pa.float32(), 3)
    table = pa.table({
        "observation.state": pa.array([*FOUND.tolist(), *FOUND.tolist()], lists),
        "action": pa.array([*WANTED.tolist(), *WANTED.tolist()], lists),
        "timestamp": pa.array([*T, *T], pa.float32()),
        "episode_index": pa.array([0] * len(T) + [1] * len(T), pa.int64()),
        "task": pa.array(["swing"] * 2 * len(T)),
    })  # fmt: skip
    pq.write_table(table, tmp_path / "data" / "chunk-000" / "file-000.parquet")
    text = """
files: data/*/*.parquet
time: {column: timestamp}
columns:
  - {column: "observation.state[{joint}.pos]", role: q, joint: "*"}
  - {column: "action[{joint}.pos]", role: command_position, joint: "*"}
records:
  - {where: {episode_index: 0}}
  - {where: {episode_index: 1}, role: held-out}
"""
    first, second = load(tmp_path, text)
    check(first)
    assert (second.role, second.name) == ("held-out", "episode 1")


ARRAYS = {"t": T, "knee": FOUND[:, 0], "both": FOUND[:, :2], "gain": 0.4, "start": np.zeros(3)}


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("a.npz", lambda file: np.savez_compressed(file, **ARRAYS)),
        ("a.mat", lambda file: scipy.io.savemat(file, ARRAYS, do_compression=True)),
        ("b.mat", lambda file: scipy.io.savemat(file, {"log": ARRAYS})),
    ],
)
def test_arrays_of_one_length_are_columns(tmp_path, name, write):
    write(tmp_path / name)
    table = tables.read(tmp_path / name)
    at = "log." if name.startswith("b") else ""
    assert sorted(table.columns) == sorted(f"{at}{x}" for x in ("t", "knee", "both[0]", "both[1]"))
    np.testing.assert_array_equal(table.columns[f"{at}both[1]"], FOUND[:, 1])


def test_a_broken_or_too_large_file_of_arrays_is_one_line(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"x": np.zeros(10_000_000)}, do_compression=True)
    scipy.io.savemat(tmp_path / "b.mat", {"x": "no number"})
    scipy.io.savemat(tmp_path / "c.mat", ARRAYS)
    (tmp_path / "c.mat").write_bytes((tmp_path / "c.mat").read_bytes()[:999])
    (tmp_path / "d.mat").write_bytes(b"MATLAB 7.3 MAT-file" + bytes(200))
    np.savez(tmp_path / "e.npz", np.array([{}]))
    for name in ("a.mat", "b.mat", "c.mat", "d.mat", "e.npz"):
        with pytest.raises(LocoError, match=name) as error:
            tables.read(tmp_path / name)
        assert "\n" not in str(error.value)
