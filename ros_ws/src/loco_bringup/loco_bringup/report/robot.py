# SPDX-License-Identifier: Apache-2.0
"""Report page about a run of a robot; written by `report.write_report`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from markupsafe import Markup

from loco_control.exceptions import BagError, LocoError
from loco_learning.metrics import quantities
from loco_learning.metrics import registry as metrics
from loco_learning.runs.log import Log
from loco_learning.study.trial import judge
from loco_sim.world.render import render_gif

from ..bag.reader import Bag
from ..page import html
from ..page.html import document, number, part
from ..page.style import spans
from ..record.readout_check import ReadoutCheck, check_log, weights_of
from . import figures, joint_figures, parts
from . import motion as motion  # its import registers its figures in `figures`

# Strides and speed of the animation; small robots move fast.
SHOWN, SHOWN_SMALL = (figures.STRIDES, 1.0), (2.0, 0.5)
WALKING = (  # metrics of the cards at the top, legged robots
    "speed", "nrmse", "stride_frequency", "cost_of_transport", "positive_power", "grf_max",
)  # fmt: skip
JOINTED = (  # the same, robots without legs
    "distance", "forward_speed", "stride_frequency", "shape_error",
    "positive_cost_of_transport", "positive_power", "passive_range", "pitch_range",
)  # fmt: skip
BOLTED = ("tracking_error", "torque_max", "positive_power", "passive_range")  # fixed base


def page(bag: Bag, log: Log, gif: Path | None) -> str:
    """HTML text of a report; `gif` is the path of the animation, None for no animation."""
    values, check = metrics.table(log), checked(bag, log)
    walks = bool(log.experiment.gait)
    bolted = log.experiment.plant.fixed_base
    chapters = figures.CHAPTERS if walks else joint_figures.CHAPTERS
    if bolted:
        chapters = [c for c in joint_figures.CHAPTERS if c.title not in joint_figures.OF_GAITS]
    return document(
        log.experiment.name,
        header(bag, log, values, check, part("Animation", lambda: animation(log, gif)).content),
        [
            *parts.drawn(chapters, log),
            *(
                [
                    part(
                        f"Who drives {'hips and knees' if walks else 'the joints'}",
                        lambda: driver(log, check),
                    )
                ]
                if log.experiment.learner.enabled or not bolted
                else []
            ),
            part("Metrics", lambda: parts.metric_table(values), long=True),
            part("Facts", lambda: facts(bag, log, check)),
            part("Effects", lambda: parts.effect_table(log)),
            part("Configuration", lambda: parts.configuration(log.experiment), long=True),
            part("Messages", lambda: parts.message_table(bag)),
        ],
    )


def checked(bag: Bag, log: Log) -> ReadoutCheck | LocoError:
    """Result of the readout check, or the error with the reason why it is not possible."""
    try:
        return check_log(log, weights_of(bag))
    except LocoError as error:
        return error


def header(
    bag: Bag,
    log: Log,
    values: dict[str, dict[str, float]],
    check: ReadoutCheck | LocoError,
    moving: Markup,
) -> Markup:
    """Header of the page: end of the run, main numbers, animation."""
    walks = bool(log.experiment.gait)
    summary = Markup() if walks else html.paragraph(sentence(log, values))
    metric_names = WALKING if walks else BOLTED if log.experiment.plant.fixed_base else JOINTED
    numbers = parts.cards(values, metric_names, references(log))
    return html.join(
        [
            html.paragraph(log.experiment.description, soft=True),
            parts.end_markup(log),
            html.beside(html.join([summary, numbers]), moving),
        ]
    )


def references(log: Log) -> dict[str, str]:
    """Texts with reference values for the main numbers, by metric."""
    remarks = {"nrmse": f"bound {log.experiment.criterion.nrmse:g}"}
    if quantities.walks(log):
        last = list(log.phases().values())[-1]
        remarks["speed"] = f"asked for {number(float(np.mean(log.target_speed[last])))}"
    stride = 1.0 / (quantities.period(log) * log.dt)
    return {**remarks, "stride_frequency": f"gait clock {number(stride)}"}


def sentence(log: Log, values: dict[str, dict[str, float]]) -> str:
    """Summary of the run: distance, speed, and whether the target or the readout drove."""
    robot = log.experiment.plant.name
    if not len(log) or not math.isfinite(log.position[-1, 0]) or log.experiment.plant.fixed_base:
        return f"{robot} ran for {len(log) * log.dt:.1f} s.{_tracked(log, values)}"
    move, length = quantities.progress(log)[-1], len(log) * log.dt
    text = (
        f"{robot} got {math.hypot(*move):.2f} m away in {length:.1f} s: {move[0]:.2f} m along its "
        f"first heading and {abs(move[1]):.2f} m to the {'left' if move[1] > 0 else 'right'}, "
        f"{math.hypot(*move) / length:.3f} m/s."
    )
    last = values.get("test")
    if last and math.isfinite(last["speed"]):
        text += (
            f" In test, with its readout alone, it went forward at {last['forward_speed']:.3f} "
            f"m/s and {last['stride_frequency']:.3f} strides/s."
        )
    return text


def _tracked(log: Log, values: dict[str, dict[str, float]]) -> str:
    """Sentence on the tracking error of the drives; empty if unknown."""
    last = list(values.values())[-1] if values else {}
    error, motion = (
        last.get("tracking_error", math.nan),
        quantities.columns(log.q, log.experiment.plant.driven),
    )
    if not math.isfinite(error) or not motion.size:
        return ""
    share = error / max(float(np.mean(np.std(motion, axis=0))), 1e-9)
    return f" Its drives missed their command by {number(error, 3)} rad (rms), {share:.1%} of the motion."


def facts(bag: Bag, log: Log, check: ReadoutCheck | LocoError) -> Markup:
    """Table of phases, seed, clock, versions, drops and verdict."""
    phases = (f"{name} {a:g}–{round(b, 3):g} s" for _, name, a, b in spans(log))
    about = parts.run_facts(bag, log.seed, log.experiment.robot)
    versions = about.pop("Versions")
    if log.experiment.learner.enabled:
        about["Failure criterion"] = parts.verdict_text(judge(log), log.experiment.criterion)
        about["Readout check"] = str(check) if isinstance(check, LocoError) else check.summary()
    return html.facts({"Phases": " · ".join(phases), **about, "Versions": versions})


def animation(log: Log, path: Path | None) -> Markup:
    """GIF of the last strides, written to `path` and embedded in the page."""
    if path is None:
        raise BagError("the animation was left out on request")
    strides, speed = SHOWN if log.experiment.gait else SHOWN_SMALL
    log = figures.posed(log)
    log = log.cut(figures.tail(log, strides * quantities.period(log) * log.dt))
    data = render_gif(
        path, log.t, log.position, log.orientation, log.q, fps=parts.FPS, size=parts.SIZE,
        robot=log.experiment.plant, speed=speed,
    )  # fmt: skip
    pace = "in real time" if speed == 1.0 else f"at {speed:g} of its speed"
    text = f"The robot at the end of the run, {log.t[0]:.2f} s to {log.t[-1]:.2f} s, {pace}."
    text += " A pointer at a time in a plot stops it there."
    return html.movie(data, text, float(log.t[0]), float(log.t[-1]))


def driver(log: Log, check: ReadoutCheck | LocoError) -> Markup:
    """Result of the readout check as text and figure.

    Raises:
        LocoError: The check was not possible.
    """
    if isinstance(check, LocoError):
        raise check
    column, plant = (1 if log.experiment.gait else 0), log.experiment.plant
    name = joint_figures.short(plant.joints[plant.driven[log.experiment.outputs[column]]])
    mark = html.good("Verified:" if check.drives else "Not verified:", check.drives)
    drawn = figures.readout(check, column, name)
    text = html.paragraph(mark, f"{check.summary()}.")
    return text + html.figure(drawn, "Readout check", _CHECK)


_CHECK = (
    "The network of the bag is run again over what the body felt, without any target. Dots that "
    "lie on the command line, and a distance of 0, mean that nothing but the readout made it."
)
