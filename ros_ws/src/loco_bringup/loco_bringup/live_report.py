# SPDX-License-Identifier: Apache-2.0
"""Report page of a live calibration: gap over time, periods before and after, parameters."""

from __future__ import annotations

import json
import math
from html import escape
from importlib import resources
from string import Template

import numpy as np
from matplotlib.figure import Figure

from loco_control.exceptions import BagError
from loco_learning.calibration.figures import CALIBRATED, DEFAULT, ROBOT
from loco_learning.calibration.segments import Segments

from . import gap_tables, gap_text
from . import report_tables as tables
from .live_run import MEASURED, MODEL, LiveRun
from .report import part, picture
from .report_style import canvas, legend, svg

_MILLI = {"m": ("mm", 1e3)}


def page(run: LiveRun) -> str:
    """HTML text of the page."""
    drawn = {
        "Gap over time": (gap, _GAP),
        f"{'Joints' if run.names_gap else 'Knees'} before and after": (periods, _PERIODS),
    }
    if not run.names_gap:
        drawn["Search"] = (search, _SEARCH)
    parts = [
        *(
            part(title, lambda draw=draw, title=title, text=text: picture(
                svg(draw(run)), title, text
            ))
            for title, (draw, text) in drawn.items()
        ),
        part("What was found", lambda: found(run)) if run.names_gap
        else part("Parameters", lambda: parameters(run)),
        part("Models in turn", lambda: models(run)),
        part("Messages", lambda: tables.message_table(run.bag)),
    ]  # fmt: skip
    template = resources.files(__package__).joinpath("report_template.html").read_text("utf-8")
    return Template(template).substitute(
        title="Live gap" if run.names_gap else "Live calibration",
        header=header(run),
        contents=" ".join(f'<a href="#{p.anchor}">{p.title}</a>' for p in parts),
        sections="\n".join(p.html for p in parts),
    )


def header(run: LiveRun) -> str:
    """What was calibrated against what, and how it ended."""
    before, after = run.error(run.before), run.error(run.after)
    phase, text = run.ending
    cards = {
        "Gap before [rad]": tables.number(before),
        "Gap after [rad]": tables.number(after),
        "Ratio": tables.number(before / after if after else math.nan),
        "Models tried live": str(len(run.swaps)),
    }
    if run.names_gap:
        cards["Verdict"] = escape(run.states[-1].verdict or "–")
    else:
        cards["Generations"] = str(run.states[-1].tick)
        cards["Rollouts"] = str(run.states[-1].evaluations)
    boxes = "".join(f"<div><dt>{escape(k)}</dt><dd>{v}</dd></div>" for k, v in cards.items())
    bad = "" if phase == "done" else " bad"
    return (
        f'<p class="soft">{escape(_robots(run))}</p>'
        f'<p class="verdict bad">{_SURROGATE}</p>'
        f'<p class="verdict{bad}">{escape(f"{phase}: {text}")}</p><dl class="cards">{boxes}</dl>'
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
    t, values, number, mixed = run.gap.T
    last = max(1.0, number.max())
    whole = mixed == 0.0
    groups = [
        (whole & (number == 0), DEFAULT, "model as given"),
        (whole & (number > 0) & (number < last), _BETWEEN, "models between"),
        (whole & (number == last), CALIBRATED, "last model"),
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


def parameters(run: LiveRun) -> str:
    """Calibrated parameters beside those that the model began with."""
    rows = []
    for p, value in run.parameters():
        unit, scale = _MILLI.get(p.unit, (p.unit, 1.0))
        rows.append([escape(p.text), unit, tables.number(scale * p.default),
                     tables.number(scale * value)])  # fmt: skip
    if not rows:
        raise BagError("no model was better than the one given")
    return tables.table(["Parameter", "Unit", "Default", "Calibrated"], rows, range(2, 4))


def found(run: LiveRun) -> str:
    """Terms and rivals of the search, as on the page of `loco gap`."""
    if not run.states[-1].gap_json:
        raise BagError("the search ended without a result")
    result = json.loads(run.states[-1].gap_json)
    said = f"<p><strong>{escape(gap_text.headline(result))}</strong></p>"
    return said + gap_tables.terms(result) + gap_tables.rivals(result)


def models(run: LiveRun) -> str:
    """When the model robot became which model."""
    texts = [e for e in run.bag.messages(f"/{MODEL}/events") if e.kind == "model loaded"]
    if not texts:
        raise BagError("the model robot kept the model it began with")
    rows = []
    for number, (event, t) in enumerate(zip(texts, run.swaps, strict=True), 1):
        chosen = (
            run.gap[(run.gap[:, 2] == number) & (run.gap[:, 3] == 0.0), 1] if len(run.gap) else []
        )
        best = tables.number(float(np.min(chosen))) if len(chosen) else "–"
        rows.append([str(number), f"{t:.2f}", best, escape(event.text)])
    head = ["Model", "From, on its clock [s]", "Least gap [rad]", "Values"]
    return tables.table(head, rows, range(1, 3))


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
