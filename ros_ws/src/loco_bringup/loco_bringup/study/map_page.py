# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page with the maps of a grid: a click on a cell shows its case."""

from __future__ import annotations

import json
import shlex
from functools import partial
from pathlib import Path

from loco_control.files import write_whole
from loco_learning.study import maps
from loco_learning.study.case import CaseResult
from loco_learning.study.maps import Sheet
from loco_learning.study.study import Case, Study

from ..page import html

HATCHED = (
    "Colour: the metric. Hatched: the trial failed. Red edge: the legal range of the metric, "
    "{legal}. Dashed: lines of equal damping ratio, y = κ √x. Click a cell for its case."
)
REGIONS = (
    "Pale: where the rule of the study places a region. Full: the points there that behave as the "
    "rule says; the share of them is in the legend. Click a cell for its case."
)


def write(study: Study, results: list[CaseResult], folder: Path) -> Path:
    """Write ``map.html``, and each map as a picture beside it; returns the page's path."""
    sections = []
    for sheet in maps.sheets(study, results):
        drawn = [(m, maps.heat_map(sheet, m, study.map), _caption(study, m))
                 for m in study.map.metrics]  # fmt: skip
        if study.map.regions:
            drawn.append(("regions", maps.region_map(sheet, study.map), REGIONS))
        for name, figure, caption in drawn:
            place = "_".join([sheet.title.replace(", ", "_").replace(" ", "_"), name])
            write_whole(folder / f"map_{place}.png", partial(figure.savefig, format="png"))
            title = f"{sheet.title}, {name.replace('_', ' ')}"
            content = html.clickable(figure, maps.BOX, _grid(sheet), title, caption)
            sections.append(html.part(title, lambda content=content: content))
    cases = {case.name: case for case in study.cases()}
    details = {result.name: _details(result, cases[result.name], study) for result in results}
    header = html.join(
        [html.paragraph(study.description), html.case_panel(details),
         html.paragraph(html.note(f"{len(results)} cases; engine {_engine(study)}."))]
    )  # fmt: skip
    return write_whole(folder / "map.html", html.document(study.name, header, sections))


def _caption(study: Study, metric: str) -> str:
    low, high = study.map.legal.get(metric, (None, None))
    return HATCHED.format(legal="none is given" if low is None else f"{low:g} to {high:g}")


def _engine(study: Study) -> str:
    named = {e.sim["engine"] for e in study.variants.values()}
    return " and ".join(sorted(named))


def _grid(sheet: Sheet) -> list[list[str]]:
    """Name of the first case in each cell, top row first."""
    return [[names[0] if names else "" for names in row] for row in reversed(sheet.cases)]


def _details(result: CaseResult, case: Case, study: Study) -> dict[str, str]:
    values = result.metrics.get(study.phase) or next(iter(result.metrics.values()), {})
    shown = {key: f"{value:.4g}" if isinstance(value, float) else str(value)
             for key, value in result.at.items()}  # fmt: skip
    shown |= {"seed": str(result.seed)}
    failed = ", ".join(result.verdict["failed"])
    shown["end"] = f"failed by {failed}: {result.verdict['fall']}" if failed else "survived"
    shown |= {name: f"{values[name]:.4g}" for name in study.metrics if name in values}
    return {**shown, "run it, with a moving picture": command(study, case)}


def command(study: Study, case: Case) -> str:
    """Command that runs a case again and writes the report with its animation."""
    name, changes = study.origins[case.variant]
    words = ["./loco", "run", name, "--layout", "rollout", "--seed", str(case.seed)]
    for key, value in {**changes, **case.settings}.items():
        if key != "experiment":
            words += ["--set", f"{key}={json.dumps(value)}"]
    return " ".join(map(shlex.quote, [*words, "--out", f"bags/{case.name}", "--report"]))
