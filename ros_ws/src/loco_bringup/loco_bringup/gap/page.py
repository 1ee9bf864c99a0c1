# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML page about a gap: missing effects, their places, sizes, certainty."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from markupsafe import Markup

from loco_control.exceptions import LocoError
from loco_learning.gap.localisation import figures
from loco_learning.gap.localisation.curves import Curves
from loco_sim.robot.robot import load

from ..page import html, sketch
from ..page.html import document, part
from . import plots, tables, text
from .importing import ROBOT

GOOD = (*text.NAMED, "no gap")


def page(result: Mapping[str, Any], curves: Curves) -> str:
    """HTML text of the page."""
    sections = [
        part("Before and after", lambda: _before_and_after(result, curves)),
        part("Where", lambda: _where(result, curves)),
        part("What was tried", lambda: _tested(result)),
        part("Next experiment", lambda: tables.proposals(result)),
        part("Evidence", lambda: _evidence(result)),
        part("Gap over time", lambda: _missed(result, curves), long=True),
        part("Spectra", lambda: html.figure(lambda: plots.spectra(curves), "Spectra", _SPECTRA)),
        part("Errors", lambda: tables.errors(curves)),
        part("What these recordings can tell", lambda: tables.identifiability(result)),
        part("Model", lambda: _model(result), long=True),
        part("Recordings", lambda: tables.notes(result)),
        part("Settings", lambda: tables.settings(result), long=True),
    ]
    return document(f"Gap of {_robot(result)}", header(result, curves), sections)


def setup_page(result: Mapping[str, Any]) -> str:
    """HTML text of the page for recordings whose set-up must be corrected before a search."""
    head = html.join(
        [
            html.verdict(result["verdict"], False),
            html.paragraph(html.strong(text.headline(result)), html.note(str(result["evidence"]))),
            *(html.missing(f"Alarm: {alarm}") for alarm in result["alarms"]),
        ]
    )
    sections = [
        part("Set-up", lambda: html.bullets(one["says"] for one in result["setup"])),
        part("Recordings", lambda: tables.notes(result)),
        part("Settings", lambda: tables.settings(result), long=True),
    ]
    return document(f"Set-up of {_robot(result)}", head, sections)


def header(result: Mapping[str, Any], curves: Curves) -> Markup:
    """Summary: verdict, size, place, the worst channel before and after, the gap."""
    explained = str(result.get("evidence") or _MEANING[result["verdict"]])
    figure = html.figure(lambda: plots.worst(curves, text.told(result)), "The largest gap", "")
    return html.join(
        [
            html.verdict(result["verdict"], result["verdict"] in GOOD),
            html.paragraph(html.strong(text.headline(result))),
            html.answer(_sizes(result), figure, _sketch(result)),
            html.cards(_cards(result)),
            html.paragraph(html.note(explained)),
            *(html.missing(f"Alarm: {alarm}") for alarm in result["alarms"]),
            *(html.missing(f"Reading: {note}") for note in result.get("reading") or ()),
        ]
    )


def _sketch(result: Mapping[str, Any]) -> Markup:
    """Drawing of the robot with the places of the terms marked, or the place of the largest gap.

    Empty if the robot is not available.
    """
    try:
        robot = load(result["model"]["robot"])
    except LocoError:
        return Markup()
    locations = []
    for term in result["terms"]:
        place = term.get("place") or "*"
        locations += [place] if isinstance(place, str) else list(map(str, place))
    locations += [cell["joint"] for cell in result["where"][:1] if not locations]
    links = sketch.marked(robot, [place for place in locations if place != "*"])
    where = text.listed([text.place_of(place) for place in dict.fromkeys(locations)]) or "nothing"
    return sketch.drawing(robot, links, where) + html.paragraph(f"Marked: {where}.", soft=True)


