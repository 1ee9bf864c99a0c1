# SPDX-License-Identifier: Apache-2.0
"""Score of a battery as JSON, Markdown and one self-contained HTML page.

The page of a published battery, with ``PYTHONPATH=tests/workshop``:
``.venv/bin/python -m loco_workshop.battery.page docs/results/gap_battery/seed_7301.jsonl.gz PAGE``
"""

from __future__ import annotations

import gzip
import json
import sys
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from markupsafe import Markup

from loco_bringup.page import html
from loco_bringup.page.html import document, part
from loco_control.exceptions import ParameterError
from loco_control.files import write_whole
from loco_learning.drawing.chart import (
    DASHED,
    GREY,
    PALETTE,
    Axis,
    Chart,
    Frame,
    dots,
    line,
)

from . import bags, score, score_text

MARKS = {"good": ("right", PALETTE[2]), "so": ("undecided", PALETTE[4]),
         "bad": ("wrong", PALETTE[1])}  # fmt: skip
_ERRORS = (
    "A dot for each case: rms of what the model misses on data that was never fitted, before and "
    "after the search. On the dashed line nothing was gained."
)


def write_score(folder: Path, results: Sequence[Mapping[str, Any]]) -> list[str]:
    """Score all results of a battery; writes score.json, score.md and score.html.

    Returns:
        Lines for the terminal.
    """
    rows = [score.row(bags.truth(folder, r["case"]), r) for r in results if _has(folder, r["case"])]
    figures = score.figures(rows)
    repeats = score.followed(rows)
    later = score.figures(repeats) if repeats else None
    settings = json.loads((folder / "battery.json").read_text(encoding="utf-8"))
    title = f"Blind battery, seed {settings['seed']}"
    table = score.confusion(rows)
    bags.write_json(folder / "score.json", {
        "format": 1, "settings": settings, "figures": figures, "followed": later,
        "confusion": table, "rows": rows,
    })  # fmt: skip
    text = score_text.markdown(figures, rows, title, later)
    write_whole(folder / "score.md", text)
    write_whole(folder / "score.html", page(title, figures, rows, table, later))
    head, targets = score_text.acceptance(figures, later)
    rows_text = [head, *targets] if later else targets
    lines = [f"  {a:78s} " + "  ".join(f"{b:>6s}" for b in rest) for a, *rest in rows_text]
    return [f"{title}: {figures['cases']} cases", *lines, f"  {folder / 'score.html'}"]


def _has(folder: Path, name: str) -> bool:
    return (folder / bags.TRUTH / f"{name}.json").is_file()


def page(
    title: str,
    found: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    table: Mapping[str, Mapping[str, int]],
    later: Mapping[str, Any] | None = None,
) -> str:
    """HTML text of the page."""
    columns = ("case", "robot", "hidden", "size", "shows", "verdict", "names", "before", "after",
               "place", "size error", *(score_text.THEN if later else ()))  # fmt: skip
    cells = [_case(r) for r in rows]
    if later:
        cells = [(*a, *b) for a, b in zip(cells, score_text.then(rows), strict=True)]
    header = html.paragraph(
        f"{found['cases']} cases, {found['errors']} ended by an error. "
        "Hidden effects, dynamics, drives and sensors are made by code of their own",
        Markup("({});").format(html.code("docs/gap_battery.md")),
        "the workflow sees bags and a model only.",
    )
    marks = [_mark(r) for r in rows]
    return document(
        title,
        header + _numbers(*score_text.acceptance(found, later)),
        [
            part("By robot and size", lambda: _rates(found, later)),
            part("What was hidden (rows), what was said (columns)", lambda: _matrix(table)),
            part("Held-out error, in noise floors", lambda: _held_out(found, rows)),
            part("Cases", lambda: html.table(columns, cells, marks=marks), long=True),
        ],
    )


