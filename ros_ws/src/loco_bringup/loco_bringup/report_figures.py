# SPDX-License-Identifier: Apache-2.0
"""Figures of a report: each draws one thing about a log, or says why it cannot.

A new figure is a function with the decorator `chapter`; its place in this file
is its place on the page.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from loco_control.exceptions import BagError
from loco_control.names import LEGS
from loco_learning import metrics, signals
from loco_learning.log import Log

from .report_style import (
    BOUND, COMMAND, MEASURED, OTHER, TARGET, TINTS,
    canvas, envelope, every, flag_spans, legend, phase_name, phases, shade,
)  # fmt: skip

WINDOW = 1.5  # length of a close look [s]
STRIDES = 6  # of a foot cycle or of an animation
SLOW = 0.03  # below, a cost of transport means nothing [m/s]


@dataclass(frozen=True)
class Chapter:
    """One figure of the report."""

    title: str
    text: str  # what it shows, for people
    draw: Callable[[Log], Figure]


CHAPTERS: list[Chapter] = []


def chapter(title: str, text: str) -> Callable:
    """Put a figure into the report. It raises `BagError` where the bag lacks its data."""

    def register(draw: Callable[[Log], Figure]) -> Callable[[Log], Figure]:
        CHAPTERS.append(Chapter(title, text, draw))
        return draw

    return register


def tail(log: Log, length: float) -> slice:
    """The last `length` seconds of a log."""
    return slice(max(0, len(log) - round(length / log.dt)), len(log))


def whole_strides(log: Log) -> slice:
    """The last few whole strides of a log."""
    return tail(log, STRIDES * metrics.period(log) * log.dt)


def moving(log: Log) -> Log:
    """The log from the end of standing on."""
    stand = log.phase("stand")
    if stand.stop == len(log):
        raise BagError("the run ended while the robot was still standing")
    return log.cut(slice(stand.stop, len(log)))


def learned(log: Log) -> Log:
    """The moving part of a run with a network."""
    if not log.experiment.learner.enabled:
        raise BagError("open loop: this run has no network")
    return moving(log)


def posed(log: Log) -> Log:
    """The log, if its bag has ground truth."""
    if np.isnan(log.truth.position).all():
        raise BagError("the bag has no ground_truth/odom")
    return log


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
    for name, start, stop in phases(log):
        _bar(ax, 0, [(start, stop - start)], TINTS[name], phase_name(log, name))
    driving = log.learning.driving.astype(bool)
    _bar(ax, 1, flag_spans(log.t, ~driving, log.dt), TARGET["color"], "target")
    _bar(ax, 1, flag_spans(log.t, driving, log.dt), COMMAND["color"], "readout", "white")
    share = signals.moving_mean(log.learning.learning.astype(float), round(0.2 / log.dt))
    rows = every(log.t)
    ax.fill_between(log.t[rows], 2.38, 2.38 - 0.76 * share[rows], color=OTHER["color"], linewidth=0)
    for index, name in enumerate(_estimators()):
        spans = flag_spans(log.t, log.stance.estimator == index, log.dt)
        _bar(ax, 3, spans, ("#d9d9d9", "#f0c9a8")[index], name.upper())
    for lane, effect in enumerate(effects, 4):
        start = max(float(effect.get("start", 0.0)), float(log.t[0]))
        stop = min(float(effect.get("stop", np.inf)), float(log.t[-1]) + log.dt)
        _bar(ax, lane, [(start, stop - start)], "#cc79a7")
    if log.fall:
        ax.axvline(log.t[-1], color="#222222", linewidth=2.5)
        ax.annotate("fall", (log.t[-1], -0.55), ha="right", va="bottom", fontsize=8)
    ax.set_yticks(range(len(lanes)), lanes)
    ax.set(ylim=(len(lanes) - 0.45, -0.55), xlabel="time [s]")
    ax.set_xlim(log.t[0], log.t[-1] + log.dt)
    ax.tick_params(axis="y", length=0)
    return figure


def _estimators() -> tuple[str, ...]:
    from loco_control.stance import ESTIMATORS

    return ESTIMATORS


def _bar(ax, lane: int, spans: list, color: str, text: str = "", ink: str = "#333333") -> None:
    ax.broken_barh(spans, (lane - 0.38, 0.76), facecolor=color, linewidth=0)
    whole = ax.get_figure().get_size_inches()[0]
    for start, length in spans:
        if text and length * whole > 0.1 * len(text) * max(1.0, ax.dataLim.x1):
            ax.text(start + length / 2, lane, text, ha="center", va="center", color=ink, fontsize=8)


@chapter(
    "Joint tracking",
    "Hip and knee flexion of a front and a hind leg, close to each change of driver and at the "
    "end. While the target drives, the command is the target.",
)
def joint_tracking(log: Log) -> Figure:
    """Target, command and measured position of four joints in a few windows."""
    windows = _windows(log)
    joints = [("LF HFE", 1), ("LF KFE", 2), ("LH HFE", 7), ("LH KFE", 8)]
    figure, axes = canvas(4, len(windows), 5.6, sharey="row", sharex="col")
    for column, (title, ticks) in enumerate(windows):
        for row, (name, joint) in enumerate(joints):
            ax, t = axes[row, column], log.t[ticks]
            ax.plot(t, log.target.q[ticks, joint], label="target", **TARGET)
            ax.plot(t, log.command.q[ticks, joint], label="command", **COMMAND)
            ax.plot(t, log.state.q[ticks, joint], label="measured", **MEASURED)
            ax.margins(x=0)
            if column == 0:
                ax.set_ylabel(f"{name} [rad]")
            _tint(ax, log, ticks)
        axes[0, column].set_title(title)
        axes[-1, column].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    legend(figure, axes[0, 0])
    return figure


def _windows(log: Log) -> list[tuple[str, slice]]:
    """Titles and ticks: the last two phase changes after standing, and the end."""
    found, width = [], round(WINDOW / log.dt)
    reached = [name for name, _, _ in phases(log)]
    for name in [name for name in reached[1:]][-2:]:
        first = log.phase(name).start
        begin = max(0, first - width // 3)
        found.append((f"{phase_name(log, name)} begins", slice(begin, min(len(log), begin + width))))
    return [*found, ("end of the run", tail(log, WINDOW))]


def _tint(ax, log: Log, ticks: slice) -> None:
    """Shade the phases within a window."""
    first, last = log.t[ticks][0], log.t[ticks][-1]
    for name, start, stop in phases(log):
        a, b = max(start, first), min(stop, last)
        if b > a:
            ax.axvspan(a, b, color=TINTS[name], linewidth=0, zorder=-10)


# ---- learning


@chapter(
    "Prediction error",
    "NRMSE of the eight predicted positions (thesis eq. 3.36) averaged over one gait period, how "
    "far the prediction is behind its target, and the norm of the readout. Dashed: bounds of the "
    "failure criterion.",
)
def prediction_error(log: Log) -> Figure:
    """Smoothed NRMSE, lag and weight norm through time."""
    criterion, log = log.experiment.criterion, learned(log)
    target, prediction = metrics.target_and_prediction(log)
    error = signals.smoothed_nrmse(target, prediction, metrics.period(log))
    figure, axes = canvas(3, 1, 4.9, sharex=True, height_ratios=(2, 1, 1))
    top, middle, bottom = axes[:, 0]
    times, low, high = envelope(log.t, error)
    top.fill_between(times, low, high, color=COMMAND["color"], alpha=0.35, linewidth=0)
    top.plot(times, high, **COMMAND)
    top.axhline(criterion.nrmse, **BOUND)
    top.set(yscale="log", ylabel="smoothed NRMSE [-]")
    top.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    if len(log) > 2 * metrics.period(log):
        middle.plot(*_thin(log.t, metrics.lag(log)), **COMMAND)
    middle.axhline(0.0, color="#999999", linewidth=0.6)
    middle.set_ylabel("lag [stride]")
    low, high = middle.get_ylim()
    middle.set_ylim(min(low, -0.1), max(high, 0.1))
    bottom.plot(*_thin(log.t, log.learning.weight_norm), **OTHER)
    bottom.set(ylabel="readout norm [-]", xlabel="time [s]", ylim=(0, None))
    shade(axes, log)
    figure.align_ylabels(axes)
    return figure


def _thin(t: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows = every(t)
    return t[rows], y[rows]


@chapter(
    "Limit cycle",
    "The eight hip and knee positions in the plane of the two principal components of their "
    "targets (thesis section 3.6.3.3, fig. 8.4), the last strides of each phase.",
)
def limit_cycle(log: Log) -> Figure:
    """Target, prediction and measured joints in the target's PCA plane, by phase."""
    log = moving(log)
    joints = metrics.OUTPUT_JOINTS
    target, measured = signals.limit_cycle(log.target.q[:, joints], log.state.q[:, joints])
    _, command = signals.limit_cycle(log.target.q[:, joints], log.command.q[:, joints])
    reached = [name for name, _, _ in phases(log)]
    if len(log) < 3:
        raise BagError("the run is too short for a limit cycle")
    figure, axes = canvas(1, len(reached), 2.9 if len(reached) > 1 else 3.6, sharex=True, sharey=True)
    for ax, name in zip(axes[0], reached, strict=True):
        ticks = log.phase(name)
        first = max(ticks.start, ticks.stop - STRIDES * metrics.period(log))
        for track, look, label in (
            (target, TARGET, "target"),
            (command, COMMAND, "command"),
            (measured, MEASURED, "measured"),
        ):
            ax.plot(*track[first : ticks.stop].T, label=label, **look)
        ax.set_title(phase_name(log, name))
        ax.set(aspect="equal", xlabel="1st component [rad]")
    axes[0, 0].set_ylabel("2nd component [rad]")
    legend(figure, axes[0, 0])
    return figure


