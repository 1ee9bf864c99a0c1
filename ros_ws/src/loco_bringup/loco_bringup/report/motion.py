# SPDX-License-Identifier: Apache-2.0
"""Figures of a report about how the robot moves: forces, gait, feet, trunk and power."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from loco_control.names import LEGS
from loco_learning.metrics import quantities, signals
from loco_learning.runs.log import Log

from ..page.style import (
    BOUND,
    COMMAND,
    MEASURED,
    OTHER,
    TARGET,
    canvas,
    flag_spans,
    legend,
    shade,
    tint,
)
from .figures import (
    WINDOW,
    chapter,
    motion_of_base,
    moving,
    posed,
    tail,
    thin,
    whole_strides,
)

SLOW = 0.03  # below, a cost of transport means nothing [m/s]


@chapter(
    "Ground reaction forces",
    "Vertical force on each foot before the readout drives and at the end. Dashed: half the "
    "weight, the load of a stance leg in a trot.",
)
def ground_reaction_forces(log: Log) -> Figure:
    """Vertical force per leg in two windows."""
    half = log.experiment.trunk.mass * log.experiment.trunk.gravity / 2.0
    windows = [("end of the run", tail(log, WINDOW))]
    train = log.phase_of("train")
    if train.start < train.stop < len(log):
        ticks = slice(max(train.start, train.stop - round(WINDOW / log.dt)), train.stop)
        windows.insert(0, ("end of train", ticks))
    figure, axes = canvas(4, len(windows), 5.0, sharex="col", sharey=True)
    for column, (title, ticks) in enumerate(windows):
        for leg, ax in enumerate(axes[:, column]):
            ax.axhline(half, **BOUND)
            ax.plot(log.t[ticks], log.grf[ticks, leg, 2], **MEASURED)
            ax.margins(x=0)
            tint(ax, log, ticks)
            if column == 0:
                ax.set_ylabel(f"{LEGS[leg].upper()} [N]")
        axes[0, column].set_title(title)
        axes[-1, column].set_xlabel("time [s]")
    axes[0, 0].set_ylim(bottom=min(0.0, axes[0, 0].get_ylim()[0]))
    return figure


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
    "Ground truth through the run: range within each stride (band) and mean over a stride "
    "(line). Broad pale line: the speed asked for.",
)
def trunk_motion(log: Log) -> Figure:
    """Height, roll, pitch, yaw and forward speed."""
    return motion_of_base(log, 6.6)


@chapter(
    "Power, speed and cost of transport",
    "Mechanical power of all joints (thesis eq. 3.28), forward speed (3.30) and P / (m g V) "
    "(3.31), averaged over two strides. The thesis counts braking as negative power; positive "
    "power takes it as lost.",
)
def power_and_cost(log: Log) -> Figure:
    """Power, speed and cost of transport through time."""
    log = moving(posed(log))
    window = 2 * quantities.period(log)
    each = log.dq * log.tau
    signed = signals.moving_mean(each.sum(axis=1), window)
    positive = signals.moving_mean(np.maximum(each, 0.0).sum(axis=1), window)
    speed = signals.moving_mean(quantities.heading_speed(log), window)
    weight = log.experiment.trunk.mass * signals.GRAVITY
    fast = np.where(np.abs(speed) > SLOW, np.abs(speed), np.nan)
    figure, axes = canvas(3, 1, 4.8, sharex=True)
    top, middle, bottom = axes[:, 0]
    for ax, scale in ((top, 1.0), (bottom, weight * fast)):
        ax.plot(*thin(log.t, positive / scale), label="positive work only", **OTHER)
        ax.plot(*thin(log.t, signed / scale), label="signed", **MEASURED)
    top.set_ylabel("power [W]")
    middle.plot(*thin(log.t, log.target_speed), label="speed asked for", **TARGET)
    middle.plot(*thin(log.t, speed), **MEASURED)
    middle.set(ylabel="speed [m/s]", ylim=(min(0.0, np.nanmin(speed)), None))
    bottom.set(ylabel="cost of transport [-]", xlabel="time [s]")
    shade(axes, log)
    figure.align_ylabels(axes)
    legend(figure, top)
    return figure
