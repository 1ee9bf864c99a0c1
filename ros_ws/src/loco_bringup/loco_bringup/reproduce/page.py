# SPDX-License-Identifier: Apache-2.0
"""Page with the verdicts on the claims of the thesis: a table, one row per claim, and figures."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from markupsafe import Markup

from loco_control.files import write_whole
from loco_learning.drawing import png
from loco_learning.drawing.chart import Chart
from loco_learning.networks import page as msd_page
from loco_learning.networks.results import Results
from loco_learning.thesis import figures, registry
from loco_learning.thesis.evidence import Entry, Evidence
from loco_learning.thesis.registry import Verdict

from ..page import html

_RULES = (
    "The rules are in loco_learning/thesis/claims.yaml. Each row has the date of its ranges, and "
    "whether numbers of the claim had been seen before. How many runs a rule needs, and which "
    "spread it compares, was set on 2026-11-28, after results of the quick plan were known."
)
MARKS = {registry.AGREES: "good", registry.DISAGREES: "bad"}


@dataclass(frozen=True)
class Drawn:
    """A figure of a page.

    Attributes:
        file: Name of its picture.
        title: Heading.
        caption: Sentence below it.
        chart: The figure.
    """

    file: str
    title: str
    caption: str
    chart: Chart


def write(
    title: str,
    command: str,
    verdicts: list[Verdict],
    drawn: Sequence[Drawn],
    entries: Mapping[str, Entry],
    folder: Path,
) -> Path:
    """Write ``thesis.html``, the same as ``README.md``, ``verdicts.csv`` and ``numbers.json``.

    Args:
        title: Heading.
        command: Command that reproduces it.
        verdicts: Verdicts on the claims.
        drawn: Figures; their pictures are there already.
        entries: Entries of the plan.
        folder: Output folder.

    Returns:
        Path of ``thesis.html``.
    """
    lines = [
        f"# {title}", "", f"Made by `{command}`. {_RULES}", "", f"{registry.tally(verdicts)}.", "",
        "| claim | thesis | says | rule | rule of | change | found | verdict | runs |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        *(_row(v, entries, folder) for v in verdicts), "",
    ]  # fmt: skip
    for heading, items in _reasons(verdicts):
        lines += [f"## {heading}", "", *(f"- **{number}** {text}" for number, text in items), ""]
    for figure in drawn:
        lines += [f"![{figure.caption}]({figure.file})", "", figure.caption, ""]
    write_whole(folder / "verdicts.csv", _csv(verdicts, entries))
    write_whole(folder / "numbers.json", registry.as_json(verdicts))
    write_whole(folder / "README.md", "\n".join(lines))
    return write_whole(
        folder / "thesis.html", page(title, command, verdicts, drawn, entries, folder)
    )


def thesis_figures(evidence: Evidence, folder: Path) -> list[Drawn]:
    """Draw the figures of chapter 7 and the trials on rough ground."""
    drawn = figures.charts(evidence)
    for name, _, chart in drawn:
        png.write(chart, folder / f"{name}.png")
    return [
        Drawn(f"{name}.png", text.partition(":")[0], text, chart) for name, text, chart in drawn
    ]


def msd_figures(results: Results, folder: Path) -> list[Drawn]:
    """Draw the figures of chapter 6, and write its table of searches."""
    return [
        Drawn(msd_page.picture(n), f"Figure {n}", f"{msd_page.CAPTIONS[n]}.", chart)
        for n, chart in msd_page.write(results, folder).items()
    ]


def page(
    title: str,
    command: str,
    verdicts: Sequence[Verdict],
    drawn: Sequence[Drawn],
    entries: Mapping[str, Entry],
    folder: Path,
) -> str:
    """HTML text of the page of a reproduction; arguments are those of `write`."""
    counts = Counter(v.verdict for v in verdicts if not v.change)
    header = html.join([
        html.paragraph("Made by", html.code(command) + ".", _RULES, soft=True),
        html.cards([(name.capitalize(), str(counts[name]), f"of {counts.total()}")
                    for name in registry.VERDICTS if counts[name]]),
    ])  # fmt: skip
    sections = [html.part("Claims", lambda: _claims(verdicts, entries, folder), long=True)]
    for heading, items in _reasons(verdicts):
        rows = [html.strong(number) + " " + text for number, text in items]
        sections.append(html.part(heading, partial(html.bullets, rows)))
    sections += [html.part(f.title, partial(html.figure, f.chart, f.title, f.caption))
                 for f in drawn]  # fmt: skip
    return html.document(title, header, sections)


def _claims(verdicts: Sequence[Verdict], entries: Mapping[str, Entry], folder: Path) -> Markup:
    """Table of all claims, coloured by their verdicts."""
    rows = []
    for v in verdicts:
        links = [
            (html.link(name, target) if target else Markup.escape(name)) + f" {engine}"
            for name, target, engine in _runs(v, entries, folder)
        ]
        rows.append((html.strong(v.claim.number), *_item(v), v.change, v.text, v.verdict,
                     Markup(", ").join(links)))  # fmt: skip
    head = ("Claim", "Thesis", "Says", "Rule", "Rule of", "Change", "Found", "Verdict", "Runs")
    return html.table(head, rows, marks=[MARKS.get(v.verdict, "so") for v in verdicts])


def _row(v: Verdict, entries: Mapping[str, Entry], folder: Path) -> str:
    runs = [f"[{name}]({target}) {engine}".strip() if target else f"{name} {engine}".strip()
            for name, target, engine in _runs(v, entries, folder)]  # fmt: skip
    cells = (v.claim.number, *_item(v), v.change, v.text, f"**{v.verdict}**", ", ".join(runs))
    return "| " + " | ".join(cells) + " |"


def _item(v: Verdict) -> tuple[str, ...]:
    """Cells of the claim and its rule; rows of changes do not repeat them."""
    c = v.claim
    return ("",) * 4 if v.change else (c.item, c.says, c.rule_text, c.since)


def _runs(v: Verdict, entries: Mapping[str, Entry], folder: Path) -> list[tuple[str, str, str]]:
    """Name, page (empty without one) and engine of the runs of a claim."""
    return [(e.name, _target(e.name, folder), e.physics) for e in _entries(v, entries)]


def _entries(v: Verdict, entries: Mapping[str, Entry]) -> list[Entry]:
    """Entries by which a claim was judged, with its change."""
    return [e for e in entries.values()
            if e.change == v.change and (e.base or e.name) in v.claim.evidence]  # fmt: skip


def _target(name: str, folder: Path) -> str:
    """Path of a run's page relative to the folder of the reproduction; empty without a page."""
    for file in ("study.html", "thesis.html", "calibration.html"):
        if (folder / name / file).is_file():
            return f"{name}/{file}"
    return ""