# ---- the gait


@chapter(
    "Ground reaction forces",
    "Vertical force on each foot before the readout drives and at the end. Dashed: half the "
    "weight, the load of a stance leg in a trot.",
)
def ground_reaction_forces(log: Log) -> Figure:
    """Vertical force per leg in two windows."""
    half = log.experiment.trunk.mass * log.experiment.trunk.gravity / 2.0
    windows = [("end of the run", tail(log, WINDOW))]
    train = log.phase("train")
    if train.start < train.stop < len(log):
        ticks = slice(max(train.start, train.stop - round(WINDOW / log.dt)), train.stop)
        windows.insert(0, ("end of train", ticks))
    figure, axes = canvas(4, len(windows), 5.0, sharex="col", sharey=True)
    for column, (title, ticks) in enumerate(windows):
        for leg, ax in enumerate(axes[:, column]):
            ax.axhline(half, **BOUND)
            ax.plot(log.t[ticks], log.state.grf[ticks, leg, 2], **MEASURED)
            ax.margins(x=0)
            _tint(ax, log, ticks)
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
        ("gait clock", log.target.stance, TARGET["color"]),
        ("estimator", log.stance.stance, OTHER["color"]),
        ("contact", log.state.contact, MEASURED["color"]),
    )
    figure, axes = canvas(1, 1, 2.7)
    ax = axes[0, 0]
    for leg in range(4):
        for k, (label, flags, color) in enumerate(rows):
            spans = flag_spans(t, flags[ticks, leg].astype(bool), log.dt)
            name = label if leg == 0 else None
            ax.broken_barh(spans, (leg - 0.36 + 0.25 * k, 0.22), facecolor=color, label=name)
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
        (log.target.foot_position, TARGET, "target"),
        (metrics.feet(log.command.q), COMMAND, "command"),
        (metrics.measured_feet(log), MEASURED, "measured"),
    )
    figure, axes = canvas(2, 2, 4.6)
    for leg, place in enumerate(((0, 1), (1, 1), (0, 0), (1, 0))):  # front is right, left on top
        ax = axes[place]
        for path, look, label in paths:
            ax.plot(path[:, leg, 0], path[:, leg, 2], label=label, **look)
        ax.set_title(LEGS[leg].upper())
        ax.set(aspect="equal", adjustable="datalim")
    for ax in axes[:, 0]:
        ax.set_ylabel("z [m]")
    for ax in axes[1]:
        ax.set_xlabel("x [m]")
    legend(figure, axes[0, 0])
    return figure


