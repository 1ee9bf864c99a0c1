# SPDX-License-Identifier: Apache-2.0
"""Fuzzing targets for foreign binary files: small valid files, written without their libraries.

Damaged bytes rarely get past a checksum, so the contents of a zip file are damaged before
compression.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import io
import json
import sqlite3
import struct
import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.cli.bags import show_bag
from loco_bringup.export_model.write import export_model
from loco_bringup.gap import importing
from loco_bringup.gap import run as runner
from loco_bringup.gap.next import write_next
from loco_control.exceptions import ParameterError
from loco_learning import archive
from loco_learning.gap.importing import tables
from loco_learning.jobs import journal
from loco_learning.jobs.kept import Memory
from loco_learning.params import LearnerParams
from loco_learning.reflex import weights
from loco_learning.reflex.network import ReflexNetwork
from loco_learning.reflex.senses import FootForces
from loco_learning.search.score import Score
from loco_sim.robot import robot as robots

from . import bags

_ROWS = np.arange(24.0).reshape(12, 2)


def commands() -> list[bytes]:
    """Pickles of a dictionary of tensors in the format of `torch.save`."""
    storage = (
        b"(X\x07\0\0\0storagectorch\nDoubleStorage\nX\x01\0\0\0%bX\x03\0\0\0cpuK%ctQ"
    )
    tensor = b"ctorch._utils\n_rebuild_tensor_v2\n(%bK\0%b%b\x89ccollections\nOrderedDict\n)RtR"
    time = tensor % (storage % (b"0", b"\x0c"), b"K\x0c\x85", b"K\x01\x85")
    rows = tensor % (storage % (b"1", b"\x18"), b"K\x0cK\x02\x86", b"K\x02K\x01\x86")
    named = b"X\x04\0\0\0time" + time + b"X\x03\0\0\0dofq\x01" + rows + b"q\x02"
    return [b"\x80\x02}q\x00(" + named + b"u.", b"\x80\x04}\x94(" + named + b"u."]


def torch_file(pickled: bytes) -> bytes:
    """A ``.pt`` file with this pickle and the data of two tensors."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as file:
        file.writestr("log/data.pkl", pickled)
        file.writestr("log/data/0", _ROWS[:, 0].tobytes())
        file.writestr("log/data/1", _ROWS.tobytes())
    return out.getvalue()


def torch_files() -> list[bytes]:
    """Valid ``.pt`` files."""
    return [torch_file(pickled) for pickled in commands()]


def databases() -> list[bytes]:
    """Valid SQLite bags, with few and with many pages."""
    return [_database(size, rows) for size, rows in ((512, 60), (4096, 60))]


def _database(page: int, rows: int) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.db3"
        with sqlite3.connect(path) as database:
            database.executescript(
                f"PRAGMA page_size = {page};"
                "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT "
                "NULL, serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
                "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
                "timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
                "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
            )
            for number, topic in enumerate(("/joint_states", "/joint_command"), 1):
                database.execute(
                    "INSERT INTO topics VALUES (?, ?, 'sensor_msgs/msg/JointState', 'cdr', '')",
                    (number, topic),
                )
                database.executemany(
                    "INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)",
                    [(number, 10_000_000 * k, m) for k, m in enumerate(bags.joint_states()[:rows])],
                )
        database.close()
        return path.read_bytes()


def read_database(data: bytes, folder: Path) -> None:
    """Read a SQLite bag in the same way as `loco gap`."""
    (folder / "a.db3").write_bytes(data)
    importing.load(folder / "a.db3", robots.load("servo_pendulum"))


def parquets() -> list[bytes]:
    """Valid parquet files, plain and compressed with a dictionary; empty without pyarrow."""
    if importlib.util.find_spec("pyarrow") is None:
        return []
    pa, parquet = map(importlib.import_module, ("pyarrow", "pyarrow.parquet"))
    table = pa.table({"time": _ROWS[:, 0], "state": pa.array(_ROWS.tolist()), "task": ["a"] * 12})
    files = []
    for options in ({"compression": "none", "use_dictionary": False}, {"compression": "zstd"}):
        out = io.BytesIO()
        parquet.write_table(table, out, **options)
        files.append(out.getvalue())
    return files


def read_table(data: bytes, folder: Path, name: str) -> None:
    """Read a table with the reader for its file extension."""
    (folder / name).write_bytes(data)
    tables.read(folder / name)


def metadata() -> list[bytes]:
    """A valid ``metadata.yaml`` for the bag of `read_metadata`."""
    topic = {"name": "/joint_states", "type": "sensor_msgs/msg/JointState",
             "serialization_format": "cdr", "offered_qos_profiles": []}  # fmt: skip
    about = {
        "version": 9, "storage_identifier": "mcap", "relative_file_paths": ["bag_0.mcap"],
        "duration": {"nanoseconds": 590_000_000},
        "starting_time": {"nanoseconds_since_epoch": 0}, "message_count": 121,
        "topics_with_message_count": [{"topic_metadata": topic, "message_count": 60}],
        "compression_format": "", "compression_mode": "", "ros_distro": "jazzy",
        "files": [{"path": "bag_0.mcap", "message_count": 121,
                   "duration": {"nanoseconds": 590_000_000},
                   "starting_time": {"nanoseconds_since_epoch": 0}}],
        "custom_data": {"loco.seed": "1"},
    }  # fmt: skip
    return [yaml.safe_dump({"rosbag2_bagfile_information": about}).encode()]