def _numbers(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Markup:
    """A table of numbers with names in the first column."""
    return html.table(head, rows, range(1, len(head)))


def _rates(found: Mapping[str, Any], later: Mapping[str, Any] | None) -> Markup:
    content = [
        html.paragraph(
            "Cases with one hidden effect; those of a robot or a condition are medium or large."
        ),
        _numbers(*score_text.rates(found)),
    ]
    if later:
        text = f"The same {score_text.AFTER}, where the verdict was ambiguous:"
        content += [html.paragraph(text), _numbers(*score_text.rates(later))]
    return html.join(content)


def _held_out(found: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> Markup:
    count = found["held-out error"]["cases"]
    return html.join([
        html.figure(partial(errors, rows), "Held-out error", _ERRORS),
        html.paragraph(f"{count} cases with something hidden."),
        _numbers(*score_text.held_out(found["held-out error"])),
    ])  # fmt: skip


def errors(rows: Sequence[Mapping[str, Any]]) -> Chart:
    """Held-out error of each case before and after the search.

    Args:
        rows: Rows of the score.

    Raises:
        ParameterError: No case has both errors.
    """
    scored = [r for r in rows if r["before"] and r["after"]]
    if not scored:
        raise ParameterError("no case has an error before and after")
    layers = []
    for mark, (name, color) in MARKS.items():
        group = [r for r in scored if _mark(r) == mark]
        notes = [f"{r['case']}: {', '.join(r['true']) or 'nothing'}, {r['verdict']}" for r in group]
        points = [[float(r[key]) for r in group] for key in ("before", "after")]
        layers.append(dots(name, *points, color, texts=notes))
    largest = max(float(r[key]) for r in scored for key in ("before", "after"))
    layers.append(line("nothing gained", [1.0, largest], [1.0, largest], GREY, shape=DASHED))
    layers.append(line("noise", [1.0, largest], [1.0, 1.0], GREY))
    axes = (Axis(f"error {when} [noise floors]", logarithmic=True) for when in ("before", "after"))
    return Chart([Frame(*axes, layers, height=330)])


def _matrix(table: Mapping[str, Mapping[str, int]]) -> Markup:
    """Confusion matrix; the last columns are verdicts without a name."""
    names = {name for line in table.values() for name in line}
    order = [n for n in table if n in names]
    order += sorted(names - set(order) - set(score.UNNAMED))
    order += [n for n in score.UNNAMED if n in names]
    return html.matrix(
        order, [(true, [_cell(true, name, line.get(name, 0)) for name in order])
                for true, line in table.items()]
    )  # fmt: skip


def _cell(true: str, name: str, count: int) -> tuple[str, str]:
    """Text and CSS class of a cell of the matrix."""
    if not count:
        return "", ""
    right = name.split(" and ")[0] == true or (true == "nothing" and name == "no gap")
    return str(count), "good" if right else "so" if name in score.UNNAMED else "bad"


def _case(r: Mapping[str, Any]) -> tuple[str, ...]:
    case, robot, true, size, verdict, names, before, after = score_text.case(r)
    visibility = ", ".join(score_text.number(v) for v in r["shows"])
    place = "" if r["place"] is None else "right" if r["place"] else "wrong"
    error = ", ".join(score_text.percent(s["error"]) for s in r["sizes"])
    return case, robot, true, size, visibility, verdict, names, before, after, place, error


def _mark(r: Mapping[str, Any]) -> str:
    """CSS class of a result: good, wrong or undecided."""
    if r["kind"] == "null":
        return "good" if r["verdict"] == "no gap" else "bad" if r["named"] else "so"
    if r["kind"] == "outsider":
        return "good" if r["abstained"] else "bad" if r["named"] else "so"
    if set(r["true"]) <= set(r["said"]) or r["right"]:
        return "good"
    return "bad" if r["named"] else "so"


def published(path: Path) -> str:
    """Page of a battery whose cases are in one file, a line of JSON each.

    Args:
        path: File ``seed_N.jsonl.gz``.
    """
    with gzip.open(path, "rt", encoding="utf-8") as file:
        cases = [json.loads(text) for text in file]
    rows = [score.row(case["truth"], case["result"]) for case in cases]
    title = f"Blind battery, {path.name.partition('.')[0].replace('_', ' ')}"
    return page(title, score.figures(rows), rows, score.confusion(rows))


if __name__ == "__main__":
    write_whole(Path(sys.argv[2]), published(Path(sys.argv[1])))
