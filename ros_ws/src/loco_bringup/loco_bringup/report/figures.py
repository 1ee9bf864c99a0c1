# SPDX-License-Identifier: Apache-2.0
"""Figures of a report: each draws one thing about a log, or says why it cannot.

A new figure is a function with the decorator `chapter`; its place in this file
is its place on the page. `report_motion` goes on after it.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from loco_control.exceptions import BagError
from loco_control.stance.controller import ESTIMATORS
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
    chapters,
    every,
    flag_spans,
    legend,
    spans,
)
from ..record.readout_check import ReadoutCheck

WINDOW = 1.5  # length of a close look [s]
STRIDES = 6  # of a foot cycle or of an animation


CHAPTERS, chapter = chapters()


def tail(log: Log, length: float) -> slice:
    """The last `length` seconds of a log."""
    return slice(max(0, len(log) - round(length / log.dt)), len(log))


def whole_strides(log: Log) -> slice:
    """The last few whole strides of a log."""
    return tail(log, STRIDES * quantities.period(log) * log.dt)


def moving(log: Log) -> Log:
    """The log from the end of standing on."""
    stand = log.phase_of("stand")
    if len(log) - stand.stop < quantities.period(log):
        raise BagError("the run ended before the robot had made a stride")
    return log.cut(slice(stand.stop, len(log)))


def motion_of_base(log: Log) -> Plot:
    """Height, roll, pitch, yaw and forward speed of the base; with a gait, the speed asked for.

    Args:
        log: A run with ground truth.

    Raises:
        BagError: The run has no ground truth.
    """
    log = posed(log)
    window = quantities.period(log)
    angles = signals.roll_pitch_yaw(log.orientation)
    rows = (
        ("height [m]", log.position[:, 2]),
        ("roll [rad]", angles[:, 0]),
        ("pitch [rad]", angles[:, 1]),
        ("yaw [rad]", angles[:, 2]),
        ("forward speed [m/s]", quantities.heading_speed(log)),
    )
    panels = []
    for label, y in rows:
        lines = [
            Line("as it is", y, "#999999", 0.7),
            Line("mean of a stride", signals.moving_mean(y, window), MEASURED["color"]),
        ]
        if label.startswith("forward") and quantities.walks(log):
            lines.insert(0, Line("target", log.target_speed, TARGET["color"], 3.0))
        panels.append(Panel(label, lines))
    return Plot(log.t, panels, spans(log))


def posed(log: Log) -> Log:
    """The log, if its bag has ground truth; ticks without it get that of the tick before."""
    known = ~np.isnan(log.position[:, 0])
    if not known.any():
        raise BagError("the bag has no ground_truth/odom")
    rows = np.maximum.accumulate(np.where(known, np.arange(len(log)), np.argmax(known)))
    names = ("position", "orientation", "velocity", "spin")
    return log.changed(**{name: log.columns[name][rows] for name in names})


def learned(log: Log) -> Log:
    """The moving part of a run with a network."""
    if not log.experiment.learner.enabled:
        raise BagError("open loop: this run has no network")
    return moving(log)


# ---- the run


@chapter(
    "Timeline",
    "Which signal drives hips and knees, how often the readout learns, who decides which legs "
    "stand, and when effects act on the plant.",
)
def timeline(log: Log) -> Figure:
    """Bars over time: phases, driver, learning, estimator, effects, fall."""
    effects = [e for e in log.experiment.effects if e.get("start", 0.0) < log.t[-1] + log.dt]
    lanes = ["phase", "HFE, KFE from", "readout learns", "stance from"]
    lanes += [e["name"].replace("_", " ") for e in effects]
    figure, axes = canvas(1, 1, 0.62 + 0.27 * len(lanes))
    ax = axes[0, 0]
    whole = len(log) * log.dt
    for color, name, start, stop in spans(log):
        _bar(ax, 0, [(start, stop - start)], color, whole, name)
    by_target, by_readout = drivers(log)
    _bar(ax, 1, flag_spans(log.t, by_target, log.dt), TARGET["color"], whole, "target")
    _bar(ax, 1, flag_spans(log.t, by_readout, log.dt), COMMAND["color"], whole, "readout", "white")
    share = signals.moving_mean(log.learning.astype(float), round(0.2 / log.dt))
    rows = every(log.t)
    ax.fill_between(log.t[rows], 2.38, 2.38 - 0.76 * share[rows], color=OTHER["color"], linewidth=0)
    for index, name in enumerate(_estimators()):
        flags = flag_spans(log.t, log.estimator == index, log.dt)
        _bar(ax, 3, flags, ("#d9d9d9", "#f0c9a8")[index], whole, name.upper())
    for lane, effect in enumerate(effects, 4):
        start = max(float(effect.get("start", 0.0)), float(log.t[0]))
        stop = min(float(effect.get("stop", np.inf)), float(log.t[-1]) + log.dt)
        _bar(ax, lane, [(start, stop - start)], "#cc79a7", whole)
    if log.fall:
        ax.axvline(log.t[-1], color="#222222", linewidth=2.5)
        ax.annotate("fall", (log.t[-1], -0.55), ha="right", va="bottom", fontsize=8)
    ax.set_yticks(range(len(lanes)), lanes)
    ax.set(ylim=(len(lanes) - 0.45, -0.55), xlabel="time [s]")
    ax.set_xlim(log.t[0], log.t[-1] + log.dt)
    ax.tick_params(axis="y", length=0)
    return figure


def drivers(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Times at which the target, and at which the readout, drives HFE and KFE, each (T,)."""
    command = quantities.outputs_commanded(log)
    by_target = np.all(command == quantities.outputs_wanted(log), axis=1)
    return by_target, np.all(command == log.prediction, axis=1) & ~by_target


