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

from loco_control.exceptions import LocoError
from loco_learning.gap.recordings import importing, mapping, tables
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
        tables.read(file)


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
