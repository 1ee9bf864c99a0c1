# SPDX-License-Identifier: Apache-2.0
"""Figures of a report about how the robot moves: forces, gait, feet, trunk and power."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from loco_control.names import LEGS
from loco_learning.metrics import quantities, signals
from loco_learning.runs.log import Log

from ..page.plot import Line, Panel, Plot
from ..page.style import (
    BOUND,
    COMMAND,
    MEASURED,
    OTHER,
    TARGET,
    canvas,
    flag_spans,
    legend,
    spans,
)
from .figures import (
    WINDOW,
    chapter,
    close_look,
    motion_of_base,
    moving,
    posed,
    tail,
    whole_strides,
)

SLOW = 0.03  # below, a cost of transport means nothing [m/s]


@chapter(
    "Ground reaction forces",
    "Vertical force on each foot. Dashed: half the weight, the load of a stance leg in a trot.",
)
def ground_reaction_forces(log: Log) -> Plot:
    """Vertical force per leg."""
    half = np.full(len(log), log.experiment.trunk.mass * log.experiment.trunk.gravity / 2.0)
    panels = [
        Panel(
            f"{leg.upper()} [N]",
            [
                Line("half the weight", half, BOUND["color"], 0.9, dashed=True),
                Line("force", log.grf[:, i, 2], OTHER["color"], 1.0),
            ],
        )
        for i, leg in enumerate(LEGS)
    ]
    return Plot(log.t, panels, spans(log), view=close_look(log))


@chapter(
    "Gait diagram",
    "When each foot stands, in the last strides: by the gait clock, by the estimator that the "
    "trunk controller uses, and by measured contact.",
)
def gait_diagram(log: Log) -> Figure:
    """Stance bars per leg from the clock, the estimator and contact."""
    ticks = tail(log, 2 * WINDOW)
    t = log.t[ticks]
    rows = (
        ("gait clock", log.clock, TARGET["color"]),
        ("estimator", log.stance, OTHER["color"]),
        ("contact", log.contact, MEASURED["color"]),
    )
    figure, axes = canvas(1, 1, 2.7)
    ax = axes[0, 0]
    for leg in range(4):
        for k, (label, flags, color) in enumerate(rows):
            bars = flag_spans(t, flags[ticks, leg].astype(bool), log.dt)
            name = label if leg == 0 else None
            ax.broken_barh(bars, (leg - 0.36 + 0.25 * k, 0.22), facecolor=color, label=name)
    ax.set_yticks(range(4), [leg.upper() for leg in LEGS])
    ax.set(ylim=(3.5, -0.5), xlim=(t[0], t[-1] + log.dt), xlabel="time [s]")
    ax.tick_params(axis="y", length=0)
    legend(figure, ax)
    return figure


@chapter(
    "Foot cycles",
    "Path of each foot in the frame of the trunk over the last strides, seen from the left "
    "(thesis section 3.6.2.6). Forward is right.",
)
def foot_cycles(log: Log) -> Figure:
    """Foot x and z in the base frame: target, command and measured."""
    log = log.cut(whole_strides(log))
    paths = (
        (log.target_feet, TARGET, "target"),
        (quantities.feet(log, "command"), COMMAND, "command"),
        (quantities.feet(log), MEASURED, "measured"),
    )
    figure, axes = canvas(2, 2, 4.6)
    for leg, place in enumerate(((0, 1), (1, 1), (0, 0), (1, 0))):  # front is right, left on top
        ax = axes[place]
        for path, look, label in paths:
            ax.plot(path[:, leg, 0], path[:, leg, 2], label=label, **look)
        ax.set_title(LEGS[leg].upper())
        ax.set(aspect="equal", adjustable="datalim")
        ax.locator_params(nbins=5)
    for ax in axes[:, 0]:
        ax.set_ylabel("z [m]")
    for ax in axes[1]:
        ax.set_xlabel("x [m]")
    legend(figure, axes[0, 0])
    return figure


@chapter(
    "Trunk motion",
    "Ground truth through the run, and its mean over a stride. Broad: the speed asked for.",
)
def trunk_motion(log: Log) -> Plot:
    """Height, roll, pitch, yaw and forward speed."""
    return motion_of_base(log)


@chapter(
    "Power, speed and cost of transport",
    "Mechanical power of all joints (thesis eq. 3.28), forward speed (3.30) and P / (m g V) "
    "(3.31), averaged over two strides. The thesis counts braking as negative power; positive "
    "power takes it as lost.",
)
def power_and_cost(log: Log) -> Plot:
    """Power, speed and cost of transport through time."""
    log = moving(posed(log))
    window = 2 * quantities.period(log)
    each = log.dq * log.tau
    signed = signals.moving_mean(each.sum(axis=1), window)
    positive = signals.moving_mean(np.maximum(each, 0.0).sum(axis=1), window)
    speed = signals.moving_mean(quantities.heading_speed(log), window)
    weight = log.experiment.trunk.mass * signals.GRAVITY
    fast = np.where(np.abs(speed) > SLOW, np.abs(speed), np.nan)
    panels = [
        Panel("power [W]", _powers(positive, signed)),
        Panel(
            "speed [m/s]",
            [
                Line("asked for", log.target_speed, TARGET["color"], 3.0),
                Line("speed", speed, MEASURED["color"]),
            ],
        ),
        Panel("cost of transport [-]", _powers(positive / weight / fast, signed / weight / fast)),
    ]
    return Plot(log.t, panels, spans(log))


def _powers(positive: np.ndarray, signed: np.ndarray) -> list[Line]:
    return [
        Line("positive work only", positive, OTHER["color"]),
        Line("signed", signed, MEASURED["color"]),
    ]
