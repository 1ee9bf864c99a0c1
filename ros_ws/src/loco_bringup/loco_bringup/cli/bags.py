# SPDX-License-Identifier: Apache-2.0
"""`loco info`, `recover`, `export` and `extract`: commands that read a bag and start no robot."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.reading import shown
from loco_learning.gap.importing import tables

from ..bag.coding import is_packed
from ..bag.copy import extract as extract_topics
from ..bag.foreign.opening import open_bag
from ..bag.foreign.raw import RawBag
from ..bag.mcap_chunk import chunk_head
from ..bag.mcap_file import McapFile
from ..bag.parts import stated_counts
from ..bag.reader import Bag
from ..bag.recover import recover as recover_bag
from ..bag.writer import Limits
from ..logs.export import export as export_topics
from ..terminal import console, table


def recover(a: argparse.Namespace) -> int:
    """`loco recover`: recover a bag and print what is lost."""
    recovery = recover_bag(a.bag, a.out)
    sys.stdout.write(f"{recovery}\n" + "".join(f"  {note}\n" for note in recovery.notes))
    return 0


def export(a: argparse.Namespace) -> int:
    """`loco export`: export topics and print the names of the files."""
    for path in export_topics(a.bag, a.out, a.format, a.topics):
        sys.stdout.write(f"{path}\n")
    return 0


def extract(a: argparse.Namespace) -> int:
    """`loco extract`: copy topics to a new bag and print its folder."""
    limits = Limits(a.max_bag_size, a.max_bag_duration)
    sys.stdout.write(f"{extract_topics(a.bag, a.out, a.topics, limits)}\n")
    return 0


def info(a: argparse.Namespace) -> int:
    """`loco info`: print the contents of a bag."""
    show_bag(a.bag, a.check, a.json)
    return 0


def show_bag(path: Path, check: bool = False, as_json: bool = False) -> None:
    """Print the topics, files and metadata of a bag.

    Args:
        path: Bag folder or ``.mcap`` file.
        check: Read every chunk and verify every checksum.
        as_json: Print JSON instead.

    Raises:
        BagError: The bag is damaged.
    """
    if tables.is_table(path):
        _show_table(path, as_json)
        return
    bag = open_bag(path)
    if check:
        bag.check()
    if as_json:
        console.print_json(json.dumps(_about(bag)))
        return
    length, names = bag.end - bag.start, [path.name for path in bag.paths]
    console.print(f"{bag.path}: {length:.2f} s, {_size(bag) / 1e6:.1f} MB")
    parts = [f"{len(names)} files, {names[0]} to {names[-1]}"] * (len(names) > 1)
    intact = f"every {'message' if isinstance(bag, RawBag) else 'chunk and file'} is whole"
    for line in (*parts, _form(bag), *_disagreements(bag), *[intact] * check):
        console.print(f"  {line}")
    for key, value in bag.metadata.items():
        if key == "versions":
            value = ", ".join(f"{name} {v}" for name, v in bag.versions.items()) or value
        console.print(f"  {key}: {value}")
    rows = [
        (t.name, t.type, str(t.count), f"{t.count / length:.1f} Hz" if length else "")
        for t in bag.topics.values()
    ]
    console.print(table("Topics", ("name", "type", "messages", "rate"), rows))
    files = ((name, f"{size} bytes") for name, size in bag.attachments().items())
    console.print(table("Files inside", ("name", "size"), files))


def _show_table(path: Path, as_json: bool) -> None:
    """Print the columns of a table of samples: readings, smallest and largest value."""
    samples = tables.read(path)
    rows = {
        name: {
            "readings": int(np.isfinite(x).sum()),
            "smallest": float(np.min(x, initial=np.inf, where=np.isfinite(x))),
            "largest": float(np.max(x, initial=-np.inf, where=np.isfinite(x))),
        }
        for name, x in samples.columns.items()
    }
    if as_json:
        about = {"path": str(path), "rows": len(samples), "columns": rows, "texts": samples.texts}
        console.print_json(json.dumps(about))
        return
    console.print(f"{path}: {len(samples)} rows, {path.stat().st_size / 1e6:.1f} MB")
    cells = [
        (name, str(one["readings"]), f"{one['smallest']:.6g}", f"{one['largest']:.6g}")
        for name, one in rows.items()
    ]
    console.print(table("Columns", ("name", "readings", "smallest", "largest"), cells))
    for name in samples.texts:
        console.print(f"  {name}: text")


def _disagreements(bag: Bag) -> list[str]:
    """Files whose message count differs from ``metadata.yaml``, one line each.

    This is no error: recorders count received messages, including dropped ones. The count of a
    file still being written is 0.
    """
    stated = stated_counts(bag.folder) or {}
    notes = []
    for path in () if isinstance(bag, RawBag) else bag.paths:
        count, expected = McapFile(path).summary.statistics.message_count, stated.get(path.name)
        if expected and expected != count:
            notes.append(
                f"metadata.yaml states {shown(expected)} messages in {path.name}, "
                f"the file has {count}, which counts"
            )
    return notes


def _form(bag: Bag) -> str:
    """Format and compression of the files as text."""
    packing = ", each file packed" if any(map(is_packed, bag.paths)) else ""
    coding = f", {bag.coding}" if bag.coding else ""
    if isinstance(bag, RawBag):
        return f"{bag.form}{coding}{packing}"
    heads = [chunk_head(f.data, c) for f in map(McapFile, bag.paths) for c in f.chunks]
    size = sum(head.size for head in heads)
    packed = round(100 * sum(head.stop - head.start for head in heads) / max(size, 1))
    each = f"{size / max(len(heads), 1) / 1e3:.0f} kB"
    return f"{len(heads)} chunks of {each}, packed to {packed} %{coding}{packing}"


def _size(bag: Bag) -> int:
    """Size of the files [bytes]."""
    return sum(path.stat().st_size for path in bag.paths)


def _about(bag: Bag) -> dict[str, Any]:
    """Topics, files and metadata of a bag as data for JSON: times [s], sizes [bytes]."""
    return {
        "path": str(bag.path),
        "start": bag.start,
        "end": bag.end,
        "size": _size(bag),
        "parts": [path.name for path in bag.paths],
        "metadata": bag.metadata,
        "topics": [dataclasses.asdict(t) for t in bag.topics.values()],
        "files": bag.attachments(),
        "notes": _disagreements(bag),
    }
