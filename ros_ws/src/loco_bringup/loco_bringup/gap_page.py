# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page about a gap: what is missing, where, how big, how sure."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import yaml

from loco_learning.gap import figures
from loco_learning.gap.curves import Curves

from . import gap_tables as tables
from . import gap_text as text
from .report import part, picture
from .report_style import style, svg

GOOD = ("named", "no gap")


def write_page(result: Mapping[str, Any], curves: Curves, path: Path) -> Path:
    """Write the page, whole or not at all."""
    part_file = path.with_name(f"{path.name}.part")
    part_file.write_text(page(result, curves), encoding="utf-8")
    part_file.replace(path)
    return path


def page(result: Mapping[str, Any], curves: Curves) -> str:
    """HTML text of the page."""
    sections = [
        part("Before and after", lambda: _drawn("signals", curves, _SIGNALS)),
        part("Where", lambda: _where(result, curves)),
        part("Evidence", lambda: _evidence(result)),
        part("Spectra", lambda: _drawn("spectra", curves, _SPECTRA)),
        part("Errors", lambda: tables.errors(curves)),
        part("What these recordings can tell", lambda: tables.identifiability(result)),
        part("Next experiment", lambda: tables.proposals(result)),
        part("Model", lambda: _model(result), long=True),
        part("Recordings", lambda: tables.notes(result)),
        part("Settings", lambda: tables.settings(result), long=True),
    ]
    template = resources.files(__package__).joinpath("report_template.html").read_text("utf-8")
    return Template(template).substitute(
        title=escape(f"Gap of {_robot(result)}"),
        header=header(result),
        contents=" ".join(f'<a href="#{p.anchor}">{p.title}</a>' for p in sections),
        sections="\n".join(p.html for p in sections),
    )


def header(result: Mapping[str, Any]) -> str:
    """Verdict in one sentence, then what, where, how big and how much of the gap is closed."""
    bad = "" if result["verdict"] in GOOD else " bad"
    boxes = "".join(f"<div><dt>{escape(k)}</dt><dd>{v}</dd></div>" for k, v in _cards(result))
    alarms = "".join(f'<p class="missing">Alarm: {escape(a)}</p>' for a in result["alarms"])
    explained = escape(str(result.get("evidence") or _MEANING[result["verdict"]]))
    return (
        f'<p class="verdict{bad}">{escape(result["verdict"])}</p>'
        f"<p><strong>{escape(text.headline(result))}</strong> "
        f'<span class="soft">{explained}</span></p>'
        f'<dl class="cards">{boxes}</dl>{alarms}'
    )


def _cards(result: Mapping[str, Any]) -> list[tuple[str, str]]:
    cards = []
    for term in result["terms"]:
        size = "<br>".join(f"<small>{escape(s)}</small>" for s in text.sizes(term))
        where = escape(text.place_of(term.get("place")))
        sure = "" if term.get("verdict", "named") == "named" else f" ({term['verdict']})"
        cards.append((f"{text.words(term['effect'])}{sure}", f"{where}<br>{size}"))
    gap = result["gap"]
    if gap.get("before") is not None:
        numbers = [text.number(gap[k]) for k in text.told(result)]
        unit = "<br><small>times the noise, on data that was never fitted</small>"
        name = "Gap before → after" if len(numbers) > 1 else "Gap"
        cards.append((name, " → ".join(numbers) + unit))
    if text.told(result, ("closed",)) and result["verdict"] != "no gap":
        what = "<br><small>of what can be closed above the noise</small>"
        cards.append(("Closed", f"{round(100.0 * gap['closed']):d} %{what}"))
    if result["verdict"] == "unknown" and result["regions"]:
        cards.append(("Where", f"<small>{escape(result['regions'][0])}</small>"))
    odds = [t["odds"] for t in result["terms"] if isinstance(t.get("odds"), (int, float))]
    if odds and result["verdict"] in ("named", "ambiguous"):
        what = "<br><small>against the best explanation of another name</small>"
        cards.append(("Odds", escape(text.odds_text(min(odds))) + what))
    return cards


def _drawn(name: str, curves: Curves, caption: str) -> str:
    with style():
        return picture(svg(figures.FIGURES[name](curves)), name, caption)


def _where(result: Mapping[str, Any], curves: Curves) -> str:
    regions = "".join(f"<li>{escape(r)}</li>" for r in result["regions"])
    head = f"<ul>{regions}</ul>" if regions else ""
    return head + _drawn("channels", curves, _CHANNELS) + tables.cells(result)


def _evidence(result: Mapping[str, Any]) -> str:
    sentences = [
        f"<p>{escape(text.term_name(t))}: {escape(str(t['evidence']))}</p>"
        for t in result["terms"]
        if t.get("evidence")
    ]
    return "".join(sentences) + tables.terms(result) + tables.rivals(result)


def _model(result: Mapping[str, Any]) -> str:
    body = yaml.safe_dump(dict(result["model"]), sort_keys=False)
    return f"{_MODEL}<pre>{escape(body)}</pre>{tables.correction(result)}"


def _robot(result: Mapping[str, Any]) -> str:
    name = Path(str(result["model"]["robot"]))
    return name.parent.name if name.name == "robot.yaml" else name.name


_MEANING = {
    "named": "It explains data that was never fitted, better than every other effect.",
    "ambiguous": "Several effects explain the data about equally well; see the next experiment.",
    "unknown": "The page says where the gap lives. Nothing was made up to close it.",
    "no gap": "It explains the recordings down to their noise.",
}
_SIGNALS = (
    "The channels with the largest gap, where it is largest, on the same axes. Below each: what "
    "the models miss; the grey band is the noise."
)
_CHANNELS = (
    "Each channel on held-out data. At the dashed line the model is as good as the measurement."
)
_SPECTRA = "The same channels over the whole record. What a model misses should sink to the noise."
_MODEL = (
    '<p class="soft">As in <code>model.yaml</code>, which <code>loco run</code>, '
    "<code>loco calibrate</code> and <code>loco gap</code> take wherever they take a robot.</p>"
)
