# SPDX-License-Identifier: Apache-2.0
"""Figures of a report about the motion: forces, gait, feet, trunk and power."""

from __future__ import annotations

import numpy as np

from loco_control.names import LEGS
from loco_learning.drawing.chart import Axis, Chart, Frame, bars, line
from loco_learning.metrics import quantities, signals
from loco_learning.runs.log import Log

from ..page import style
from ..page.plot import Line, Panel, Plot
from . import figures
from .figures import chapter

MIN_SPEED = 0.03  # speed below which the cost of transport is meaningless [m/s]


@chapter("Ground reaction forces")
def ground_reaction_forces(log: Log) -> Plot:
    """Vertical force per leg.

    Vertical force on each foot. Dashed: half the weight, the load of a stance leg in a trot.
    """
    half_weight = np.full(len(log), log.experiment.trunk.mass * log.experiment.trunk.gravity / 2.0)
    panels = [
        Panel(
            f"{leg.upper()} [N]",
            [
                Line("half the weight", half_weight, style.MEASURED, 0.9, dashed=True),
                Line("force", log.grf[:, i, 2], style.OTHER, 1.0),
            ],
        )
        for i, leg in enumerate(LEGS)
    ]
    return Plot(log.t, panels, style.spans(log), view=figures.close_look(log))


@chapter("Gait diagram")
def gait_diagram(log: Log) -> Chart:
    """Stance phases per leg as bars: from the gait clock, the estimator and contact.

    When each foot stands, in the last strides: by the gait clock, by the estimator that the trunk
    controller uses, and by measured contact.
    """
    ticks = figures.tail(log, 2 * figures.WINDOW)
    t = log.t[ticks]
    rows = (
        ("gait clock", log.clock, style.TARGET),
        ("estimator", log.stance, style.OTHER),
        ("contact", log.contact, style.MEASURED),
    )
    layers = [
        bars(label, style.flag_spans(t, flags[ticks, leg].astype(bool), log.dt),
             leg - 0.25 + 0.25 * k, color, 0.22)
        for leg in range(4)
        for k, (label, flags, color) in enumerate(rows)
    ]  # fmt: skip
    axes = (
        Axis("time [s]", limits=(float(t[0]), float(t[-1]) + log.dt)),
        Axis("leg", names=[leg.upper() for leg in reversed(LEGS)]),
    )
    return Chart([Frame(*axes, [figures.transpose(layer, 4) for layer in layers])])


@chapter("Foot cycles")
def foot_cycles(log: Log) -> Chart:
    """Foot x and z in the base frame [m]: target, command and measured.

    Path of each foot in the frame of the trunk over the last strides, seen from the left (thesis
    section 3.6.2.6). Forward is right.
    """
    log = log.cut(figures.whole_strides(log))
    paths = (
        (log.target_feet, "target", style.TARGET, style.BROAD),
        (quantities.feet(log, "command"), "command", style.COMMAND, 1.2),
        (quantities.feet(log), "measured", style.MEASURED, 0.8),
    )
    frames = []
    for leg in (2, 0, 3, 1):  # front legs at the right, left legs at the top
        layers = [line(label, path[:, leg, 0], path[:, leg, 2], color, size=size)
                  for path, label, color, size in paths]  # fmt: skip
        axes = Axis("x [m]"), Axis("z [m]")
        frames.append(Frame(*axes, layers, LEGS[leg].upper(), equal=True, height=230))
    return Chart(frames)


chapter(
    "Trunk motion",
    "Ground truth through the run, and its mean over a stride. Broad: the speed asked for.",
)(figures.motion_of_base)


@chapter("Power, speed and cost of transport")
def power_and_cost(log: Log) -> Plot:
    """Power, speed and cost of transport over time.

    Mechanical power of all joints (thesis eq. 3.28), forward speed (3.30) and P / (m g V) (3.31),
    averaged over two strides. The thesis counts braking as negative power; positive power takes it
    as lost.
    """
    log = figures.moving(figures.posed(log))
    window = 2 * quantities.period(log)
    each = log.dq * log.tau
    signed = signals.moving_mean(each.sum(axis=1), window)
    positive = signals.moving_mean(np.maximum(each, 0.0).sum(axis=1), window)
    speed = signals.moving_mean(quantities.heading_speed(log), window)
    weight = log.experiment.trunk.mass * signals.GRAVITY
    fast = np.where(np.abs(speed) > MIN_SPEED, np.abs(speed), np.nan)
    panels = [
        Panel("power [W]", _powers(positive, signed)),
        Panel(
            "speed [m/s]",
            [
                Line("asked for", log.target_speed, style.TARGET, 3.0),
                Line("speed", speed, style.MEASURED),
            ],
        ),
        Panel("cost of transport [-]", _powers(positive / weight / fast, signed / weight / fast)),
    ]
    return Plot(log.t, panels, style.spans(log))


def _powers(positive: np.ndarray, signed: np.ndarray) -> list[Line]:
    return [
        Line("positive work only", positive, style.OTHER),
        Line("signed", signed, style.MEASURED),
    ]
