# SPDX-License-Identifier: Apache-2.0
"""`loco export`: topics of a bag as NumPy (``.npz``) or CSV files.

Messages of constant layout become columns, decoded with one `np.frombuffer`, and their texts
constants; the others become one JSON object a line.
"""

from __future__ import annotations

import csv
import json
from array import array
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import BagError, ParameterError
from loco_control.files import whole_folder
from loco_control.reading import within
from loco_learning.gap.importing import tables

from ..bag.foreign.opening import name_of, open_bag, result_path
from ..bag.reader import Bag

FORMATS = ("npz", "csv")
TIME = "log_time"  # column of the log times [s]
NAMES = ("name", "joint_names")  # fields that name the elements of the other lists


def export(
    bag: Bag | str | Path,
    out: str | Path | None = None,
    form: str = "npz",
    topics: Sequence[str] | None = None,
) -> list[Path]:
    """Write one file per topic that has messages; after an error no file remains.

    Args:
        bag: The recording; a table is written as one file, with its columns of numbers.
        out: Folder; default ``export`` in the folder of a bag, ``NAME_export`` beside a file.
        form: ``npz`` (arrays by field) or ``csv`` (a column per number).
        topics: Names of the topics; None for all.

    Returns:
        The files, in the order of the topics.

    Raises:
        NameUnknownError: The bag has no such topic, or a message type is not installed.
        ParameterError: There is no such format.
        BagError: A file cannot be written.
    """
    if form not in FORMATS:
        raise ParameterError(f"format must be one of {', '.join(FORMATS)}, got {form!r}")
    default = bag.folder / "export" if isinstance(bag, Bag) else result_path(Path(bag), "export")
    folder = Path(out) if out else default
    if not isinstance(bag, Bag) and tables.is_table(Path(bag)):
        return [_export_table(tables.read(bag), folder, form)]
    bag = bag if isinstance(bag, Bag) else open_bag(bag)
    names = [bag.resolve(t) for t in topics] if topics else sorted(bag.topics)
    names = [name for name in names if bag.topics[name].count]
    if not names:
        raise BagError(f"{bag.path} has no messages to export")
    try:
        with whole_folder(folder) as new:
            files = [_export_one(bag, name, new, form) for name in names]
        return [folder / file.name for file in files]
    except OSError as error:
        raise BagError(f"{folder} cannot be written: {error}") from None


def _export_table(table: tables.Table, folder: Path, form: str) -> Path:
    name = f"{name_of(table.path)}.{form}"
    try:
        with whole_folder(folder) as new:
            if form == "npz":
                np.savez(new / name, **table.columns)
            else:
                _write_csv(new / name, table.columns, {})
    except OSError as error:
        raise BagError(f"{folder} cannot be written: {error}") from None
    return folder / name


def _export_one(bag: Bag, name: str, folder: Path, form: str) -> Path:
    stem = within(folder, stem_of(name), "topic").name
    table = columns(bag, name)
    if table is None:
        return _write_lines(bag, name, folder / f"{stem}.jsonl")
    path, constants = folder / f"{stem}.{form}", text_fields(bag, name)
    if form == "npz":
        np.savez(path, **table, **{field: np.array(text) for field, text in constants.items()})
    else:
        _write_csv(path, table, constants)
    return path


def stem_of(topic: str) -> str:
    """File name of a topic without its extension; different topics get different names.

    Args:
        topic: Name of the topic; it may contain dots, which ROS forbids but other recorders allow.
    """
    return topic.strip("/").replace("%", "%25").replace(".", "%2E").replace("/", ".")


def columns(bag: Bag, name: str) -> dict[str, np.ndarray] | None:
    """Log times and fields of a topic by path, each (n, ...); None if its layout varies."""
    try:
        records = bag.records(name)
    except BagError as error:
        if "differ in layout" not in str(error):
            raise
        return None
    except ParameterError:  # type without a constant layout
        return None
    if not _texts_agree(bag, name, records):
        return None
    fields = {field: np.ascontiguousarray(records[field]) for field in records.dtype.names}
    return {TIME: bag.times(name) / 1e9, **fields}


def text_fields(bag: Bag, name: str) -> dict[str, str | list[str]]:
    """Texts and lists of texts of the first message of a topic by path, without empty ones."""
    result: dict[str, str | list[str]] = {}

    def add(value: Any, path: str) -> None:
        items = list(value.items()) if isinstance(value, dict) else []
        if isinstance(value, list) and value and all(isinstance(v, str) for v in value):
            result[path] = value
        elif isinstance(value, list):
            items = [(str(i), v) for i, v in enumerate(value) if isinstance(v, dict)]
        elif isinstance(value, str) and value:
            result[path] = value
        for key, inside in items:
            add(inside, f"{path}.{key}" if path else key)

    add(to_plain(bag.message(name, bag.raw(name)[1][0])), "")
    return result


def _elements(path: str, count: int, constants: dict[str, str | list[str]]) -> list[str]:
    """Names of the elements of a list: those in its message or an outer one, or numbers."""
    parts = path.split(".")
    for depth in range(len(parts) - 1, -1, -1):
        for key in NAMES:
            names = constants.get(".".join([*parts[:depth], key]))
            if isinstance(names, list) and len(names) == count == len(set(names)):
                return names
    return [str(i) for i in range(count)]


def _texts_agree(bag: Bag, name: str, records: np.ndarray) -> bool:
    """Whether the non-numeric bytes (names, lengths) are the same in every message."""
    covered = np.zeros(records.dtype.itemsize, dtype=bool)
    for kind, at, *_ in records.dtype.fields.values():
        covered[at : at + kind.itemsize] = True
    covered[:4] = True  # encapsulation header of CDR
    data = records.view(np.uint8).reshape(len(records), -1)
    return not covered.size or bool((data[:, ~covered] == data[0, ~covered]).all())


def _write_csv(
    path: Path, columns: dict[str, np.ndarray], constants: dict[str, str | list[str]]
) -> None:
    head, series, used = [], [], set[str]()
    for name, values in columns.items():
        if values.ndim == 1:
            head.append(name)
            series.append(values.tolist())
        else:
            elements = _elements(name, values.shape[1], constants)
            used |= set(elements)
            head += [f"{name}[{element}]" for element in elements]
            series += values.T.tolist()
    for name, text in constants.items():
        rows = {name: text} if isinstance(text, str) else {
            f"{name}[{i}]": one for i, one in enumerate(text) if not used.issuperset(text)
        }  # fmt: skip
        head += rows
        series += [[one] * len(series[0]) for one in rows.values()]
    with open(path, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(head)
        writer.writerows(zip(*series, strict=True))


def _write_lines(bag: Bag, name: str, path: Path) -> Path:
    times, data = bag.raw(name)
    with open(path, "w") as stream:
        for t, message in zip(times.tolist(), data, strict=True):
            content = to_plain(bag.message(name, message))
            stream.write(json.dumps({TIME: t / 1e9, **content}) + "\n")
    return path


def to_plain(value: Any) -> Any:
    """A message as numbers, strings, lists and dictionaries, ready for JSON."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: to_plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple, array)):
        return [to_plain(v) for v in value]
    if isinstance(value, bytes):
        return list(value)
    return value