def _estimators() -> tuple[str, ...]:
    return ESTIMATORS


def _bar(
    ax, lane: int, bars: list, color: str, whole: float, text: str = "", ink: str = "#333333"
) -> None:
    """Bars in a lane; a text stands in those that are long enough for it, of `whole` [s]."""
    ax.broken_barh(bars, (lane - 0.38, 0.76), facecolor=color, linewidth=0)
    for start, length in bars:
        if text and length > 0.014 * len(text) * whole:
            ax.text(start + length / 2, lane, text, ha="center", va="center", color=ink, fontsize=8)


@chapter(
    "Joint tracking",
    "What the joints should do (target), what they are told (command) and what they do. While the "
    "target drives, the command is the target.",
)
def joint_tracking(log: Log) -> Plot:
    """Target, command and measured position of every joint of a walking robot."""
    panels = [
        Panel(
            f"{name.removesuffix('_joint').replace('_', ' ').upper()} [rad]",
            tracked(log.target[:, i], log.command[:, i], log.q[:, i]),
        )
        for i, name in enumerate(log.experiment.plant.joints)
    ]
    return Plot(log.t, panels, spans(log), view=close_look(log))


def close_look(log: Log, strides: float = STRIDES) -> tuple[float, float]:
    """Beginning and end [s] of the last strides of a log."""
    return max(log.t[0], log.t[-1] - strides * quantities.period(log) * log.dt), log.t[-1]


def tracked(target: np.ndarray, command: np.ndarray, measured: np.ndarray) -> list[Line]:
    """Target, command and measurement of a joint, each (T,), in the colours of all pages."""
    return [
        Line("target", target, TARGET["color"], 3.0),
        Line("command", command, COMMAND["color"]),
        Line("measured", measured, MEASURED["color"], 1.0),
    ]


# ---- learning


@chapter(
    "Prediction error",
    "NRMSE of the eight predicted positions (thesis eq. 3.36) averaged over one gait period, how "
    "far the prediction is behind its target, and the norm of the readout. Dashed: bound of the "
    "failure criterion.",
)
def prediction_error(log: Log) -> Plot:
    """Smoothed NRMSE, lag and weight norm through time."""
    criterion, log = log.experiment.criterion, learned(log)
    target, prediction = quantities.target_and_prediction(log)
    error = signals.smoothed_nrmse(target, prediction, quantities.period(log))
    panels = [
        error_panel(error, criterion.nrmse),
        Panel("lag [stride]", [Line("lag", quantities.lag(log), COMMAND["color"])]),
        Panel("readout norm [-]", [Line("readout norm", log.weight_norm, OTHER["color"])]),
    ]
    return Plot(log.t, panels, spans(log))


