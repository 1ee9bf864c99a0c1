# SPDX-License-Identifier: Apache-2.0
"""`loco chaos`: the matrix with a progress bar, then its table as JSON and Markdown."""

from __future__ import annotations

import argparse
import json
from typing import Any

from . import chaos
from .chaos_faults import SAFE_TICKS
from .console import bar, console

_NAMES = {"repeats": "repeats", "safe": "safe", "worst": f"worst ticks (at most {SAFE_TICKS})",
          "ridden": "ridden through", "ended": "run ended and said why", "fell": "fell",
          "bags": "bags", "whole": "whole or recovered", "orphans": "processes left",
          "segments": "shared memory left"}  # fmt: skip


def show_chaos(a: argparse.Namespace) -> int:
    """Run what is missing; 0 if every cell did what it has to."""
    chosen = chaos.cells(a.only)
    with bar("{task.completed}/{task.total} cells", "{task.fields[last]}") as progress:
        task = progress.add_task("chaos", total=len(chosen), last="", completed=-1)

        def tell(cell: chaos.Cell) -> None:
            progress.update(task, advance=1, last=cell.name)

        found = chaos.run(chosen, a.repeats, a.seed, a.out, tell)
    rows = [row for rows in found.values() for row in rows]
    (a.out / "chaos.json").write_text(json.dumps(rows, indent=1))
    text = page(rows)
    (a.out / "chaos.md").write_text(text)
    console.print(text, markup=False)
    bad = [row for row in rows if not row["ok"]]
    for row in bad:
        said = "; ".join(row["notes"]) or "not what docs/faults.md says"
        console.print(f"{row['how']} {row['what']}: {said}", markup=False)
    console.print(f"{len(rows) - len(bad)} of {len(rows)} cells as they have to be: {a.out}")
    return int(bool(bad))


def page(rows: list[dict[str, Any]]) -> str:
    """Tables of signals and of faults, as Markdown."""
    signals = [r for r in rows if r["how"].startswith("SIG")]
    faults = [r for r in rows if not r["how"].startswith("SIG")]
    parts = ["# Chaos", "", "<!-- written by `loco chaos` -->"]
    for title, chosen, names in (
        ("Signals", signals, ("process", "signal")),
        ("Faults", faults, ("topic", "fault")),
    ):
        if chosen:
            columns = [c for c in _NAMES if any(c in row for row in chosen)]
            parts += ["", f"## {title}", "", *_table(chosen, names, columns)]
    return "\n".join(parts) + "\n"


def _table(rows: list[dict[str, Any]], names: tuple[str, str], columns: list[str]) -> list[str]:
    head = [*names, *(_NAMES[c] for c in columns), "as it has to be"]
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for row in rows:
        silent = row.get("messages") == 0
        how = row["how"] + (" (nobody spoke)" if silent else "")
        cells = [f"`{row['what']}`", how, *(str(row.get(c, "-")) for c in columns)]
        lines.append("| " + " | ".join([*cells, "yes" if row["ok"] else "NO"]) + " |")
    return lines