# ---- the trunk


@chapter(
    "Trunk motion",
    "Ground truth through the run: range within short stretches (band) and mean over a stride "
    "(line). Broad pale line: the speed asked for.",
)
def trunk_motion(log: Log) -> Figure:
    """Height, roll, pitch, yaw and forward speed."""
    log = posed(log)
    window = metrics.period(log)
    angles = signals.roll_pitch_yaw(log.truth.orientation)
    rows = (
        ("height [m]", log.truth.position[:, 2]),
        ("roll [rad]", angles[:, 0]),
        ("pitch [rad]", angles[:, 1]),
        ("yaw [rad]", angles[:, 2]),
        ("forward speed [m/s]", forward_speed(log)),
    )
    figure, axes = canvas(5, 1, 6.6, sharex=True)
    axes[-1, 0].plot(*_thin(log.t, log.target.speed), label="target", **TARGET)
    for ax, (label, y) in zip(axes[:, 0], rows, strict=True):
        times, low, high = envelope(log.t, y)
        ax.fill_between(times, low, high, color="#222222", alpha=0.25, linewidth=0)
        ax.plot(*_thin(log.t, signals.moving_mean(y, window)), **MEASURED)
        ax.set_ylabel(label)
    axes[-1, 0].set_xlabel("time [s]")
    shade(axes, log)
    figure.align_ylabels(axes)
    return figure