def read_metadata(data: bytes, folder: Path) -> None:
    """Show an undamaged bag and recover a damaged one, with these bytes as ``metadata.yaml``."""
    place = folder / "bag"
    place.mkdir()
    (place / "metadata.yaml").write_bytes(data)
    intact = bags.files()[0]
    (place / "bag_0.mcap").write_bytes(intact[: len(intact) // 2])
    recover(place, folder / "out")
    (place / "bag_0.mcap").write_bytes(intact)
    Bag(place)
    with bags.silence():
        show_bag(place, True, False)
        show_bag(place, False, True)


def results() -> list[bytes]:
    """A valid ``gap.json`` with the keys that loco reads from a folder."""
    size = {"value": 0.05, "low": 0.04, "high": 0.06, "unit": "N·m"}
    term = {"effect": "coulomb_friction", "place": "pivot", "parameters": {"torque": size}}
    next_one = {"experiment": "slow_ramp", "separates": ["coulomb_friction", "stribeck_friction"]}
    values = {"format": 1, "verdict": "named", "terms": [term], "next": [{**next_one, "odds": 9.0}]}
    return [json.dumps(values).encode()]


def jobs() -> list[bytes]:
    """A valid ``job.json``."""
    values = {"format": 1, "robot": "servo_pendulum", "bags": ["a.csv"], "hold_out": [],
              "mapping": "", "options": {"seed": 3, "effects": ["*_friction"]}}  # fmt: skip
    return [json.dumps(values).encode()]


def _result_folder(folder: Path, **files: bytes) -> Path:
    place = folder / "results"
    place.mkdir()
    model = b"format: 1\nrobot: servo_pendulum\neffects: [{name: coulomb_friction, joint: pivot}]\n"
    valid = {"gap.json": results()[0], "job.json": jobs()[0], "model.yaml": model}
    for name, data in (valid | {key.replace("_", "."): data for key, data in files.items()}).items():
        (place / name).write_bytes(data)
    return place


def read_results(data: bytes, folder: Path) -> None:
    """Propose an experiment and export a model from a folder with these bytes as ``gap.json``."""
    place = _result_folder(folder, gap_json=data)
    write_next(place, 1, folder / "next.yaml")
    export_model(place, "urdf", folder / "out")


def read_job(data: bytes, folder: Path) -> None:
    """Resume from a folder with these bytes as ``job.json``."""
    place = _result_folder(folder, job_json=data)
    runner.options_of(runner.load_job(place))
    write_next(place, 1, folder / "next.yaml")


def journals() -> list[bytes]:
    """A valid journal of a search with two results."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "search.jsonl"
        with contextlib.suppress(KeyboardInterrupt), _memory(path) as memory:
            for key in ("a", "b"):
                memory.keep(key, (Score(0.5, key), [_ROWS, {"x": np.float64(0.1)}]))
            raise KeyboardInterrupt
        return [path.read_bytes()]


def _memory(path: Path) -> Memory:
    return Memory(path, (1,), (Score,))


def journal_lines() -> list[bytes]:
    """Rows of a valid journal as JSON, to be damaged before checksums are added."""
    rows = [json.loads(line) for line in journals()[0].splitlines()]
    return [json.dumps([{k: v for k, v in row.items() if k != "crc"} for row in rows]).encode()]


def read_lines(data: bytes, folder: Path) -> None:
    """Resume from a journal with these rows."""
    try:
        rows = [journal._line(row) for row in json.loads(data)]
    except Exception as error:  # damage that makes the recipe invalid
        raise ParameterError(f"no rows of a journal: {type(error).__name__}") from None
    read_journal(b"".join(rows), folder)


def read_journal(data: bytes, folder: Path) -> None:
    """Resume from a journal with these bytes."""
    path = folder / "search.jsonl"
    path.write_bytes(data)
    with _memory(path) as memory:
        for key in ("a", "b"):
            memory.known(key)


def networks() -> list[bytes]:
    """Recipes of a weight file of a small network: values, and a shape for each array."""
    network = ReflexNetwork(_small(), FootForces(_small()), 0.01, 1)
    with tempfile.TemporaryDirectory() as folder:
        weights.save(network, Path(folder) / "w.npz")
        meta, arrays = archive.read(Path(folder) / "w.npz", "weights")
    shapes = {name: [list(a.shape), a.dtype.str] for name, a in arrays.items()}
    return [json.dumps({"meta": meta, "arrays": shapes}).encode()]


def _small() -> LearnerParams:
    return LearnerParams(memory=3, neurons=4, window=2)


def read_network(recipe: bytes, folder: Path) -> None:
    """Load a network from the file of a recipe, and its weights into a valid network."""
    path = folder / "w.npz"
    path.write_bytes(_archive(recipe))
    ReflexNetwork.load(path)
    small = _small()
    weights.restore_weights(ReflexNetwork(small, FootForces(small), 0.01, 1), path)


def _archive(recipe: bytes) -> bytes:
    """Bytes of an archive with the recipe's values and array shapes.

    Raises:
        ParameterError: The recipe is invalid.
    """
    out = io.BytesIO()
    try:
        values = json.loads(recipe)
        text = json.dumps({"kind": "weights", "format": 1, **values["meta"]})
        with zipfile.ZipFile(out, "w") as file:
            file.writestr("meta.npy", _npy((), f"<U{len(text)}", text.encode("utf-32-le")))
            for name, (shape, kind) in values["arrays"].items():
                size = int(np.prod(shape, dtype=float)) * np.dtype(kind).itemsize
                file.writestr(f"{name}.npy", _npy(tuple(shape), kind, bytes(min(size, 10_000))))
    except Exception as error:  # damage that makes the recipe invalid
        raise ParameterError(f"no recipe of an archive: {type(error).__name__}") from None
    return out.getvalue()


def _npy(shape: tuple, kind: Any, data: bytes) -> bytes:
    head = repr({"descr": kind, "fortran_order": False, "shape": shape}).encode() + b"\n"
    return b"\x93NUMPY\x01\0" + struct.pack("<H", len(head)) + head + data
