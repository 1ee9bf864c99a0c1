# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML page about a study: maps, figures, trials, details of every case."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from loco_control.files import write_whole
from loco_learning.drawing import png
from loco_learning.drawing.chart import Chart
from loco_learning.metrics.registry import METRICS
from loco_learning.study import figures, maps
from loco_learning.study.case import CaseResult
from loco_learning.study.study import Case, Study

from ..page import html

Drawn = tuple[str, str, Chart]

MAP = (
    "Colour: the metric. Dots: the trial failed.{legal} Dashed: lines of equal damping ratio, "
    "y = κ √x. Click a cell for its case."
)
REGIONS = (
    "Pale: where the rule of the study places a region. Full: the points there that behave as the "
    "rule says; the share of them is in the legend. Click a cell for its case."
)
SEEDS = "A dot for each trial, in the phase {phase!r}. Click one for its case."
MOST_ROWS = 400  # largest number of cases in the table; all are in cases.csv


def write(study: Study, results: list[CaseResult], folder: Path) -> Path:
    """Write ``study.html`` and each map as an image beside it; returns the path of the page.

    Args:
        study: The study.
        results: Results of the study's cases, at least one.
        folder: Folder of the results.
    """
    drawn = _maps(study, results) if study.map else []
    for title, _, chart in drawn:
        png.write(chart, folder / f"map_{title.replace(', ', '_').replace(' ', '_')}.png")
    return write_whole(folder / "study.html", page(study, results, drawn))


def page(study: Study, results: list[CaseResult], drawn: Sequence[Drawn] = ()) -> str:
    """HTML text of the page of a study.

    Args:
        study: The study.
        results: Results of the study's cases, at least one.
        drawn: Title, caption and chart of each map.
    """
    sections = [html.part(title, partial(html.figure, chart, title, text))
                for title, text, chart in drawn]  # fmt: skip
    for name in study.figures:
        draw = figures.FIGURES[name]
        title = name.replace("_", " ").capitalize().replace("Nrmse", "NRMSE")
        text = draw.__doc__ or ""
        chart = partial(draw, study, results)
        sections.append(html.part(title, partial(html.figure, chart, title, text)))
    if not study.axes:
        title, text = "Trials", SEEDS.format(phase=study.phase)
        chart = partial(figures.seeds, study, results)
        sections.append(html.part(title, partial(html.figure, chart, title, text)))
    sections.append(html.part("Failures by criterion", lambda: _table(figures.summary(results))))
    sections.append(html.part("Cases", lambda: _cases(study, results), long=True))
    cases = {case.name: case for case in study.cases()}
    details = {result.name: _details(result, cases[result.name], study) for result in results}
    counts = [(str(row["variant"]), f"{row['survived']} of {row['trials']}", "survived")
              for row in figures.summary(results)]  # fmt: skip
    engines = " and ".join(sorted({e.sim["engine"] for e in study.variants.values()}))
    header = html.join(
        [html.paragraph(study.description), html.cards(counts), html.case_panel(details),
         html.paragraph(html.note(f"{len(results)} cases; engine {engines}."))]
    )  # fmt: skip
    return html.document(study.name, header, sections)


def _maps(study: Study, results: list[CaseResult]) -> list[Drawn]:
    """Title, caption and chart of each map (metrics and regions), for every plane of the grid."""
    blocks = []
    for sheet in maps.sheets(study, results):
        for metric in study.map.metrics:
            title = f"{sheet.title}, {metric.replace('_', ' ')}"
            span = study.map.legal.get(metric)
            legal = (
                " The edge runs around the legal range, {:g} to {:g}.".format(*span) if span else ""
            )
            chart = maps.heat_map(sheet, metric, study.map)
            blocks.append((title, MAP.format(legal=legal), chart))
        if study.map.regions:
            chart = maps.region_map(sheet, study.map)
            blocks.append((f"{sheet.title}, regions", REGIONS, chart))
    return blocks


def _cases(study: Study, results: list[CaseResult]) -> Markup:
    rows = figures.rows(study, results)
    empty = [key for key in rows[0] if all(row[key] != row[key] for row in rows)]  # all NaN
    rows = [{key: row[key] for key in row if key not in empty} for row in rows]
    prefix = f"The first {MOST_ROWS} of {len(rows)}; " if len(rows) > MOST_ROWS else ""
    text = f"{prefix}cases.csv has all digits; metrics of the phase {study.phase!r}."
    units = {"end": "s", **{axis.name: axis.unit for axis in study.axes}}
    units |= {name: METRICS[name].unit for name in study.metrics}
    return html.paragraph(text, soft=True) + _table(rows[:MOST_ROWS], units)


def _table(rows: list[dict[str, Any]], units: Mapping[str, str] = {}) -> Markup:
    heads = (f"{name.replace('_', ' ')} [{units.get(name) or '-'}]" for name in rows[0])
    head = [text.removesuffix(" [-]") for text in heads]
    numeric = [i for i, value in enumerate(rows[0].values()) if isinstance(value, (int, float))]
    return html.table(head, [[_text(v) for v in row.values()] for row in rows], numeric)


def _text(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    return html.number(float(value)) if isinstance(value, (int, float)) else str(value)


def _details(result: CaseResult, case: Case, study: Study) -> dict[str, str]:
    values = result.metrics.get(study.phase) or next(iter(result.metrics.values()), {})
    details = {key: f"{value:.4g}" if isinstance(value, float) else str(value)
             for key, value in result.at.items()}  # fmt: skip
    details |= {"seed": str(result.seed)}
    failed = ", ".join(result.verdict["failed"])
    details["end"] = f"failed by {failed}: {result.verdict['fall']}" if failed else "survived"
    details |= {name: f"{values[name]:.4g}" for name in study.metrics if name in values}
    return {**details, "run it, with a moving picture": command(study, case)}


def command(study: Study, case: Case) -> str:
    """Command line that repeats a case and writes its report with animation."""
    name, changes = study.origins[case.variant]
    parts = ["./loco", "run", name, "--layout", "rollout", "--seed", str(case.seed)]
    for key, value in {**changes, **case.settings}.items():
        if key != "experiment":
            parts += ["--set", f"{key}={json.dumps(value)}"]
    return " ".join(map(shlex.quote, [*parts, "--out", f"bags/{case.name}", "--report"]))
