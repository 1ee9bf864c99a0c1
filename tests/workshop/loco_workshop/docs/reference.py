# SPDX-License-Identifier: Apache-2.0
"""`loco docs`: reference tables of ``docs/``, generated from the code."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from loco_bringup.cli.clone import root
from loco_bringup.terminal import console
from loco_control.faults import FAULTS, Fault
from loco_control.gait.oscillators import CpgParams
from loco_control.params import Params
from loco_control.realtime import RealtimeParams
from loco_control.ros.health import HealthParams
from loco_control.ros.messages.joint_topics import TABLES
from loco_control.ros.messages.topics import LOST_TICK, WRITER_DEPTH, faulty
from loco_learning.params import JointLearnerParams
from loco_learning.runs.experiment import Experiment
from loco_learning.runs.network_experiment import NetworkExperiment
from loco_sim.effects.identity import SITES
from loco_sim.params import SimParams, TickParams
from loco_sim.plant.safety import SafetyParams

from ..reliability import page as reliability_page
from .effects_figures import draw_all
from .effects_page import overview, page
from .site import build

_NOTE = "<!-- printed by `loco docs --write`; edit the code, not this file -->"


def show_docs(a: argparse.Namespace) -> int:
    """`loco docs`: print the pages, or write pages or figures to ``docs/``."""
    if a.site:
        build(root(), Path(a.out))
        console.print(f"{a.out}/index.html")
        return 0
    if a.figures:
        for path in draw_all(root() / "docs" / "pictures" / "effects"):
            console.print(f"wrote {path}")
        return 0
    for name, text in pages().items():
        if a.write:
            path = root() / "docs" / name
            path.write_text(text)
            console.print(f"wrote {path}")
        else:
            console.print(text, markup=False)
    return 0


def pages() -> dict[str, str]:
    """Name and text of every generated page."""
    return {
        "topics.md": _topics(),
        "messages.md": _messages(),
        "parameters.md": _parameters(),
        "parameters_nodes.md": _node_parameters(),
        "effects.md": _page("Effects", *overview()),
        reliability_page.PAGE: reliability_page.current(),
        **{f"effects_{site}.md": _page(f"Effects: {site}", *page(site)) for site in SITES},
    }


def _topics() -> str:
    head = ("topic", "type", "QoS", "rate (simulated time)", "writer", "readers", "content")
    parts = [
        f"## Graph `{name}`\n\n{_table(head, map(_topic_row, rows.values()))}"
        for name, rows in TABLES.items()
    ]
    return _page(
        "Topics",
        "Names are relative unless they start with `/`. Depth is that of the reader; writers keep "
        f"{WRITER_DEPTH} messages for the recorder. Rates are per simulated second; those of the "
        "graph `joint` are for a robot with 100 ticks per second.",
        f"With [faults](faults.md), readers of a damaged topic read `{faulty('TOPIC')}` instead. "
        f"`{LOST_TICK.name}` (`std_msgs/UInt64`) then means: {LOST_TICK.doc}.",
        *parts,
    )


def _topic_row(t: Any) -> tuple[str, ...]:
    return (
        f"`{t.name}`",
        f"`{t.message}`",
        ("reliable" if t.qos.reliable else "best effort")
        + (", transient local" if t.qos.latched else "")
        + f", depth {t.qos.depth}",
        f"{t.rate:g} Hz" if t.rate else "on event",
        t.writer,
        ", ".join(t.readers) or "tools",
        t.doc,
    )


def _messages() -> str:
    parts = []
    for path in sorted((root() / "src" / "loco_msgs" / "msg").glob("*.msg")):
        lines = path.read_text().splitlines()
        intro = lines[0].lstrip("# ")
        rows = []
        for line in lines[1:]:
            declared, _, comment = line.partition("#")
            kind, name = declared.split()
            text, unit = _split_unit(comment.strip())
            rows.append((f"`{name}`", f"`{kind}`", unit, text))
        parts.append(
            f"## {path.stem}\n\n{intro}\n\n{_table(('field', 'type', 'unit', 'meaning'), rows)}"
        )
    return _page(
        "Messages", "Package `loco_msgs`; every array on the control path has a fixed size.", *parts
    )


def _split_unit(comment: str) -> tuple[str, str]:
    """Text of a comment, and the unit in its last brackets."""
    if comment.endswith("]") and "[" in comment:
        text, _, unit = comment[:-1].rpartition("[")
        return text.strip(), unit
    return comment, ""


_HEAD = ("key", "default", "unit", "range", "meaning")


def _parameters() -> str:
    return _page(
        "Parameters",
        "Keys of an experiment YAML; `loco run NAME --set gait.speed=0.3` changes one. The nodes "
        "declare the same names as ROS parameters. [More parameters of the nodes]"
        "(parameters_nodes.md) are on a page of their own.",
        "## Experiment\n\nThese are the keys of an experiment with a gait, such as of HyQ.\n\n"
        + _table(_HEAD, _rows(Experiment(), "")),
        "### Without a gait\n\nAn experiment with a `target` has no gait, trunk or stance. The "
        "inputs of its learner are joints and IMU.\n\n"
        + _table(_HEAD, [*_rows(CpgParams(), "target."), *_rows(JointLearnerParams(), "learner.")]),
        "### The plant\n\nThe section `sim` has the values that differ from those of the robot.\n\n"
        + _table(_HEAD, _rows(SimParams(), "sim.")),
        "## Masses and springs\n\nThese are the keys of an experiment with a `network` or a "
        "`preset`.\n\n" + _table(_HEAD, _rows(NetworkExperiment(), "")),
    )


def _node_parameters() -> str:
    common = list(_rows(Fault(), ""))
    faults = [("all", *row) for row in common]
    for kind, fault in FAULTS.items():
        faults += [(f"`{kind}`", *row) for row in _rows(fault(), "") if row not in common]
    return _page(
        "Parameters of nodes",
        "ROS parameters of the nodes that are not keys of an experiment.",
        "## Every node\n\nEach limit has two values, for a warning and for an error.\n\n"
        + _table(_HEAD, _rows(HealthParams(), "diagnostics."))
        + "\n\n`loco run --realtime fifo=80` sets one of these:\n\n"
        + _table(_HEAD, _rows(RealtimeParams(), "realtime.")),
        "## Plants\n\nOnly `robot_sim` has these parameters.\n\n"
        + _table(_HEAD, _rows(SafetyParams(), "safety."))
        + "\n\n`loco run --tick late=safe-stop` sets one of these:\n\n"
        + _table(_HEAD, _rows(TickParams(), "")),
        "## Faults\n\nThese are the keys of `loco run --fault TOPIC:KIND:KEY=VALUE` "
        "([faults](faults.md)).\n\n" + _table(("kind", *_HEAD), faults),
    )


def _rows(params: Any, prefix: str) -> Iterable[tuple[str, ...]]:
    for f in dataclasses.fields(params):
        optional = f.metadata.get("optional")
        if optional and getattr(params, f.name) is None:
            continue
        stated = f.default is not dataclasses.MISSING and not prefix and not optional
        value = f.default if stated else getattr(params, f.name)  # the constructor may set defaults
        if f.default_factory in (dict, tuple) and not prefix:
            value = f.default_factory()
        if isinstance(value, Params):
            yield from _rows(value, f"{prefix}{f.name}.")
        elif not f.name.startswith("_"):
            meta = f.metadata
            yield (
                f"`{prefix}{f.name}`",
                _code(value),
                meta.get("unit", "-"),
                _range(meta),
                meta.get("doc", ""),
            )


def _code(value: Any) -> str:
    return f"`{list(value) if isinstance(value, tuple) else value}`"


def _range(meta: Any) -> str:
    if meta.get("choices"):
        return ", ".join(f"`{c}`" for c in meta["choices"])
    low, high = meta.get("low"), meta.get("high")
    if low is None and high is None:
        return ""
    left = "(-inf" if low is None else f"[{low:g}"
    right = "inf)" if high is None else f"{high:g}]"
    return f"{left}, {right}"


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join(lines)


def _page(title: str, intro: str, *parts: str) -> str:
    return "\n\n".join((f"# {title}", _NOTE, intro, *parts)) + "\n"
