# SPDX-License-Identifier: Apache-2.0
"""The page that judges the claims of the thesis: one table, a row a claim, and the figures."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from loco_control.files import write_whole
from loco_learning.thesis import figures, registry
from loco_learning.thesis.evidence import Entry, Evidence
from loco_learning.thesis.registry import Verdict


def write(
    verdicts: list[Verdict],
    entries: dict[str, Entry],
    found: Evidence,
    plan: str,
    what: str,
    folder: Path,
) -> Path:
    """Write ``README.md``, ``verdicts.csv`` and the figures; returns the path of the page."""
    drawn = figures.write(found, folder)
    lines = [
        f"# Claims of the thesis, {plan} plan",
        "",
        f"Made by `loco reproduce {what} --plan {plan}`. The rules stand in "
        "`loco_learning/thesis/claims.yaml`; docs/thesis.md says which came before the runs.",
        f"{registry.tally(v.verdict for v in verdicts)}.",
        "",
        "| claim | thesis | says | wanted | found | verdict | runs |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(_row(v, entries, folder) for v in verdicts),
        "",
        *_explained(verdicts),
    ]  # fmt: skip
    for path, caption in drawn:
        lines += [f"![{caption}]({path.name})", "", caption, ""]
    write_whole(folder / "verdicts.csv", _csv(verdicts, plan))
    return write_whole(folder / "README.md", "\n".join(lines))


def _row(v: Verdict, entries: dict[str, Entry], folder: Path) -> str:
    runs = [f"{_linked(name, folder)} {entries[name].engine if entries[name].study else ''}".strip()
            for name in v.evidence if name in entries]  # fmt: skip
    cells = (v.claim, v.item, v.says, v.wanted, v.found, f"**{v.verdict}**", ", ".join(runs))
    return "| " + " | ".join(cells) + " |"


def _linked(name: str, folder: Path) -> str:
    for file in ("map.html", "table.md", "README.md", "calibration.html"):
        if (folder / name / file).is_file():
            return f"[{name}]({name}/{file})"
    return name


def _explained(verdicts: list[Verdict]) -> list[str]:
    """Disagreements with what is known about them, and those that nothing explains yet."""
    against = [v for v in verdicts if v.verdict == registry.DISAGREES]
    lines = ["## Disagreements", ""] if against else []
    lines += [f"- **{v.claim}** {v.why or 'Open: not explained yet.'}" for v in against]
    return [*lines, ""]


def _csv(verdicts: list[Verdict], plan: str) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("claim", "item", "wanted", "found", "verdict", "plan", "runs"))
    writer.writerows(
        (v.claim, v.item, v.wanted, v.found, v.verdict, plan, " ".join(v.evidence))
        for v in verdicts
    )
    return text.getvalue()
