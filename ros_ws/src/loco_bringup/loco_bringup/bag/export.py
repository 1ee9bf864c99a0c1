# SPDX-License-Identifier: Apache-2.0
"""`loco export`: topics of a bag as NumPy (``.npz``) or CSV files.

Messages of constant layout become columns, decoded with one `np.frombuffer`;
the others become one JSON object a line.
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

from .foreign.opening import open_bag
from .reader import Bag

FORMATS = ("npz", "csv")
TIME = "log_time"  # column of the log times [s]


def export(
    bag: Bag | str | Path,
    out: str | Path | None = None,
    form: str = "npz",
    topics: Sequence[str] | None = None,
) -> list[Path]:
    """Write one file per topic that has messages; after an error no file remains.

    Args:
        bag: The recording.
        out: Folder; default ``export`` in the bag's folder.
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
    bag = bag if isinstance(bag, Bag) else open_bag(bag)
    folder = Path(out) if out else bag.folder / "export"
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


def _export_one(bag: Bag, name: str, folder: Path, form: str) -> Path:
    stem = within(folder, stem_of(name), "topic").name
    table = columns(bag, name)
    if table is None:
        return _write_lines(bag, name, folder / f"{stem}.jsonl")
    path = folder / f"{stem}.{form}"
    if form == "npz":
        np.savez(path, **table)
    else:
        _write_csv(path, table)
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


def _texts_agree(bag: Bag, name: str, records: np.ndarray) -> bool:
    """Whether the non-numeric bytes (names, lengths) are the same in every message."""
    covered = np.zeros(records.dtype.itemsize, dtype=bool)
    for kind, at, *_ in records.dtype.fields.values():
        covered[at : at + kind.itemsize] = True
    covered[:4] = True  # encapsulation header of CDR
    data = records.view(np.uint8).reshape(len(records), -1)
    return not covered.size or bool((data[:, ~covered] == data[0, ~covered]).all())


def _write_csv(path: Path, found: dict[str, np.ndarray]) -> None:
    head, series = [], []
    for name, values in found.items():
        if values.ndim == 1:
            head.append(name)
            series.append(values.tolist())
        else:
            head += [f"{name}[{i}]" for i in range(values.shape[1])]
            series += values.T.tolist()
    with open(path, "w", newline="") as stream:
        writer = csv.writer(stream)
        writer.writerow(head)
        writer.writerows(zip(*series, strict=True))


def _write_lines(bag: Bag, name: str, path: Path) -> Path:
    times, data = bag.raw(name)
    with open(path, "w") as stream:
        for t, message in zip(times.tolist(), data, strict=True):
            content = plain(bag.message(name, message))
            stream.write(json.dumps({TIME: t / 1e9, **content}) + "\n")
    return path


def plain(value: Any) -> Any:
    """A message as numbers, strings, lists and dictionaries, ready for JSON."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, (list, tuple, array)):
        return [plain(v) for v in value]
    if isinstance(value, bytes):
        return list(value)
    return value
