# SPDX-License-Identifier: Apache-2.0
"""Report page of a live calibration: gap over time, periods before and after, parameters."""

from __future__ import annotations

import json
import math

import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from loco_control.exceptions import BagError
from loco_learning.calibration.figures import CALIBRATED, DEFAULT, ROBOT
from loco_learning.calibration.segments import Segments

from ..gap import tables as gap_tables
from ..gap import text as gap_text
from ..page import html
from ..page.html import document, number, part
from ..page.style import Chapter, canvas, legend
from ..report import parts
from .log import MEASURED, MODEL, LiveRun

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
    result = ("What was found", found) if run.names_gap else ("Parameters", parameters)
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
    """A sentence on the two robots and the end of the calibration."""
    before, after = run.error(run.before), run.error(run.after)
    phase, text = run.ending
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
            html.paragraph(_robots(run), soft=True),
            html.verdict(_SURROGATE, False),
            html.verdict(f"{phase}: {text}", phase == "done"),
            html.cards(cards),
        ]
    )


def _robots(run: LiveRun) -> str:
    measured, model = run.experiments[MEASURED], run.experiments[MODEL]
    return (
        f"Measured robot: {measured.name}, {measured.description} "
        f"Model: {model.robot}. Both in one bag, each with its own processes and clock."
    )


def gap(run: LiveRun) -> Figure:
    """Gap per period over the time of the measured robot, a colour step at each model."""
    if not len(run.gap):
        raise BagError("no period of both robots was compared")
    figure, ((ax,),) = canvas(1, 1, 2.6)
    t, values, model, mixed = run.gap.T
    last = max(1.0, model.max())
    whole = mixed == 0.0
    groups = [
        (whole & (model == 0), DEFAULT, "model as given"),
        (whole & (model > 0) & (model < last), _BETWEEN, "models between"),
        (whole & (model == last), CALIBRATED, "last model"),
    ]
    ax.plot(t, values, color="0.8", lw=0.8, zorder=1)
    for chosen, look, label in groups:
        if chosen.any():
            ax.plot(t[chosen], values[chosen], "o", ms=4.5, color=look["color"], label=label)
    ax.plot(t[~whole], values[~whole], "o", ms=3.5, mfc="white", color="0.7", label="of two models")
    ax.set(xlabel="simulated time of the measured robot [s]", ylabel="windowed error [rad]")
    ax.set_ylim(0.0, 1.1 * values.max())
    legend(figure, ax)
    return figure


def periods(run: LiveRun) -> Figure:
    """Average period of each passive joint: measured robot, model before, model after."""
    columns = min(4, len(run.joints))
    rows = -(-len(run.joints) // columns)
    figure, axes = canvas(rows, columns, 0.6 + 2.1 * rows, sharex=True, sharey=True)
    lines: list[tuple[Segments | None, dict, str]] = [
        (run.measured, ROBOT, "measured robot (surrogate)"),
        (run.before, DEFAULT, "model as given"),
        (run.after, CALIBRATED, "last model"),
    ]
    for j, (ax, joint) in enumerate(zip(axes.flat, run.joints, strict=False)):
        for found, look, label in lines:
            if found is None:
                continue
            t = np.arange(found.mean.shape[0]) / found.mean.shape[0] * run.period
            mean, spread = np.degrees(found.mean[:, j]), np.degrees(found.spread[:, j])
            ax.fill_between(t, mean - spread, mean + spread, color=look["color"], alpha=0.18, lw=0)
            ax.plot(t, mean, label=label, **look)
        ax.set_title(joint.removesuffix("_joint").replace("_", " "))
        ax.set_xlabel("time in the period [s]")
    axes[0, 0].set_ylabel("angle [deg]")
    legend(figure, axes[0, 0])
    return figure


def search(run: LiveRun) -> Figure:
    """Smallest error so far over the generations."""
    told = [s for s in run.states if s.phase in ("fitting", "done", "cancelled")]
    if len(told) < 2:
        raise BagError("the search told of no generation")
    figure, ((ax,),) = canvas(1, 1, 2.2)
    ax.step([s.tick for s in told], [s.best for s in told], where="post", color=CALIBRATED["color"])
    ax.axhline(told[0].before, color=DEFAULT["color"], ls=DEFAULT["ls"], lw=0.9)
    ax.set(xlabel="generation", ylabel="smallest error so far")
    ax.set_ylim(0.0)
    return figure


def parameters(run: LiveRun) -> Markup:
    """Calibrated parameters beside those that the model began with."""
    rows = []
    for p, value in run.parameters():
        unit, scale = _MILLI.get(p.unit, (p.unit, 1.0))
        rows.append([p.text, unit, number(scale * p.default), number(scale * value)])
    if not rows:
        raise BagError("no model was better than the one given")
    return html.table(["Parameter", "Unit", "Default", "Calibrated"], rows, range(2, 4))


def found(run: LiveRun) -> Markup:
    """Terms and rivals of the search, as on the page of `loco gap`."""
    if not run.states[-1].gap_json:
        raise BagError("the search ended without a result")
    result = json.loads(run.states[-1].gap_json)
    said = html.paragraph(html.strong(gap_text.headline(result)))
    return said + gap_tables.terms(result) + gap_tables.rivals(result)


def models(run: LiveRun) -> Markup:
    """When the model robot became which model."""
    texts = [e for e in run.bag.messages(f"/{MODEL}/events") if e.kind == "model loaded"]
    if not texts:
        raise BagError("the model robot kept the model it began with")
    rows = []
    for k, (event, t) in enumerate(zip(texts, run.swaps, strict=True), 1):
        chosen = run.gap[(run.gap[:, 2] == k) & (run.gap[:, 3] == 0.0), 1] if len(run.gap) else []
        best = number(float(np.min(chosen))) if len(chosen) else "–"
        rows.append([str(k), f"{t:.2f}", best, event.text])
    head = ["Model", "From, on its clock [s]", "Least gap [rad]", "Values"]
    return html.table(head, rows, range(1, 3))


_BETWEEN = {"color": "#8a8a8a"}
_SURROGATE = (
    "SURROGATE: the measured robot is a simulated stand-in with effects that the model lacks, not "
    "a machine."
)
_GAP = (
    "Windowed error of thesis eq. (5.4) over the last period of both robots, summed over the "
    "passive joints, as it was told while they ran. Hollow dots: the model robot became another "
    "model within the period, and started anew."
)
_PERIODS = (
    "Averages over all whole periods: of the measured robot, of the model before the first change "
    "and after the last. Bands: one standard deviation between periods."
)
_SEARCH = "CMA-ES on the part that was listened to; dashed: the body as given."
