# SPDX-License-Identifier: Apache-2.0
"""Page with the verdicts on the claims of the thesis: a table, one row per claim, and figures."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path

from markupsafe import Markup

from loco_control.files import write_whole
from loco_learning.drawing import png
from loco_learning.drawing.chart import Chart
from loco_learning.networks import claims as msd_claims
from loco_learning.networks import page as msd_page
from loco_learning.thesis import figures, registry
from loco_learning.thesis.evidence import Entry, Evidence
from loco_learning.thesis.registry import Verdict

from ..page import html

VERDICTS = (registry.AGREES, registry.DISAGREES, registry.OPEN)
_RULES = (
    "The rules stand in loco_learning/thesis/claims.yaml; docs/thesis.md says which came before "
    "the runs."
)


def write(
    verdicts: list[Verdict],
    entries: dict[str, Entry],
    found: Evidence,
    plan: str,
    what: str,
    folder: Path,
) -> Path:
    """Write ``thesis.html``, the same content as ``README.md``, ``verdicts.csv``, and the figures.

    Returns:
        Path of ``thesis.html``.
    """
    drawn = figures.charts(found)
    for name, _, chart in drawn:
        png.write(chart, folder / f"{name}.png")
    title = f"Claims of the thesis, {plan} plan"
    lines = [
        f"# {title}",
        "",
        f"Made by `loco reproduce {what} --plan {plan}`. {_RULES}",
        f"{registry.tally(v.verdict for v in verdicts)}.",
        "",
        "| claim | thesis | says | wanted | found | verdict | runs |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(_row(v, entries, folder) for v in verdicts),
        "",
        *_explained(verdicts),
    ]  # fmt: skip
    for name, caption, _ in drawn:
        lines += [f"![{caption}]({name}.png)", "", caption, ""]
    write_whole(folder / "verdicts.csv", _csv(verdicts, plan))
    write_whole(folder / "README.md", "\n".join(lines))
    command = f"loco reproduce {what} --plan {plan}"
    runs = {name: _target(name, folder) for name in entries}
    text = page(title, command, verdicts, [(c.partition(":")[0], c, d) for _, c, d in drawn], runs)
    return write_whole(folder / "thesis.html", text)


def write_msd(plan: str, preset: str, folder: Path) -> tuple[Path, list[msd_claims.Verdict]]:
    """Write ``thesis.html`` on chapter 6, the same content as ``README.md``, and the figures.

    Args:
        plan: Name of the plan.
        preset: Name of the preset.
        folder: Folder of the results, whose ``runs`` are read.

    Returns:
        Path of ``thesis.html``, and the verdicts.
    """
    title, verdicts, charts = msd_page.write(plan, preset, folder / "runs", folder)
    command = f"loco reproduce msd --plan {plan} --preset {preset}"
    drawn = [(f"Figure {n}", f"{msd_page.CAPTIONS[n]}.", chart) for n, chart in charts.items()]
    return write_whole(folder / "thesis.html", page(title, command, verdicts, drawn)), verdicts


def page(
    title: str,
    command: str,
    verdicts: Sequence[Verdict | msd_claims.Verdict],
    drawn: Sequence[tuple[str, str, Chart]],
    runs: Mapping[str, str] | None = None,
) -> str:
    """HTML text of the page of a reproduction.

    Args:
        title: Heading.
        command: Command that reproduces it.
        verdicts: Verdicts on the claims, including those of chapter 6.
        drawn: Title, caption and chart of each figure.
        runs: Path of the page or table of each run, by its name; "" if there is none.
    """
    counts = Counter(v.verdict for v in verdicts)
    header = html.join([
        html.paragraph("Made by", html.code(command) + ".", _RULES, soft=True),
        html.cards([(name.capitalize(), str(counts[name]), f"of {len(verdicts)}")
                    for name in VERDICTS if counts[name]]),
    ])  # fmt: skip
    sections = [html.part("Claims", lambda: _claims(verdicts, runs or {}), long=True)]
    against = [v for v in verdicts if v.verdict == registry.DISAGREES]
    if against:
        items = [html.strong(v.claim) + " " + _why(v) for v in against]
        sections.append(html.part("Disagreements", lambda: html.bullets(items)))
    sections += [html.part(name, partial(html.figure, chart, name, caption))
                 for name, caption, chart in drawn]  # fmt: skip
    return html.document(title, header, sections)


def _claims(verdicts: Sequence[Verdict | msd_claims.Verdict], runs: Mapping[str, str]) -> Markup:
    """Table of all claims, coloured by their verdicts."""
    marks = {registry.AGREES: "good", registry.DISAGREES: "bad"}
    rows = []
    for v in verdicts:
        links = [html.link(name, runs[name]) if runs.get(name) else Markup.escape(name)
                 for name in getattr(v, "evidence", ()) if name in runs]  # fmt: skip
        statement = getattr(v, "says", "")  # chapter 6 has it in the field of the expected value
        rows.append((html.strong(v.claim), v.item, statement, v.wanted, v.found, v.verdict,
                     Markup(", ").join(links)))  # fmt: skip
    head = ("Claim", "Thesis", "Says", "Wanted", "Found", "Verdict", "Runs")
    return html.table(head, rows, marks=[marks.get(v.verdict, "so") for v in verdicts])


def _row(v: Verdict, entries: dict[str, Entry], folder: Path) -> str:
    runs = [f"{_linked(name, folder)} {entries[name].engine if entries[name].study else ''}".strip()
            for name in v.evidence if name in entries]  # fmt: skip
    cells = (v.claim, v.item, v.says, v.wanted, v.found, f"**{v.verdict}**", ", ".join(runs))
    return "| " + " | ".join(cells) + " |"


def _linked(name: str, folder: Path) -> str:
    target = _target(name, folder)
    return f"[{name}]({target})" if target else name


def _target(name: str, folder: Path) -> str:
    """Path of a run's page relative to the folder of the reproduction; empty without a page."""
    for file in ("study.html", "thesis.html", "calibration.html"):
        if (folder / name / file).is_file():
            return f"{name}/{file}"
    return ""


def _explained(verdicts: list[Verdict]) -> list[str]:
    """Disagreements with their known explanation, and disagreements without explanation."""
    against = [v for v in verdicts if v.verdict == registry.DISAGREES]
    lines = ["## Disagreements", ""] if against else []
    lines += [f"- **{v.claim}** {_why(v)}" for v in against]
    return [*lines, ""]


def _why(verdict: Verdict | msd_claims.Verdict) -> str:
    return getattr(verdict, "why", "") or "Open: not explained yet."


def _csv(verdicts: list[Verdict], plan: str) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("claim", "item", "wanted", "found", "verdict", "plan", "runs"))
    writer.writerows(
        (v.claim, v.item, v.wanted, v.found, v.verdict, plan, " ".join(v.evidence))
        for v in verdicts
    )
    return text.getvalue()
