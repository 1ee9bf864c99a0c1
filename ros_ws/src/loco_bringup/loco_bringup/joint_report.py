# SPDX-License-Identifier: Apache-2.0
"""Report page of a joint robot: parts and tables; `report.write_report` writes it."""

from __future__ import annotations

import math
from html import escape
from importlib import resources
from pathlib import Path
from string import Template

from loco_control.exceptions import BagError, LocoError
from loco_learning import joint_metrics as metrics
from loco_learning.joint_log import JointLog
from loco_sim.render import render_gif

from . import joint_report_figures as figures
from . import report, report_tables
from .bag import Bag
from .joint_readout_check import check_joint_log
from .readout_check import ReadoutCheck, weights_of
from .report_figures import readout
from .report_style import svg

HEADLINES = (
    "distance", "forward_speed", "stride_frequency", "shape_error", "cost_of_transport",
    "positive_power", "passive_range", "pitch_range",
)  # fmt: skip
SHOWN, SPEED = 2.0, 0.5  # strides of the animation, and how fast: a small robot is quick


def page(bag: Bag, log: JointLog, gif: Path | None) -> str:
    """HTML text of a report; `gif` is where the animation goes, None for none."""
    values, check = metrics.table(log), checked(bag, log)
    parts = [
        report.part("Animation", lambda: animation(log, gif)),
        *(
            report.part(c.title, lambda c=c: report.picture(svg(c.draw(log)), c.title, c.text))
            for c in figures.CHAPTERS
        ),
        report.part("Who drives the joints", lambda: driver(log, check)),
        report.part("Metrics", lambda: report.METRICS_TEXT + metric_table(values), long=True),
        report.part("Effects", lambda: report_tables.effect_table(log)),
        report.part("Configuration", lambda: report.configuration(log), long=True),
        report.part("Messages", lambda: report_tables.message_table(bag)),
    ]
    template = resources.files(__package__).joinpath("report_template.html").read_text("utf-8")
    return Template(template).substitute(
        title=escape(log.experiment.name),
        header=header(bag, log, values),
        contents=" ".join(f'<a href="#{p.anchor}">{p.title}</a>' for p in parts),
        sections="\n".join(p.html for p in parts),
    )


def checked(bag: Bag, log: JointLog) -> ReadoutCheck | LocoError:
    """Result of the readout check, or why it cannot be made."""
    try:
        return check_joint_log(log, weights_of(bag))
    except LocoError as error:
        return error


def driver(log: JointLog, check: ReadoutCheck | LocoError) -> str:
    """Result of the readout check, in words and as a figure."""
    if isinstance(check, LocoError):
        raise check
    plant = log.experiment.plant
    name = figures.short(plant.joints[plant.driven[0]])
    return report.driver_text(check, readout(check, 0, name), _CHECK)


def header(bag: Bag, log: JointLog, values: dict[str, dict[str, float]]) -> str:
    """What the run was, how it ended, and how far the robot got."""
    well, text = report_tables.ending(log)
    return (
        f'<p class="soft">{escape(log.experiment.description)}</p>'
        f'<p class="verdict{"" if well else " bad"}">{escape(text)}</p>'
        f"<p>{escape(sentence(log, values))}</p>"
        f"{cards(values)}{facts(bag, log)}"
    )


def sentence(log: JointLog, values: dict[str, dict[str, float]]) -> str:
    """The run in words: distance, speed and who drove."""
    name, robot = log.experiment.name, log.experiment.plant.name
    if not len(log) or not math.isfinite(log.position[-1, 0]) or log.experiment.plant.fixed_base:
        return f"{robot} ran {name} for {len(log) * log.dt:.1f} s."
    far, length = metrics.progress(log)[-1], len(log) * log.dt
    text = (
        f"{robot} got {math.hypot(*far):.2f} m away in {length:.1f} s: {far[0]:.2f} m along its "
        f"first heading and {abs(far[1]):.2f} m to the {'left' if far[1] > 0 else 'right'}, "
        f"{math.hypot(*far) / length:.3f} m/s."
    )
    last = values.get("test")
    if last and math.isfinite(last["speed"]):
        text += (
            f" In test, with its readout alone, it went forward at {last['forward_speed']:.3f} "
            f"m/s and {last['stride_frequency']:.3f} strides/s."
        )
    return text


def cards(values: dict[str, dict[str, float]]) -> str:
    """The main numbers of the last phase that was long enough."""
    rows = {name: v for name, v in values.items() if math.isfinite(v["torque_max"])}
    if not rows:
        return ""
    phase, row = list(rows.items())[-1]
    boxes = "".join(
        f"<div><dt>{escape(report_tables.label(n))}</dt><dd>{report_tables.number(row[n])} "
        f"<small>{report_tables.unit(metrics.METRICS[n].unit)}</small></dd></div>"
        for n in HEADLINES
        if math.isfinite(row[n])
    )
    note = f'<p class="soft">These numbers are of the phase “{phase}”.</p>'
    return f'<dl class="cards">{boxes}</dl>{note}'


def facts(bag: Bag, log: JointLog) -> str:
    """What the run was: phases, seed, clock, versions, drops, verdict."""
    phases = (f"{name} {a:g}–{round(b, 3):g} s" for _, name, a, b in figures.spans(log))
    rows = {"Phases": " · ".join(phases), "Failure criterion": verdict(log)}
    return report_tables.fact_table(
        {**rows, **report_tables.run_facts(bag, log.seed, log.experiment.robot)}
    )


def verdict(log: JointLog) -> str:
    """Which parts of the experiment's failure criterion were met."""
    if not log.experiment.learner.enabled:
        return "failed: fall" if log.fall else "no failure"
    return report_tables.verdict_text(metrics.judge(log), log.experiment.criterion)


def metric_table(values: dict[str, dict[str, float]]) -> str:
    """Every metric of each phase, with unit, equation and meaning."""
    return report_tables.metric_rows(metrics.METRICS, values, {name: name for name in values})


def animation(log: JointLog, path: Path | None) -> str:
    """The last strides as a GIF at half speed, written to `path` and put into the page."""
    if path is None:
        raise BagError("the animation was left out on request")
    log = figures.posed(log).cut(figures.tail(log, SHOWN))
    data = render_gif(
        path,
        log.t,
        log.position,
        log.orientation,
        log.q,
        fps=report.FPS,
        size=report.SIZE,
        robot=log.experiment.plant,
        speed=SPEED,
    )
    text = f"The end of the run, {log.t[0]:.2f} s to {log.t[-1]:.2f} s, at half speed."
    return f'{report.image(data, "gif", text, "movie")}<p class="soft">{text}</p>'


_CHECK = (
    "The network of the bag is run again over the recorded sensors, without any target. Dots that "
    "lie on the command line, and a distance of 0, mean that nothing but the readout made it."
)
