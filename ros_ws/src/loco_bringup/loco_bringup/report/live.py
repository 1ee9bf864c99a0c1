# SPDX-License-Identifier: Apache-2.0
"""Report page of a live calibration: gap over time, periods before and after, parameters."""

from __future__ import annotations

import json
import math

import numpy as np
from markupsafe import Markup

from loco_control.exceptions import BagError
from loco_learning.calibration.figures import CALIBRATED, DEFAULT, ROBOT, period_frames
from loco_learning.drawing.chart import DASHED, GREY, Axis, Chart, Frame, dots, line

from ..gap import tables as gap_tables
from ..gap import text as gap_text
from ..page import html
from ..page.html import document, number, part
from ..page.style import Chapter
from . import parts
from .live_log import MEASURED, MODEL, LiveRun

_MILLI = {"m": ("mm", 1e3)}


def page(run: LiveRun) -> str:
    """HTML text of the page."""
    joints = "Joints" if run.names_gap else "Knees"
    drawn = [
        Chapter("Gap over time", _GAP, gap),
        Chapter(f"{joints} before and after", _PERIODS, periods),
    ]
    if not run.names_gap:
        drawn.append(Chapter("Search", _SEARCH, search))
    result = ("What was found", gap_table) if run.names_gap else ("Parameters", parameters)
    return document(
        "Live gap" if run.names_gap else "Live calibration",
        header(run),
        [
            *parts.drawn(drawn, run),
            part(result[0], lambda: result[1](run)),
            part("Models in turn", lambda: models(run)),
            part("Messages", lambda: parts.message_table(run.bag)),
        ],
    )


def header(run: LiveRun) -> Markup:
    """Sentence on the two robots and the outcome of the calibration."""
    before, after = run.error(run.before), run.error(run.after)
    phase, text = run.ending
    measured, model = run.experiments[MEASURED], run.experiments[MODEL]
    robots = (
        f"Measured robot: {measured.name}, {measured.description} "
        f"Model: {model.robot}. Both in one bag, each with its own processes and clock."
    )
    cards = [
        ("Gap before", number(before), "rad"),
        ("Gap after", number(after), "rad"),
        ("Ratio", number(before / after if after else math.nan), ""),
        ("Models tried live", str(len(run.swaps)), ""),
    ]
    if run.names_gap:
        cards.append(("Verdict", run.states[-1].verdict or "–", ""))
    else:
        cards.append(("Generations", str(run.states[-1].tick), ""))
        cards.append(("Rollouts", str(run.states[-1].evaluations), ""))
    return html.join(
        [
            html.paragraph(robots, soft=True),
            html.missing(_SURROGATE),
            html.verdict(f"{phase}: {text}", phase == "done"),
            html.cards(cards),
        ]
    )


def gap(run: LiveRun) -> Chart:
    """Gap per period over the time of the measured robot; the colour changes with each model."""
    if not len(run.gap):
        raise BagError("no period of both robots was compared")
    t, values, model, mixed = run.gap.T
    last = max(1.0, model.max())
    unmixed = mixed == 0.0
    groups = [
        (~unmixed, GREY, "of two models"),
        (unmixed & (model == 0), DEFAULT, "model as given"),
        (unmixed & (model > 0) & (model < last), _BETWEEN, "models between"),
        (unmixed & (model == last), CALIBRATED, "last model"),
    ]
    layers = [line("gap", t, values, GREY, size=0.8)]
    for mask, color, label in groups:
        labels = [
            f"{label}, model {k:.0f}: {v:.4g} rad" for k, v in zip(model, values, strict=True)
        ]
        group_labels = [text for text, in_group in zip(labels, mask, strict=True) if in_group]
        layers.append(dots(label, t[mask], values[mask], str(color), texts=group_labels))
    x = Axis("simulated time of the measured robot [s]")
    y = Axis("windowed error [rad]", limits=(0.0, 1.1 * float(values.max()) or 1.0))
    return Chart([Frame(x, y, layers)])


def periods(run: LiveRun) -> Chart:
    """Average period of each passive joint: measured robot, model before, model after."""
    sources = [
        ("measured robot (surrogate)", ROBOT, run.measured),
        ("model as given", DEFAULT, run.before),
        ("last model", CALIBRATED, run.after),
    ]
    curves = [(label, color, x.mean, x.spread) for label, color, x in sources if x]
    if not curves:
        raise BagError("no whole period was recorded")
    return Chart(period_frames(run.joints, run.period, curves))


def search(run: LiveRun) -> Chart:
    """Smallest error so far over the generations."""
    states = [s for s in run.states if s.phase in ("fitting", "done", "cancelled")]
    if len(states) < 2:
        raise BagError("the search told of no generation")
    at, best = [s.tick for s in states], [s.best for s in states]
    layers = [
        line("body as given", [at[0], at[-1]], [states[0].before] * 2, DEFAULT,
             shape=DASHED),
        line("best so far", at, best, CALIBRATED),
        dots("best so far", at, best, CALIBRATED, size=2.5),
    ]  # fmt: skip
    top = 1.06 * max(states[0].before, *best)
    y = Axis("smallest error so far [-]", limits=(0.0, top))
    return Chart([Frame(Axis("generation [-]"), y, layers)])


def parameters(run: LiveRun) -> Markup:
    """Table of the calibrated and the initial parameters."""
    rows = []
    for p, value in run.parameters():
        unit, scale = _MILLI.get(p.unit, (p.unit, 1.0))
        rows.append([p.text, unit, number(scale * p.default), number(scale * value)])
    if not rows:
        raise BagError("no model was better than the one given")
    return html.table(["Parameter", "Unit", "Default", "Calibrated"], rows, range(2, 4))


def gap_table(run: LiveRun) -> Markup:
    """Tables of terms and alternatives of the search, as on the page of `loco gap`."""
    if not run.states[-1].gap_json:
        raise BagError("the search ended without a result")
    result = json.loads(run.states[-1].gap_json)
    headline = html.paragraph(html.strong(gap_text.headline(result)))
    return headline + gap_tables.terms(result) + gap_tables.rivals(result)


def models(run: LiveRun) -> Markup:
    """Table of the times at which the model robot switched models."""
    loaded = [e for e in run.bag.messages(f"/{MODEL}/events") if e.kind == "model loaded"]
    if not loaded:
        raise BagError("the model robot kept the model it began with")
    rows = []
    for k, (event, t) in enumerate(zip(loaded, run.swaps, strict=True), 1):
        gaps = run.gap[(run.gap[:, 2] == k) & (run.gap[:, 3] == 0.0), 1] if len(run.gap) else []
        best = number(float(np.min(gaps))) if len(gaps) else "–"
        rows.append([str(k), f"{t:.2f}", best, event.text])
    head = ["Model", "From, on its clock [s]", "Least gap [rad]", "Values"]
    return html.table(head, rows, range(1, 3))


_BETWEEN = "#666666"
_SURROGATE = (
    "SURROGATE: the measured robot is a simulated stand-in with effects that the model lacks, not "
    "a machine."
)
_GAP = (
    "Windowed error of thesis eq. (5.4) over the last period of both robots, summed over the "
    "passive joints, as it was told while they ran. “Of two models”: the model robot became "
    "another model within the period, and started anew."
)
_PERIODS = (
    "Averages over all whole periods: of the measured robot, of the model before the first change "
    "and after the last. Dashed: one standard deviation between periods."
)
_SEARCH = "CMA-ES on the part that was listened to; dashed: the body as given."