def forward_speed(log: Log) -> np.ndarray:
    """Speed of the base along its heading [m/s], (T,)."""
    yaw = signals.roll_pitch_yaw(log.truth.orientation)[:, 2]
    step = np.gradient(log.truth.position[:, :2], log.dt, axis=0) if len(log) > 1 else np.zeros((1, 2))
    return step[:, 0] * np.cos(yaw) + step[:, 1] * np.sin(yaw)


@chapter(
    "Power, speed and cost of transport",
    "Mechanical power of all joints (thesis eq. 3.28), forward speed (3.30) and P / (m g V) "
    "(3.31), averaged over two strides. The thesis counts braking as negative power; positive "
    "power takes it as lost.",
)
def power_and_cost(log: Log) -> Figure:
    """Power, speed and cost of transport through time."""
    log = moving(posed(log))
    window = 2 * metrics.period(log)
    each = log.state.dq * log.state.tau
    signed = signals.moving_mean(each.sum(axis=1), window)
    positive = signals.moving_mean(np.maximum(each, 0.0).sum(axis=1), window)
    speed = signals.moving_mean(forward_speed(log), window)
    weight = log.experiment.trunk.mass * signals.GRAVITY
    fast = np.where(np.abs(speed) > SLOW, np.abs(speed), np.nan)
    figure, axes = canvas(3, 1, 4.8, sharex=True)
    top, middle, bottom = axes[:, 0]
    for ax, scale in ((top, 1.0), (bottom, weight * fast)):
        ax.plot(*_thin(log.t, positive / scale), label="positive work only", **OTHER)
        ax.plot(*_thin(log.t, signed / scale), label="signed", **MEASURED)
    top.set_ylabel("power [W]")
    middle.plot(*_thin(log.t, log.target.speed), label="speed asked for", **TARGET)
    middle.plot(*_thin(log.t, speed), **MEASURED)
    middle.set(ylabel="speed [m/s]", ylim=(min(0.0, np.nanmin(speed)), None))
    bottom.set(ylabel="cost of transport [-]", xlabel="time [s]")
    shade(axes, log)
    figure.align_ylabels(axes)
    legend(figure, top)
    return figure