def _reasons(verdicts: Sequence[Verdict]) -> list[tuple[str, list[tuple[str, str]]]]:
    """For each verdict but "agrees" its claims with their reason; then remarks on the rules."""
    titles = {registry.DISAGREES: "Disagreements", registry.OPEN: "Open",
              registry.HOLDS: "Hold by construction",
              registry.ROBOT: "Cannot be judged without the robot"}  # fmt: skip
    verdicts = [v for v in verdicts if not v.change]
    sections = [(title, [(v.claim.number, v.reason) for v in verdicts if v.verdict == verdict])
                for verdict, title in titles.items()]  # fmt: skip
    notes = [(v.claim.number, v.claim.note or v.claim.exact) for v in verdicts
             if v.claim.note or v.claim.exact]  # fmt: skip
    return [(title, items) for title, items in [*sections, ("Remarks on rules", notes)] if items]


def _csv(verdicts: Sequence[Verdict], entries: Mapping[str, Entry]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    head = ("claim", "item", "rule", "rule of", "change", "found", "verdict", "reason", "engine")
    writer.writerow(head)
    for v in verdicts:
        engines = sorted({entry.physics for entry in _entries(v, entries)})
        c = v.claim
        row = (c.number, c.item, c.rule_text, c.since, v.change, v.text, v.verdict, v.reason)
        writer.writerow((*row, " ".join(engines)))
    return text.getvalue()
