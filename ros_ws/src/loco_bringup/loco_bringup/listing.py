# SPDX-License-Identifier: Apache-2.0
"""`loco list` and `loco info`: what there is to run and what a bag holds."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path

from rich.table import Table

from loco_control.exceptions import LocoError, NameUnknownError

from .console import console


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


def show_bag(path: Path) -> None:
    """Print the topics, files and metadata of a bag."""
    from .bag import Bag

    bag = Bag(path)
    length = bag.end - bag.start
    console.print(f"{bag.path}: {length:.2f} s, {bag.path.stat().st_size / 1e6:.1f} MB")
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


def _first_line(thing: type) -> str:
    return (thing.__doc__ or "").strip().splitlines()[0]