def _sizes(result: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Size of each term; if the verdict is unknown, place of the gap and the next step."""
    rows = []
    for term in result["terms"]:
        qualifier = "" if term.get("verdict", "named") == "named" else f" ({term['verdict']})"
        name = f"{text.term_name(term)}{qualifier}"
        rows += [(f"{name}, {key}", *size) for key, *size in text.sizes_of(term)] or [(name, "", "")]
    if result["verdict"] == "unknown":
        rows = [("The gap lives in", text.first(result["regions"]) or "all of the data", "")]
    if result["verdict"] in ("unknown", "ambiguous"):
        rows.append(("Next step", "", text.next_step(result)))
    return rows


def _cards(result: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    cards = []
    gap = result["gap"]
    if gap.get("before") is not None:
        numbers = [text.number(gap[k]) for k in text.told(result)]
        name = "Gap before → after" if len(numbers) > 1 else "Gap"
        cards.append((name, " → ".join(numbers), f"noise floors, on held-out data. {text.FLOOR}"))
    if text.told(result, ("closed",)) and result["verdict"] != "no gap":
        cards.append(("Share closed", text.closed_rms(gap), text.CLOSED))
    if (result.get("residual") or {}).get("used"):
        share = text.closed_rms(result["residual"])
        cards.append(("Learned correction", share, f"{text.CLOSED}; explains nothing"))
    values = [t["probability"] for t in result["terms"] if t.get("probability") is not None]
    if values and result["verdict"] in (*text.NAMED, "ambiguous"):
        cards.append(("Probability", text.probability(min(values)), "of the least certain effect"))
    return cards


def _before_and_after(result: Mapping[str, Any], curves: Curves) -> Markup:
    plot = html.figure(lambda: plots.signals(curves, text.told(result)), "Before and after", _SIGNALS)
    return tables.learned(result) + plot


def _where(result: Mapping[str, Any], curves: Curves) -> Markup:
    regions = html.bullets(result["regions"])
    channels = html.figure(lambda: figures.channels(curves), "Gap of each channel", _CHANNELS)
    return html.join([regions, channels, tables.cells(result)])


def _missed(result: Mapping[str, Any], curves: Curves) -> Markup:
    drawn = html.figure(lambda: plots.missed(curves), "Gap over time", _MISSED)
    return html.folded("Each channel, value by value", drawn)


def _tested(result: Mapping[str, Any]) -> Markup:
    parts = [tables.terms(result), tables.rivals(result)]
    return html.join([*parts, html.folded("Effects that were not tried", tables.not_tried(result))])


def _evidence(result: Mapping[str, Any]) -> Markup:
    sentences = [
        html.paragraph(f"{text.term_name(t)}: {t['evidence']}")
        for t in result["terms"]
        if t.get("evidence")
    ]
    if not sentences and not result.get("over_settings"):
        return html.paragraph("No effect was named.", soft=True)
    return html.join([*sentences, tables.over_settings(result)])


def _model(result: Mapping[str, Any]) -> Markup:
    learned = (result.get("residual") or {}).get("effects", [])
    model = {**result["model"], "effects": [*result["model"]["effects"], *learned]}
    parts = [html.paragraph(_MODEL, soft=True), html.yaml_block(model)]
    return html.join([*parts, tables.correction(result)])


def _robot(result: Mapping[str, Any]) -> str:
    name = Path(str(result["model"]["robot"]))
    folder = name.parent if name.name == "robot.yaml" else name
    if (folder / "robot.yaml").match(ROBOT) and result.get("gap"):  # a draft has no name
        return str(result["gap"]["records"][0]["name"])
    return folder.name


_MEANING = {
    "named": "It explains data that was never fitted, better than every other effect.",
    "named, and more is missing": "It closes most of the gap, but not all: see what is left.",
    "ambiguous": "Several effects explain the data about equally well; see the next experiment.",
    "unknown": "The page says where the gap lives. Nothing was made up to close it.",
    "no gap": "It explains the recordings down to their noise floor.",
}
_SIGNALS = (
    "The channels with the largest gap, where it is largest, on the same axes: measured, and as the "
    "verdict was judged, with the same refitted values and starts. Below each: what the models miss; "
    "dashed is the noise floor."
)
_CHANNELS = (
    "Each channel on held-out data. At the dashed line, one noise floor, the model is as good as the "
    "measurement."
)
_MISSED = (
    "What each model misses of every value that judges, in noise floors. The gap at the top of "
    "this page is the root mean square of all these values. Grey and tinted: the recordings that "
    "judge, one after the other."
)
_SPECTRA = "The same channels over the whole record. What a model misses should sink to the noise floor."
_MODEL = Markup(
    "As in <code>model.yaml</code>, which <code>loco run</code>, <code>loco calibrate</code> and "
    "<code>loco gap</code> take wherever they take a robot."
)
