# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page about a calibration: Table 5.1, figures 5.2b and 5.4."""

from __future__ import annotations

from html import escape
from importlib import resources
from pathlib import Path
from string import Template

import yaml

from loco_learning.calibration import figures, tables
from loco_learning.calibration.mawe import UNITS
from loco_learning.calibration.results import Result
from loco_sim.model import Model

from .report import part, picture
from .report_style import style, svg
from .report_tables import table

SURROGATE = (
    "SURROGATE: these recordings come from a simulated stand-in with effects that the model lacks, "
    "not from a machine. Measurements of Tigrillo are not public."
)


def write_page(result: Result, model: Model, path: Path) -> Path:
    """Write the page, whole or not at all."""
    part_file = path.with_name(f"{path.name}.part")
    with style():
        part_file.write_text(page(result, model), encoding="utf-8")
    part_file.replace(path)
    return path


def page(result: Result, model: Model) -> str:
    """HTML text of the page."""
    sections = [
        part("Body before and after", lambda: _tabled(tables.body_table(result), 2, _BODY)),
        part("Average periods", lambda: _figure(result, "periods", _PERIODS)),
        part("Recordings", lambda: _tabled(tables.recording_table(result), 3, _RECORDINGS)),
        part("Convergence", lambda: _figure(result, "convergence", _CONVERGENCE)),
        part("Searches", lambda: _tabled(tables.seed_table(result), 1, _SEARCHES)),
        part("Where the seeds end", lambda: _figure(result, "bodies", _BODIES)),
        part("Calibrated model", lambda: _model(model), long=True),
        part("Settings", lambda: _settings(result), long=True),
    ]
    template = resources.files(__package__).joinpath("report_template.html").read_text("utf-8")
    return Template(template).substitute(
        title=escape(f"Calibration of {result.robot}"),
        header=_header(result),
        contents=" ".join(f'<a href="#{p.anchor}">{p.title}</a>' for p in sections),
        sections="\n".join(p.html for p in sections),
    )


def _header(result: Result) -> str:
    best, unit = result.best, UNITS[result.loss]
    label = f'<p class="verdict bad">{SURROGATE}</p>' if result.surrogate else ""
    cards = {
        f"Error of the default body [{unit}]": f"{best.before:.3g}",
        f"Error when calibrated [{unit}]": f"{best.error:.3g}",
        "Ratio on what was fitted": f"{best.ratio:.1f}",
    }
    for row in result.comparisons[1:]:
        name = row.name.removeprefix("surrogate_").replace("_", " ")
        cards[f"Ratio on {name}, not fitted"] = f"{row.ratio(result.loss):.1f}"
    cards["Wall time"] = f"{result.seconds / 60.0:.1f} min"
    boxes = "".join(f"<div><dt>{escape(k)}</dt><dd>{v}</dd></div>" for k, v in cards.items())
    fitted = escape(result.comparisons[0].name)
    return (
        f'<p class="soft">Body parameters of {escape(result.robot)} fitted by CMA-ES to the '
        f"recording {fitted}; {len(result.fits)} searches.</p>{label}"
        f'<dl class="cards">{boxes}</dl>'
    )


def _tabled(content: tuple[list[str], list[list[str]]], numeric: int, text: str) -> str:
    """A table under a text; columns from `numeric` on are aligned as numbers."""
    head, rows = content
    cells = [[escape(cell) for cell in row] for row in rows]
    columns = range(numeric, len(head))
    return f'<p class="soft">{escape(text)}</p>{table(head, cells, columns)}'


def _figure(result: Result, name: str, text: str) -> str:
    return picture(svg(figures.FIGURES[name](result)), name, text)


def _model(model: Model) -> str:
    body = {"robot": model.robot, "overrides": model.overrides, "effects": model.effects}
    text = yaml.safe_dump(body, sort_keys=False)
    return f"<p>As in <code>model.yaml</code>:</p><pre>{escape(text)}</pre>"


def _settings(result: Result) -> str:
    rows = [[escape(k), escape(str(v))] for k, v in result.options.items() if k != "seed"]
    rows.append(["workers", str(result.workers)])
    return table(["Setting", "Value"], rows)


_BODY = (
    "As Table 5.1. “Default” is the column “No Optim” of the thesis, “Thesis” its column “Optim”, "
    "which belongs to the author's robot: equality is not expected."
)
_PERIODS = (
    "Knee angles over one period of the actuation, as figure 5.4. Bands: one standard deviation "
    "between periods. The first row was fitted, the others were not seen by the search. Curves are "
    "drawn as recorded, without the shift that the windowed error allows."
)
_RECORDINGS = (
    "Windowed error in both variants: that of thesis eq. (5.4), summed over the knees, and the "
    "normalised one of the author's code."
)
_CONVERGENCE = (
    "Smallest error so far, as figure 5.2b. Every search starts at the default body; one that no "
    "longer gains starts anew elsewhere."
)
_SEARCHES = "A plateau is reached when the error has made 95 % of its way from default to best."
_BODIES = (
    "Each parameter between its bounds; friction and contact depth on a logarithmic scale. A "
    "parameter that the seeds put in different places at equal error is not seen by this recording."
)
