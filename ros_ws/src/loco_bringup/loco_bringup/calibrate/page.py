# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page about a calibration: Table 5.1, figures 5.2b and 5.4."""

from __future__ import annotations

from markupsafe import Markup

from loco_learning.calibration import figures, results
from loco_learning.calibration.mawe import UNITS
from loco_learning.calibration.results import Result
from loco_sim.plant.model import Model

from ..page import html
from ..page.html import document, part

SURROGATE = (
    "SURROGATE: these recordings come from a simulated stand-in with effects that the model lacks, "
    "not from a machine. Measurements of Tigrillo are not public."
)


def page(result: Result, model: Model) -> str:
    """HTML text of the page."""
    sections = [
        part("Body before and after", lambda: _tabled(results.body_table(result), 2, _BODY)),
        part("Average periods", lambda: _periods(result)),
        part("Recordings", lambda: _tabled(results.recording_table(result), 3, _RECORDINGS)),
        part("Convergence", lambda: _convergence(result)),
        part("Searches", lambda: _tabled(results.seed_table(result), 1, _SEARCHES)),
        part("Where the seeds end", lambda: _bodies(result)),
        part("Calibrated model", lambda: _model(model), long=True),
        part("Settings", lambda: _settings(result), long=True),
    ]
    return document(f"Calibration of {result.robot}", _header(result), sections)


def _header(result: Result) -> Markup:
    best, unit = result.best, UNITS[result.loss]
    cards = [
        ("Error of the default body", f"{best.before:.3g}", unit),
        ("Error when calibrated", f"{best.error:.3g}", unit),
        ("Ratio on what was fitted", f"{best.ratio:.1f}", ""),
    ]
    for row in result.comparisons[1:]:
        name = row.name.removeprefix("surrogate_").replace("_", " ")
        cards.append((f"Ratio on {name}, not fitted", f"{row.ratio(result.loss):.1f}", ""))
    text = (
        f"Body parameters of {result.robot} fitted by CMA-ES to the recording "
        f"{result.comparisons[0].name}; {len(result.fits)} searches."
    )
    label = [html.missing(SURROGATE)] if result.surrogate else []
    return html.join([html.paragraph(text, soft=True), *label, html.cards(cards)])


def _tabled(content: tuple[list[str], list[list[str]]], numeric: int, text: str) -> Markup:
    """A table with a heading text; columns from index `numeric` on are aligned as numbers."""
    head, rows = content
    columns = range(numeric, len(head))
    return html.paragraph(text, soft=True) + html.table(head, rows, columns)


def _periods(result: Result) -> Markup:
    blocks = [html.paragraph(_PERIODS, soft=True)]
    for row in result.comparisons:
        text = f"{row.name}, {'fitted' if row.fitted else 'not fitted'}: {row.count} periods"
        chart = figures.periods(row, result)
        blocks.append(html.figure(chart, f"Average period of {row.name}", text))
        spectra = figures.spectra(row, result)
        blocks.append(html.figure(spectra, f"Spectra of {row.name}", _SPECTRA))
    return html.join(blocks)


def _convergence(result: Result) -> Markup:
    return html.figure(figures.convergence(result), "Convergence", _CONVERGENCE)


def _bodies(result: Result) -> Markup:
    return html.figure(lambda: figures.bodies(result), "Where the seeds end", _BODIES)


def _model(model: Model) -> Markup:
    body = {"robot": model.robot, "overrides": model.overrides, "effects": model.effects}
    return html.paragraph("Content of", html.code("model.yaml") + ":") + html.yaml_block(body)


def _settings(result: Result) -> Markup:
    rows = [[k, str(v)] for k, v in result.options.items() if k != "seed"]
    return html.table(["Setting", "Value"], rows)


_BODY = (
    "As Table 5.1. “Default” is the column “No Optim” of the thesis, “Thesis” its column “Optim”, "
    "which belongs to the author's robot: equality is not expected."
)
_PERIODS = (
    "Knee angles over one period of the actuation, as figure 5.4. Dashed: one standard deviation "
    "between periods. The first recording was fitted, the others were not seen by the search. "
    "Curves are as recorded, without the shift that the windowed error allows."
)
_SPECTRA = (
    "Amplitudes of the harmonics of these periods. The actuation is the same for all three, so "
    "these curves compare the transfer functions (eq. 5.2). The calibrated model should have that "
    "of the robot (eq. 5.5)."
)
_RECORDINGS = (
    "Windowed error in both variants: that of thesis eq. (5.4), summed over the knees, and the "
    "normalised one of the author's code."
)
_CONVERGENCE = (
    "Smallest error so far, as figure 5.2b. Dots: 95 % of the way from default to best. Every "
    "search starts at the default body; one that no longer gains restarts elsewhere."
)
_SEARCHES = "A plateau is reached when the error has made 95 % of its way from default to best."
_BODIES = (
    "Each parameter between its bounds; friction and contact depth on a logarithmic scale. A "
    "parameter that the seeds put in different places at equal error is not seen by this recording."
)
