# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML page about a fleet: which robots have which effect, since when, how sure."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

from markupsafe import Markup

from loco_learning.drawing.chart import PALETTE, Axis, Chart, Frame, Layer, dots, line
from loco_learning.gap.fleet.course import APPEARS, CHANGES, DISAPPEARS
from loco_learning.gap.fleet.fleet import FAILED
from loco_learning.gap.fleet.table import in_order
from loco_learning.gap.setup.contents import SETUP

from ...page import html
from .. import text

Result = Mapping[str, Any]
SINCE = {APPEARS: "since", DISAPPEARS: "until before", CHANGES: "changed on"}
ROWS = 200  # recordings listed on the page; the table beside it has all
COURSES = (
    "Dots with bars: size of all recordings of a day with its 95 % interval. A robot without the "
    "effect stays at 0."
)


def lines(result: Result) -> list[str]:
    """The answer in a few sentences: a line for the fleet, one for each robot with an effect."""
    out = [summary(result)]
    for row in result["robots"]:
        out += [
            f"  {row['robot']}: {text.term_name(one)}, {when(one)}"
            for one in row["effects"]
            if one["has"]
        ]
    out += [
        f"  {one['robot']}: {one['verdict']} on {one['day']}: {one['evidence']}"
        for one in searches(result)
        if one["verdict"] in (SETUP, FAILED)
    ]
    return out


def summary(result: Result) -> str:
    """One sentence on the whole fleet."""
    with_it = [row for row in result["robots"] if any(one["has"] for one in row["effects"])]
    robots = counted(len(result["robots"]), "robot")
    count = f"{counted(result['recordings'], 'recording')} of {robots}"
    if not with_it:
        return f"{count}: no effect is named."
    left = len(result["unexplained"])
    return f"{count}: {len(with_it)} with an effect; {counted(left, 'recording')} unexplained."


def counted(number: int, what: str) -> str:
    """A number of things."""
    return f"{number} {what}{'s' * (number != 1)}"


def when(one: Result) -> str:
    """Size of an effect in a robot, its day and how sure both are."""
    size, low, high = (text.number(one[key]) for key in ("size", "low", "high"))
    size = f"{size}{unit_of(one)} ({low} to {high})"
    certainty = f"probability {text.probability(one['probability'])}"
    if one["day"] is None:
        return f"{size} on all days; {certainty}"
    day = f"{one['day']} (probability {text.probability(one['day_probability'])})"
    return f"{size} {SINCE[one['course']]} {day}; {certainty}"


def unit_of(one: Result) -> str:
    """Unit after a number; empty without one."""
    return "" if one["unit"] == "-" else f" {one['unit']}"


def page(result: Result) -> str:
    """HTML text of the page."""
    cards = [
        (text.term_name(one), f"{len(one['robots'])} of {len(result['robots'])} robots",
         _deviation_text(one)) for one in result["effects"]
    ]  # fmt: skip
    head = html.join([html.paragraph(html.strong(summary(result))), html.cards(cards)])
    sections = [html.part("Robots", lambda: _robots(result))]
    for k, one in enumerate(result["effects"]):
        title = text.term_name(one).capitalize()
        sections.append(
            html.part(title, partial(html.figure, partial(_sizes, result, k), title, COURSES))
        )
    sections += [
        html.part("Searches", lambda: _searches(result), long=True),
        html.part("Unexplained recordings", lambda: _unexplained(result), long=True),
        html.part("Recordings left out", lambda: _skipped(result), long=True),
        html.part("Settings", lambda: html.yaml_block(result["settings"]), long=True),
    ]
    return html.document(f"Fleet of {result['robot']}", head, sections)


def _deviation_text(one: Result) -> str:
    """Size of an effect over the robots that have it, with its spreads."""
    if one["size"] is None:
        return "in no robot surely"
    size = f"{text.words(one['parameter'])} {text.number(one['size'])}{unit_of(one)}"
    spreads = f"{text.number(one['spread_robots'])} between robots"
    spreads += f", {text.number(one['spread_days'])} between days and recordings"
    return f"{size}; spread {spreads}"


def _robots(result: Result) -> Markup:
    head = [
        "robot",
        "recordings",
        *(text.term_name(one) for one in result["effects"]),
        "unexplained",
    ]
    rows = [
        [row["robot"], str(row["recordings"]),
         *(when(one) if one["has"] else "–" for one in row["effects"]), str(row["unexplained"])]
        for row in result["robots"]
    ]  # fmt: skip
    return html.table(head, rows, [1, len(head) - 1])


def _sizes(result: Result, k: int) -> Chart:
    """Size of an effect over the days, in a colour for each robot."""
    every = {day["day"] for row in result["robots"] for day in row["days"]}
    names = sorted(every, key=in_order)
    layers: list[Layer] = []
    for i, row in enumerate(result["robots"]):
        one, colour = row["effects"][k], PALETTE[i % len(PALETTE)]
        at = [names.index(day["day"]) + 0.6 * (i + 0.5) / len(result["robots"]) - 0.3
              for day in one["days"]]  # fmt: skip
        x = [value for place in at for value in (place, place, float("nan"))]
        y = [value for day in one["days"] for value in (day["low"], day["high"], float("nan"))]
        tips = [f"{row['robot']}, {day['day']}: {text.number(day['size'])}" for day in one["days"]]
        layers.append(line(row["robot"], x, y, colour))
        layers.append(
            dots(row["robot"], at, [day["size"] for day in one["days"]], colour, texts=tips)
        )
    unit = result["effects"][k]["unit"]
    label = f"{text.words(result['effects'][k]['parameter'])} [{unit}]"
    return Chart([Frame(Axis("day", names=names), Axis(label), layers, height=330)])


def searches(result: Result) -> list[dict[str, Any]]:
    """All searches, each with its robot."""
    return [{"robot": row["robot"], **one} for row in result["robots"] for one in row["searches"]]


def _searches(result: Result) -> Markup:
    head = ("robot", "day", "verdict", "evidence")
    return html.table(head, [[one[key] for key in head] for one in searches(result)])


def _unexplained(result: Result) -> Markup:
    rows = [
        [row["file"], text.number(row["before"]), text.number(row["after"])]
        for row in result["unexplained"][:ROWS]
    ]
    if not rows:
        return html.paragraph("None: the sizes of the other recordings explain each one.")
    head = ["recording", "before [noise floors]", "after [noise floors]"]
    return html.table(head, rows, [1, 2])


def _skipped(result: Result) -> Markup:
    lines = [f"{row['file']}: {row['reason']}" for row in result["skipped"][:ROWS]]
    return html.bullets(lines) if lines else html.paragraph("None.")
