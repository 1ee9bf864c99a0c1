# SPDX-License-Identifier: Apache-2.0
"""One self-contained HTML page about a gap: what is missing, where, how big, how sure."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from loco_control.exceptions import LocoError
from loco_control.files import write_whole
from loco_learning.gap.localisation import figures
from loco_learning.gap.localisation.curves import Curves
from loco_sim.robot.robot import load

from ..page import html, sketch
from ..page.html import document, part
from . import plots, tables, text

GOOD = (*text.NAMED, "no gap")


def write_page(result: Mapping[str, Any], curves: Curves, path: Path) -> Path:
    """Write the page, whole or not at all."""
    return write_whole(path, page(result, curves))


def page(result: Mapping[str, Any], curves: Curves) -> str:
    """HTML text of the page."""
    sections = [
        part("Before and after", lambda: _before_and_after(result, curves)),
        part("Where", lambda: _where(result, curves)),
        part("Evidence", lambda: _evidence(result)),
        part("Spectra", lambda: html.figure(lambda: plots.spectra(curves), "Spectra", _SPECTRA)),
        part("Errors", lambda: tables.errors(curves)),
        part("What these recordings can tell", lambda: tables.identifiability(result)),
        part("Next experiment", lambda: tables.proposals(result)),
        part("Model", lambda: _model(result), long=True),
        part("Recordings", lambda: tables.notes(result)),
        part("Settings", lambda: tables.settings(result), long=True),
    ]
    return document(f"Gap of {_robot(result)}", header(result), sections)


def header(result: Mapping[str, Any]) -> Markup:
    """Verdict in one sentence, then what, where, how big and how much of the gap is closed."""
    explained = str(result.get("evidence") or _MEANING[result["verdict"]])
    return html.join(
        [
            html.verdict(result["verdict"], result["verdict"] in GOOD),
            html.paragraph(html.strong(text.headline(result)), html.note(explained)),
            html.beside(html.cards(_cards(result)), _sketch(result)),
            *(html.missing(f"Alarm: {alarm}") for alarm in result["alarms"]),
        ]
    )


def _sketch(result: Mapping[str, Any]) -> Markup:
    """Drawing of the robot with the places of the terms marked; nothing if it is not here."""
    try:
        robot = load(result["model"]["robot"])
    except LocoError:
        return Markup()
    places = []
    for term in result["terms"]:
        place = term.get("place") or "*"
        places += [place] if isinstance(place, str) else list(map(str, place))
    links = sketch.marked(robot, [place for place in places if place != "*"])
    where = text.listed([text.place_of(place) for place in places]) or "nothing"
    caption = f"{robot.name} as it stands, forward is right; marked: {where}."
    return sketch.drawing(robot, links, where) + html.paragraph(caption, soft=True)


def _cards(result: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    cards = []
    for term in result["terms"]:
        sure = "" if term.get("verdict", "named") == "named" else f" ({term['verdict']})"
        name, where = f"{text.words(term['effect'])}{sure}", text.place_of(term.get("place"))
        cards.append((name, where, "; ".join(text.sizes(term))))
    gap = result["gap"]
    if gap.get("before") is not None:
        numbers = [text.number(gap[k]) for k in text.told(result)]
        name = "Gap before → after" if len(numbers) > 1 else "Gap"
        unit = "times the noise, on data that was never fitted"
        cards.append((name, " → ".join(numbers), unit))
    if text.told(result, ("closed",)) and result["verdict"] != "no gap":
        share = f"of the rms; {round(100.0 * gap['closed']):d} % of the energy above the noise"
        cards.append(("Closed", text.closed_rms(gap), share))
    if result["verdict"] == "unknown" and result["regions"]:
        cards.append(("Where", "", result["regions"][0]))
    if (result.get("residual") or {}).get("used"):
        share = text.closed_rms(result["residual"])
        cards.append(("Learned correction", share, "of the rms on held-out data; explains nothing"))
    odds = [t["odds"] for t in result["terms"] if isinstance(t.get("odds"), (int, float))]
    if odds and result["verdict"] in (*text.NAMED, "ambiguous"):
        what = "against the best explanation of another name"
        cards.append(("Odds", text.odds_text(min(odds)), what))
    return cards


def _before_and_after(result: Mapping[str, Any], curves: Curves) -> Markup:
    shown = html.figure(lambda: plots.signals(curves), "Before and after", _SIGNALS)
    return tables.learned(result) + shown


def _where(result: Mapping[str, Any], curves: Curves) -> Markup:
    regions = html.bullets(result["regions"])
    channels = html.figure(lambda: figures.channels(curves), "Gap of each channel", _CHANNELS)
    return html.join([regions, channels, tables.cells(result)])


def _evidence(result: Mapping[str, Any]) -> Markup:
    sentences = [
        html.paragraph(f"{text.term_name(t)}: {t['evidence']}")
        for t in result["terms"]
        if t.get("evidence")
    ]
    return html.join(
        [*sentences, tables.terms(result), tables.rivals(result), tables.over_settings(result)]
    )


def _model(result: Mapping[str, Any]) -> Markup:
    learned = (result.get("residual") or {}).get("effects", [])
    model = {**result["model"], "effects": [*result["model"]["effects"], *learned]}
    parts = [html.paragraph(_MODEL, soft=True), html.yaml_block(model)]
    return html.join([*parts, tables.correction(result)])


def _robot(result: Mapping[str, Any]) -> str:
    name = Path(str(result["model"]["robot"]))
    return name.parent.name if name.name == "robot.yaml" else name.name


_MEANING = {
    "named": "It explains data that was never fitted, better than every other effect.",
    "named, and more is missing": "It closes most of the gap, but not all: see what is left.",
    "ambiguous": "Several effects explain the data about equally well; see the next experiment.",
    "unknown": "The page says where the gap lives. Nothing was made up to close it.",
    "no gap": "It explains the recordings down to their noise.",
}
_SIGNALS = (
    "The channels with the largest gap, where it is largest, on the same axes. Below each: what "
    "the models miss; dashed is the noise."
)
_CHANNELS = (
    "Each channel on held-out data. At the dashed line the model is as good as the measurement."
)
_SPECTRA = "The same channels over the whole record. What a model misses should sink to the noise."
_MODEL = Markup(
    "As in <code>model.yaml</code>, which <code>loco run</code>, <code>loco calibrate</code> and "
    "<code>loco gap</code> take wherever they take a robot."
)
