# SPDX-License-Identifier: Apache-2.0
"""The page of `loco reliability`, made from the kept figures and the declaration."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import yaml

from loco_bringup.cli.clone import root

from .figures import Figure, read
from .subjects import SUBJECTS, complete

FILE = "results/reliability.json"  # in docs/, as the page
PAGE = "reliability_figures.md"
DECLARATION: dict[str, list[dict[str, str]]] = yaml.safe_load(
    Path(__file__).with_name("declaration.yaml").read_text(encoding="utf-8")
)
_MEANS = {"yes": "yes", "no": "**no**", "partly": "in part"}


def current() -> str:
    """Text of the page for the figures in `FILE`."""
    return page(complete(read(root() / "docs" / FILE)))


def page(figures: list[Figure]) -> str:
    """Text of the page."""
    runs = list(dict.fromkeys(_run(f) for f in figures if f.date))
    by_subject: dict[str, list[Figure]] = {}
    for each in figures:
        by_subject.setdefault(each.subject, []).append(each)
    parts = [
        "# Reliability: figures",
        "<!-- printed by `loco reliability` from results/reliability.json -->",
        "What was measured, when, on which code (`+`: with changes; PART: of "
        "the row). How it is done, and what it "
        "found, stands in [reliability](reliability.md). `./loco reliability` takes what each "
        "command last wrote, `./loco reliability --run` measures what is missing.",
        _table(("subject", "parts measured", "as required"), map(_summary, by_subject.values())),
        *(f"## {name.capitalize()}\n\n{_subject(rows, runs)}" for name, rows in by_subject.items()),
        "## Runs\n\n" + "\n".join(
            f"{number}. `{command}`: {machine}"
            for number, (command, machine) in enumerate(runs, start=1)
        ),
        "## Declaration\n\nIn the manner of the quality levels of "
        "[REP-2004](https://www.ros.org/reps/rep-2004.html); level 1 is the highest. What is not "
        "met is said. No level is claimed.",
        _declared(),
    ]  # fmt: skip
    return "\n\n".join(parts) + "\n"


def _summary(rows: list[Figure]) -> tuple[str, ...]:
    measured = [each for each in rows if each.date]
    name = rows[0].subject
    return (
        f"[{name}](#{name.replace(' ', '-')})",
        f"{len(measured)} of {len(rows)}",
        f"{sum(each.holds for each in measured)} of {len(measured)}",
    )


def _subject(rows: list[Figure], runs: list[tuple[str, str]]) -> str:
    subject = SUBJECTS[rows[0].subject]
    fullest = sorted(rows, key=lambda each: -len(each.values))  # its order is that of the columns
    names = list(dict.fromkeys(name for each in fullest for name in each.values))
    lines = []
    for each in (each for each in rows if each.date):
        values = [_text(each.values.get(name, "")) for name in names]
        said = "yes" if each.holds else "**no**"
        run = str(runs.index(_run(each)) + 1)
        lines.append((_name(each), *values, said, each.date[:10], each.commit, run))
    table = _table(("part", *names, "as required", "date", "commit", "run"), lines)
    missing = ", ".join(_name(each) for each in rows if not each.date)
    head = f"`./loco {subject.command}`. Required: {subject.required}."
    return f"{head}{f' Not measured: {missing}.' if missing else ''}\n\n{table}"


def _run(each: Figure) -> tuple[str, str]:
    """Command, with PART for the name of the figure's part, and machine."""
    part = rf"(?<= ){re.escape(shlex.quote(each.part))}(?= |$)"
    return re.sub(part, "PART", each.command), each.machine


def _name(each: Figure) -> str:
    """Name of a part; of a module its file and folder alone."""
    is_module = each.part.endswith(".py")
    return f"`{'/'.join(each.part.split('/')[-2:]) if is_module else each.part}`"


def _declared() -> str:
    rows = (
        (name, line["says"], _MEANS[line["met"]], "; ".join(_held(line)))
        for name, lines in DECLARATION.items()
        for line in lines
    )
    return _table(("subject", "requirement", "met", "held by"), rows)


def _held(line: dict[str, str]) -> list[str]:
    by = line.get("by", "")
    path = by.partition("::")[0]
    name = by.rpartition("::")[2].rpartition("/")[2]
    return [*([f"[`{name}`](../{path})"] if by else []), *filter(None, [line.get("why", "")])]


def _text(value: Any) -> str:
    return f"{value:,}" if isinstance(value, int) else str(value)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(head)
    lines = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])