def error_panel(error: np.ndarray, bound: float) -> Panel:
    """Smoothed NRMSE, (T,), and the bound of the failure criterion."""
    lines = [
        Line("error", error, COMMAND["color"]),
        Line("bound", np.full(len(error), bound), BOUND["color"], dashed=True),
    ]
    return Panel("smoothed NRMSE [-]", lines, logarithmic=True)


def thin(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a smooth signal that are worth drawing."""
    rows = every(t)
    return t[rows], y[rows]


@chapter(
    "Limit cycle",
    "Positions and velocities of the eight hips and knees in the plane of the two principal "
    "components of their targets (thesis section 3.6.3.3, fig. 8.4), in the last strides of each "
    "phase. Each channel is measured in standard deviations of its target.",
)
def limit_cycle(log: Log) -> Figure:
    """Target, command and measured joints in the target's PCA plane, by phase."""
    log = moving(log)
    target, outputs = quantities.outputs_wanted(log), log.experiment.outputs
    tracks = (
        (target, TARGET, "target"),
        (quantities.outputs_commanded(log), COMMAND, "command"),
        (np.concatenate((log.q[:, outputs], log.dq[:, outputs]), axis=1), MEASURED, "measured"),
    )
    planes = [(signals.limit_cycle(target, x)[1], look, label) for x, look, label in tracks]
    reached = log.phases()
    figure, axes = canvas(1, max(2, len(reached)), 3.1, sharex=True, sharey=True)
    for ax in axes[0, len(reached) :]:
        ax.set_axis_off()
    for ax, (name, ticks) in zip(axes[0], reached.items(), strict=False):
        first = max(ticks.start, ticks.stop - STRIDES * quantities.period(log))
        for plane, look, label in planes:
            ax.plot(*plane[first : ticks.stop].T, label=label, **look)
        ax.set_title(name)
        ax.set(aspect="equal", xlabel="1st component [-]")
    axes[0, 0].set_ylabel("2nd component [-]")
    legend(figure, axes[0, 0])
    return figure


def readout(check: ReadoutCheck, joint: int = 1, name: str = "LF KFE") -> Figure:
    """A stride of one joint with the network run again, and the differences through test."""
    figure, axes = canvas(2, 1, 4.4, height_ratios=(3, 2))
    top, bottom = axes[:, 0]
    rows = slice(-min(len(check.t), 200), None)
    top.plot(check.t[rows], check.target[rows, joint], label="target", **TARGET)
    top.plot(check.t[rows], check.commanded[rows, joint], label="command", **COMMAND)
    dots = {
        "color": MEASURED["color"],
        "linestyle": "",
        "marker": ".",
        "markersize": 3,
        "zorder": 3,
    }
    again = check.recomputed[rows, joint][::4]
    top.plot(check.t[rows][::4], again, label="network run again", **dots)
    top.set(ylabel=f"{name} [rad]", xlabel="time [s]")
    top.margins(x=0)
    off = np.max(np.abs(check.commanded - check.recomputed), axis=1)
    for distance, look in ((check.target_distance, TARGET), (off, dots)):
        rows = every(check.t, 450)
        bottom.plot(check.t[rows], np.maximum(distance, _ZERO)[rows], **look)
    bottom.set(yscale="log", ylim=(_ZERO / 10, 100), xlabel="time [s]")
    bottom.set_ylabel("distance of command\n[rad, rad/s]")
    bottom.set_yticks([_ZERO, 1e-12, 1e-8, 1e-4, 1.0], ["0", "1e-12", "1e-8", "1e-4", "1"])
    bottom.minorticks_off()
    bottom.margins(x=0)
    for height, text in ((10.0, "from the target"), (_ZERO * 30, "from the network run again")):
        bottom.text(check.t[0], height, " " + text, va="center", fontsize=8, color="#444444")
    legend(figure, top)
    return figure


_ZERO = 1e-16  # where a difference of exactly 0 is drawn
