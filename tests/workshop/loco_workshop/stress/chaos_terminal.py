# SPDX-License-Identifier: Apache-2.0
"""Terminal output of `loco chaos`: progress bar, results as JSON and Markdown tables."""

from __future__ import annotations

import argparse
import json
from typing import Any

from loco_bringup.terminal import bar, console

from ..reliability.figures import keep
from . import chaos
from .faults import SAFE_TICKS

_SIGNALS = {
    "repeats": "repeats",
    "damped": "damped, by joint torques",
    "safe": "safe",
    "worst": f"worst ticks (at most {SAFE_TICKS})",
    "ridden": "ridden through",
    "late": "the machine was late",
    "ended": "run ended and said why",
    "stalls": "time-outs in between",
}
_LEFT = {
    "bags": "bags",
    "whole": "whole or recovered",
    "orphans": "processes left",
    "segments": "shared memory left",
}


def show_chaos(a: argparse.Namespace) -> int:
    """Run the missing cells; returns 0 if every cell met its requirement, else 1."""
    selected = chaos.cells(a.only)
    with bar("{task.completed}/{task.total} cells", "{task.fields[last]}") as progress:
        task = progress.add_task("chaos", total=len(selected), last="", completed=-1)

        def tell(cell: chaos.Cell) -> None:
            progress.update(task, advance=1, last=cell.name)

        by_cell = chaos.run(selected, a.repeats, a.seed, a.out, tell)
    rows = [row for rows in by_cell.values() for row in rows]
    keep(a.out, "chaos", counts(rows))
    (a.out / "chaos.json").write_text(json.dumps(rows, indent=1))
    text = page(rows)
    (a.out / "chaos.md").write_text(text)
    console.print(text, markup=False)
    failed = [row for row in rows if not row["ok"]]
    for row in failed:
        message = "; ".join(row["notes"]) or "not what docs/faults.md says"
        console.print(f"{row['how']} {row['what']}: {message}", markup=False)
    console.print(f"{len(rows) - len(failed)} of {len(rows)} cells as they have to be: {a.out}")
    return int(bool(failed))


def counts(rows: list[dict[str, Any]]) -> dict[str, tuple[bool, dict[str, int]]]:
    """Numbers of cells and of those as required, by signal, or for rough and faults."""
    by_kind: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        is_fault = row["how"] not in ("SIGSTOP", "SIGKILL", "rough")
        by_kind.setdefault("faults" if is_fault else row["how"], []).append(row)
    return {
        kind: (
            all(row["ok"] for row in of_kind),
            {
                "cells": len(of_kind), "good cells": sum(row["ok"] for row in of_kind),
                "repeats": sum(row.get("repeats", 0) for row in of_kind),
            },
        )
        for kind, of_kind in by_kind.items()
    }  # fmt: skip


def page(rows: list[dict[str, Any]]) -> str:
    """Tables of signals and of faults, as Markdown."""
    signals = [r for r in rows if r["how"].startswith("SIG") or r["how"] == "rough"]
    faults = [r for r in rows if r not in signals]
    parts = ["# Chaos", "", "<!-- written by `loco chaos` -->"]
    if signals:
        lines = [[f"`{r['what']}`", r["how"], *_values(r, _SIGNALS), *_end(r)] for r in signals]
        head = ["what", "how", *_SIGNALS.values(), *_LEFT.values(), "as it has to be"]
        parts += ["", "## Signals and rough circumstances", "", *_table(head, lines)]
    if faults:
        parts += ["", "## Faults", "", _LEGEND, "", *_of_faults(faults)]
    return "\n".join(parts) + "\n"


_LEGEND = f"""\
Per cell: how often the safe state came (and after how many ticks at most; {SAFE_TICKS} are allowed)
or the fault was ridden through, both judged by joint torques, too; in brackets how many messages
were hit. `fell`: of all faults of the topic, those that brought HyQ down."""


def _of_faults(rows: list[dict[str, Any]]) -> list[str]:
    """Markdown table with one row per topic and one column per fault."""
    faults = [k for k in dict.fromkeys(row["how"] for row in rows) if k != "faults"]  # an error row
    lines = []
    for topic in dict.fromkeys(row["what"] for row in rows):
        by_kind = {row["how"]: row for row in rows if row["what"] == topic}
        falls = str(sum(row.get("fell", 0) for row in by_kind.values()))
        cells = [_outcome(by_kind[kind]) if kind in by_kind else "" for kind in faults]
        minimum = min(by_kind.values(), key=lambda row: row["ok"])
        lines.append([f"`{topic}`", *cells, falls, *_end(minimum)])
    return _table(["topic", *faults, "fell", *_LEFT.values(), "as it has to be"], lines)


def _outcome(row: dict[str, Any]) -> str:
    safe = f"{row['safe']} safe ≤ {row['worst']}" if row.get("taken") else ""
    ridden = f"{row['ridden']} ridden" if row.get("ridden") else ""
    hit = f"({row['hit']})" if row.get("hit") else ""
    return " ".join(filter(None, [", ".join(filter(None, [safe, ridden])) or "-", hit]))


def _end(row: dict[str, Any]) -> list[str]:
    return [*_values(row, _LEFT), "yes" if row["ok"] else "NO"]


def _values(row: dict[str, Any], names: dict[str, str]) -> list[str]:
    return [str(row.get(name, "-")) for name in names]


def _table(head: list[str], lines: list[list[str]]) -> list[str]:
    rows = [head, ["---"] * len(head), *lines]
    return ["| " + " | ".join(row) + " |" for row in rows]
