# SPDX-License-Identifier: Apache-2.0
"""`loco list` and `loco info`: what there is to run and what a bag holds."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from loco_control.exceptions import LocoError, NameUnknownError

from .console import console

if TYPE_CHECKING:
    from .bag import Bag


def show(what: str | None) -> None:
    """Print one list, or all of them.

    Raises:
        NameUnknownError: There is no such list.
    """
    if what is not None and what not in _LISTS:
        raise NameUnknownError("list", what, _LISTS)
    for name in [what] if what else _LISTS:
        title, columns, rows = _LISTS[name]()
        console.print(_table(title, columns, rows))


def _table(title: str, columns: Iterable[str], rows: Iterable[Iterable[str]]) -> Table:
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for column in columns:
        table.add_column(column, overflow="fold")
    for row in rows:
        table.add_row(*row)
    return table


def _experiments() -> tuple[str, tuple, list]:
    from loco_learning import experiment

    rows = []
    for name in experiment.names():
        e = experiment.load(name)
        rows.append((name, f"{e.ticks / e.control_rate:.0f} s", e.description))
    return "Experiments (loco run NAME)", ("name", "length", "what it shows"), rows


def _studies() -> tuple[str, tuple, list]:
    from loco_learning import study

    rows = [(name, study.load(name).description) for name in study.names()]
    return "Studies (loco study NAME)", ("name", "what it shows"), rows


def _effects() -> tuple[str, tuple, list]:
    from loco_sim import effects

    rows = [(name, _first_line(effects.EFFECTS[name])) for name in effects.names()]
    return "Effects (effects: [{name: ...}] in an experiment)", ("name", "what it does"), rows


def _topics() -> tuple[str, tuple, list]:
    from loco_control.ros.joint_topics import TABLES

    rows = [
        (t.name, graph, t.type.__name__, f"{t.rate:g} Hz" if t.rate else "event", t.writer, t.doc)
        for graph, table in TABLES.items()
        for t in table.values()
    ]
    return "Topics", ("name", "graph", "type", "rate", "writer", "what it says"), rows


def _bags() -> tuple[str, tuple, list]:
    from .bag import Bag

    rows = []
    for folder in sorted(p.parent for p in Path("bags").glob("*/*.mcap")):
        try:
            bag = Bag(folder)
            length = f"{bag.end - bag.start:.1f} s"
            rows.append((str(folder), length, bag.metadata.get("experiment", "")))
        except LocoError as error:
            rows.append((str(folder), "?", str(error)))
    return "Bags (loco info BAG, loco report BAG)", ("folder", "length", "experiment"), rows


_LISTS: dict[str, Callable[[], tuple[str, tuple, list]]] = {
    "experiments": _experiments,
    "studies": _studies,
    "effects": _effects,
    "topics": _topics,
    "bags": _bags,
}


def show_bag(path: Path, check: bool = False, as_json: bool = False) -> None:
    """Print the topics, files and metadata of a bag.

    Args:
        path: Bag folder or ``.mcap`` file.
        check: Read every chunk and check every sum.
        as_json: Print JSON instead.

    Raises:
        BagError: The bag is damaged.
    """
    from .bag import Bag

    bag = Bag(path)
    if check:
        for _ in bag.file.blocks():
            pass
        list(bag.file.attachments())
    if as_json:
        console.print_json(json.dumps(_about(bag)))
        return
    length = bag.end - bag.start
    console.print(f"{bag.path}: {length:.2f} s, {bag.path.stat().st_size / 1e6:.1f} MB")
    chunks, size, packed = _packing(bag)
    console.print(
        f"  {chunks} chunks of {size / max(chunks, 1) / 1e3:.0f} kB, packed to {packed} %"
    )
    if check:
        console.print("  every chunk and file is whole")
    for key, value in bag.metadata.items():
        if key == "versions":
            value = ", ".join(f"{name} {v}" for name, v in json.loads(value).items())
        console.print(f"  {key}: {value}")
    rows = [
        (t.name, t.type, str(t.count), f"{t.count / length:.1f} Hz" if length else "")
        for t in bag.topics.values()
    ]
    console.print(_table("Topics", ("name", "type", "messages", "rate"), rows))
    files = [(name, f"{size} bytes") for name, size in bag.attachments().items()]
    console.print(_table("Files inside", ("name", "size"), files))


def _packing(bag: Bag) -> tuple[int, int, int]:
    """Number of chunks, their unpacked size [bytes] and packed share [%]."""
    from .mcap_chunk import chunk_head

    heads = [chunk_head(bag.file.data, chunk) for chunk in bag.file.chunks]
    size = sum(head.size for head in heads)
    packed = sum(head.stop - head.start for head in heads)
    return len(heads), size, round(100 * packed / max(size, 1))


def _about(bag: Bag) -> dict[str, Any]:
    """The same as data: times [s], sizes [bytes]."""
    return {
        "path": str(bag.path),
        "start": bag.start,
        "end": bag.end,
        "size": bag.path.stat().st_size,
        "metadata": bag.metadata,
        "topics": [dataclasses.asdict(t) for t in bag.topics.values()],
        "files": bag.attachments(),
    }


def _first_line(thing: type) -> str:
    return (thing.__doc__ or "").strip().splitlines()[0]
