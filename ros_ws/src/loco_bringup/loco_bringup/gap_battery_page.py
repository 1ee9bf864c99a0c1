# SPDX-License-Identifier: Apache-2.0
"""Score of a battery as JSON, Markdown and one self-contained HTML page."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from loco_learning.gap.battery import score, score_text

from . import gap_battery_bags as bags

STYLE = """
body{font:15px/1.5 system-ui,sans-serif;color:#1c2430;max-width:1100px;margin:2em auto;
padding:0 1em}
h1{font-size:1.5em}h2{font-size:1.15em;margin-top:2em}
table{border-collapse:collapse;font-size:13px}td,th{padding:2px 8px;border-bottom:1px solid #dde2e8;
text-align:left;white-space:nowrap}th{background:#f3f5f8}.m td{text-align:center;padding:2px 5px}
.m th.v{writing-mode:vertical-rl;transform:rotate(180deg);font-weight:400}.w{overflow-x:auto}
.good{background:#cfe8d5}.bad{background:#f6cfc4}.so{background:#f7ecc9}
"""


def write_score(folder: Path, results: Sequence[Mapping[str, Any]]) -> list[str]:
    """Score all results of a battery; writes score.json, score.md and score.html.

    Returns:
        Lines for the terminal.
    """
    rows = [score.row(bags.truth(folder, r["case"]), r) for r in results if _has(folder, r["case"])]
    found = score.figures(rows)
    again = score.followed(rows)
    later = score.figures(again) if again else None
    settings = json.loads((folder / "battery.json").read_text(encoding="utf-8"))
    title = f"Blind battery, seed {settings['seed']}"
    table = score.confusion(rows)
    bags.write_json(folder / "score.json", {
        "format": 1, "settings": settings, "figures": found, "followed": later,
        "confusion": table, "rows": rows,
    })  # fmt: skip
    text = score_text.markdown(found, rows, title, later)
    (folder / "score.md").write_text(text, encoding="utf-8")
    (folder / "score.html").write_text(page(title, found, rows, table, later), encoding="utf-8")
    head, told = score_text.acceptance(found, later)
    shown = [head, *told] if later else told
    lines = [f"  {a:78s} " + "  ".join(f"{b:>6s}" for b in rest) for a, *rest in shown]
    return [f"{title}: {found['cases']} cases", *lines, f"  {folder / 'score.html'}"]


def _has(folder: Path, name: str) -> bool:
    return (folder / bags.TRUTH / f"{name}.json").is_file()


def page(
    title: str,
    found: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    table: Mapping[str, Mapping[str, int]],
    later: Mapping[str, Any] | None = None,
) -> str:
    """The page."""
    seconds = score_text.number(found["seconds median"])
    head, held = score_text.held_out(found["held-out error"])
    columns = ("case", "robot", "hidden", "size", "shows", "verdict", "names", "before", "after",
               "place", "size error", "seconds", *(score_text.THEN if later else ()))  # fmt: skip
    cells = [_case(r) for r in rows]
    if later:
        cells = [(*a, *b) for a, b in zip(cells, score_text.then(rows), strict=True)]
    body = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p>{found['cases']} cases, {found['errors']} ended by an error; median {seconds} s per "
        "case. Hidden effects, dynamics, drives and sensors are made by code of their own "
        "(<code>docs/gap_battery.md</code>); the workflow sees bags and a model only.</p>",
        _table(*score_text.acceptance(found, later)),
        "<h2>By robot and size</h2><p>Single effects; by robot: medium and large.</p>",
        _table(*score_text.rates(found)),
        *(
            (
                f"<p>The same {score_text.AFTER}, where the verdict was ambiguous:</p>",
                _table(*score_text.rates(later)),
            )
            if later
            else ()
        ),
        "<h2>What was hidden (rows), what was said (columns)</h2>",
        _matrix(table),
        "<h2>Held-out error, in noise floors</h2>",
        f"<p>{found['held-out error']['cases']} cases with something hidden.</p>",
        _table(head, held),
        "<h2>Cases</h2>",
        _table(columns, cells, [_mark(r) for r in rows]),
    ]
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8">'
        f"<title>{html.escape(title)}</title><style>{STYLE}</style><body>"
        + "\n".join(body)
        + "</body></html>\n"
    )


def _table(head: Sequence[Any], rows: Sequence[Sequence[Any]], marks: Sequence[str] = ()) -> str:
    marks = marks or [""] * len(rows)
    top = "".join(f"<th>{html.escape(str(x))}</th>" for x in head)
    lines = [
        f'<tr class="{mark}">' + "".join(f"<td>{html.escape(str(x))}</td>" for x in row) + "</tr>"
        for row, mark in zip(rows, marks, strict=True)
    ]
    return f'<div class="w"><table><tr>{top}</tr>{"".join(lines)}</table></div>'


def _matrix(table: Mapping[str, Mapping[str, int]]) -> str:
    """Confusion matrix, true names first and verdicts without a name last."""
    said = {name for line in table.values() for name in line}
    order = [n for n in table if n in said]
    order += sorted(said - set(order) - set(score.UNNAMED))
    order += [n for n in score.UNNAMED if n in said]
    top = "".join(f'<th class="v">{html.escape(n)}</th>' for n in order)
    lines = []
    for true, line in table.items():
        cells = []
        for name in order:
            count = line.get(name, 0)
            good = name.split(" and ")[0] == true or (true == "nothing" and name == "no gap")
            kind = ("good" if good else "so" if name in score.UNNAMED else "bad") if count else ""
            cells.append(f'<td class="{kind}">{count or ""}</td>')
        lines.append(f"<tr><th>{html.escape(true)}</th>{''.join(cells)}</tr>")
    return f'<div class="w"><table class="m"><tr><th></th>{top}</tr>{"".join(lines)}</table></div>'


def _case(r: Mapping[str, Any]) -> tuple[str, ...]:
    case, robot, true, size, verdict, said, before, after = score_text.case(r)
    shows = ", ".join(score_text.number(v) for v in r["shows"])
    place = "" if r["place"] is None else "right" if r["place"] else "wrong"
    error = ", ".join(score_text.percent(s["error"]) for s in r["sizes"])
    seconds = score_text.number(r["seconds"])
    return case, robot, true, size, shows, verdict, said, before, after, place, error, seconds


def _mark(r: Mapping[str, Any]) -> str:
    """Good, wrong or undecided."""
    if r["kind"] == "null":
        return "good" if r["verdict"] == "no gap" else "bad" if r["named"] else "so"
    if r["kind"] == "outsider":
        return "good" if r["abstained"] else "bad" if r["named"] else "so"
    if set(r["true"]) <= set(r["said"]) or r["right"]:
        return "good"
    return "bad" if r["named"] else "so"
